"""The scorer of whole recordings: what it says of a calibration beside the truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from each import each

from benchmarks.rendered import read
from benchmarks.rendered.read import ASKED, content, report, revision, scored

TRUTH: dict[str, Any] = {
    "poisson_ratio": 0.45,
    "youngs_modulus_MPa": 0.2,
    "c_N_per_mm": 3.0,
    "clock_offset_s": -0.15,
    "presses_accepted": ["p1", "p3"],
    "presses_rejected": [{"press": "p2", "reason": "tilt"}, {"press": "p4", "reason": "border"}],
}


def estimate(value: float, half: float) -> dict[str, Any]:
    return {"value": value, "std": half / 1.96, "interval95": [value - half, value + half]}


def found(**changes: Any) -> dict[str, Any]:
    good = {
        "poisson_ratio": estimate(0.446, 0.01),
        "youngs_modulus_MPa": estimate(0.201, 0.01),
        "c_N_per_mm": estimate(3.03, 0.06),
        "clock_offset_s": estimate(-0.1485, 0.002),
        "presses_accepted": ["p1", "p3"],
        "presses_rejected": TRUTH["presses_rejected"],
        "flags": ["cast_shadow"],
    }
    return good | changes


def recording(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "truth.toml").write_text(tomli_w.dumps(TRUTH))
    return folder


def test_a_good_reading_does_all_that_is_asked(tmp_path: Path) -> None:
    one = scored(recording(tmp_path / "a"), found())
    assert [what for what, _, does in ASKED if not does(one)] == []
    assert one.nu.off == pytest.approx(-0.004)
    assert one.modulus.share == pytest.approx(0.005)
    assert (one.good, one.lost, one.bad, one.named) == (2, (), 2, 2)


@each(
    "changes, missed",
    [
        ({"poisson_ratio": estimate(0.44, 0.005)}, {"nu within .0075", "interval of nu holds"}),
        ({"poisson_ratio": estimate(0.451, 0.03)}, {"interval of nu under .04"}),
        ({"youngs_modulus_MPa": estimate(0.21, 0.02)}, {"E within 3 %"}),
        ({"c_N_per_mm": estimate(2.93, 0.05)}, {"c within 1.5 %", "interval of c holds"}),
        ({"clock_offset_s": estimate(-0.156, 0.02)}, {"clock within 5 ms"}),
        ({"presses_accepted": ["p1"]}, {"no good press lost"}),
        ({"presses_rejected": [{"press": "p2", "reason": "footprint"}]}, {"every bad press named"}),
    ],
)
def test_each_miss_is_counted(tmp_path: Path, changes: dict[str, Any], missed: set[str]) -> None:
    one = scored(recording(tmp_path / "a"), found(**changes))
    assert {what for what, _, does in ASKED if not does(one)} == missed


def keep(results: Path, **changes: Any) -> None:
    results.mkdir(parents=True)
    (results / "calibration.json").write_text(json.dumps(found(**changes)))


def test_calibrations_of_these_sources_are_not_made_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recording(tmp_path / "a")
    kept = tmp_path / "results" / revision(read.ROOT) / f"a-{content(folder)}"
    keep(kept, c_N_per_mm=estimate(2.9, 0.05))
    report([folder], results=tmp_path / "results")
    said = capsys.readouterr().out
    assert "| a | 0.4500 | -0.0040 ± 0.0051 | +0.5 % | -3.3 % ! | +1.5 ms | 2 of 2 | 2 of 2 |" in said
    assert "c within 1.5 %: 0 of 1" in said


def test_calibrations_of_other_sources_are_not_taken_for_these(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    keep(tmp_path / "results" / "a", c_N_per_mm=estimate(2.9, 0.05))
    keep(tmp_path / "results" / "0123456789ab" / "a", c_N_per_mm=estimate(2.9, 0.05))

    def calibrate(command: list[str], **_: object) -> None:
        keep(Path(command[-1]))

    monkeypatch.setattr("subprocess.run", calibrate)
    report([recording(tmp_path / "a")], results=tmp_path / "results")
    assert "c within 1.5 %: 1 of 1" in capsys.readouterr().out


def test_a_calibration_of_another_recording_of_the_same_name_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = (recording(tmp_path / day / "a") for day in ("monday", "tuesday"))
    (other / "forces.csv").write_text("time_s,fx_N,fy_N,fz_N\n0,0,0,0\n")
    made = []

    def calibrate(command: list[str], **_: object) -> None:
        made.append(Path(command[-1]))
        keep(made[-1])

    monkeypatch.setattr("subprocess.run", calibrate)
    report([one, other, one], results=tmp_path / "results")
    assert len(made) == 2


def test_a_revision_changes_with_any_source(tmp_path: Path) -> None:
    (tmp_path / "calibration").mkdir()
    source = tmp_path / "calibration" / "law.py"
    source.write_text("BETA = 1")
    before = revision(tmp_path)
    source.write_text("BETA = 2")
    assert revision(tmp_path) != before
