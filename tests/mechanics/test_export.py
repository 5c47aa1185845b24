"""Material cards hold the numbers of the gel, in the form each program reads."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.mechanics.material import write_material
from tactilevision.records.measured import Material

GEL = Material(0.1981, 0.4797)


@pytest.mark.parametrize("suffix", [".inp", ".ccx"])
def test_keyword_cards_hold_c10_and_d1(suffix: str, tmp_path: Path) -> None:
    write_material(tmp_path / f"gel{suffix}", GEL)
    lines = [line for line in (tmp_path / f"gel{suffix}").read_text().splitlines() if not line.startswith("**")]
    assert lines[0] == "*MATERIAL, NAME=GEL"
    assert re.fullmatch(r"\*HYPERELASTIC, ?NEO HOOKE", lines[1])
    c10, d1 = map(float, lines[2].split(","))
    assert (c10, d1) == pytest.approx((0.0335, 1.2297), abs=5e-5)


def test_febio_card_is_xml_with_the_same_moduli(tmp_path: Path) -> None:
    write_material(tmp_path / "gel.feb", GEL)
    card = ElementTree.fromstring((tmp_path / "gel.feb").read_text())  # noqa: S314 (our own text)
    material = card.find("material")
    assert material is not None
    assert material.get("type") == "Mooney-Rivlin"
    assert float(material.findtext("c1", "")) == pytest.approx(0.0335, abs=5e-5)
    assert float(material.findtext("c2", "")) == 0
    assert float(material.findtext("k", "")) == pytest.approx(GEL.bulk_modulus_MPa, rel=1e-8)


def test_cards_are_chosen_by_suffix(tmp_path: Path) -> None:
    gel = Material(0.2, 0.48, np.array([[1e-4, 0], [0, 1e-5]]))
    for suffix, sign in ((".inp", "*HYPER"), (".ccx", "*HYPER"), (".feb", "<k>")):
        write_material(tmp_path / f"gel{suffix}", gel)
        assert sign in (tmp_path / f"gel{suffix}").read_text()
    write_material(tmp_path / "gel.json", gel)
    record = json.loads((tmp_path / "gel.json").read_text())
    assert record["covariance"] == [[1e-4, 0], [0, 1e-5]]
    assert record["neo_hooke"]["C10_MPa"] == pytest.approx(0.2 / 4 / 1.48)


def test_bad_suffixes_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="suffix"):
        write_material(tmp_path / "gel.txt", GEL)
