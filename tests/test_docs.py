"""The documents name what there is, and nothing that is gone."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

from tactilevision.cli import main

ROOT = Path(__file__).parents[1]
HOUSE = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")


def rooms() -> list[str]:
    """Files and packages at the top of tactilevision."""
    found = [path for path in (ROOT / "tactilevision").iterdir() if path.name[0] not in "_."]
    files = [path.name for path in found if path.suffix == ".py"]
    return sorted(files + [f"{path.name}/" for path in found if (path / "__init__.py").is_file()])


@pytest.mark.parametrize("room", rooms())
def test_the_house_shows_every_room(room: str) -> None:
    assert re.search(rf"`(tactilevision/)?{re.escape(room)}`", HOUSE)


def test_the_house_shows_no_room_that_is_gone() -> None:
    table = "\n".join(line.split("|")[1] for line in HOUSE.splitlines() if line.startswith("| `"))
    for name in re.findall(r"`([\w/]+(?:\.py|/))`", table):
        places = (ROOT / name, ROOT / "tactilevision" / name)
        assert any(place.exists() for place in places), name


def test_the_format_names_every_key_of_a_calibration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sample = ROOT / "sample_frames" / "paper_points"
    monkeypatch.setattr(sys, "argv", ["tactilevision", "calibrate", str(sample), "--out", str(tmp_path)])
    assert main() == 0
    told = (ROOT / "docs" / "format.md").read_text(encoding="utf-8").split("## calibration.json")[1]
    missing = [key for key in json.loads((tmp_path / "calibration.json").read_text()) if f"`{key}`" not in told]
    assert missing == []
