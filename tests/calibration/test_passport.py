"""Drift against scipy's and numpy's own lines, its false reports by chance alone, and passports from folders."""

from __future__ import annotations

import datetime
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each
from scipy.stats import linregress

from calibration.tasks.ageing import FIRST, Ageing, ageing, fit_line
from calibration.tasks.passport import Source, check_sources, relaxation
from tactilevision import result_folders
from tactilevision.cli import main
from tactilevision.errors import InputError
from tactilevision.pipeline import calibrate_each
from tactilevision.recording.model import Recording
from tactilevision.records.measured import Curve, Floats

BEGIN = datetime.date(2026, 1, 5)
DAYS: Floats = np.linspace(0, 77, 12)
TOML = """format = 1
name = "{name}"
date = {date}
[sensor]
kind = "gelslim3"
serial = "{serial}"
mm_per_px = [0.0634, 0.0634]
[sensor.gel]
thickness_mm = {thickness}
shape = "disc"
radius_mm = 15.0
[depth]
source = "gauge"
[indenter.A]
shape = "flat_cylinder"
radius_mm = 2.5
edge_radius_mm = 0.0
"""


def week(folder: Path, number: int, stiffness: float, *, serial: str = "07", thickness: float = 3.0) -> Path:
    """A recording of 12 presses whose P/w is a line over w/h; the truth is written down here."""
    place, rng = folder / f"week_{number:02d}{serial}{thickness:g}", np.random.default_rng(number)
    place.mkdir()
    told = {"name": place.name, "date": BEGIN + datetime.timedelta(7 * number)}
    (place / "recording.toml").write_text(TOML.format(**told, serial=serial, thickness=thickness))
    rows = ["press,indenter,depth_mm,fz_N"]
    for k, depth in enumerate([0.2, 0.35, 0.5, 0.65] * 3):
        force = stiffness * depth * (1 + 0.9 * depth / 3) * (1 + 0.003 * rng.standard_normal())
        rows.append(f"{k},A,{depth},{force:.5f}")
    (place / "points.csv").write_text("\n".join(rows) + "\n")
    return place


def dates_of(days: Floats) -> list[datetime.date]:
    return [BEGIN + datetime.timedelta(int(day)) for day in days]


def aged(log_c: Floats, std: float, *, dof: float = 10.0, tolerance: float = 0.05) -> Ageing:
    count = len(log_c)
    return ageing(dates_of(DAYS[:count]), log_c.tolist(), [std] * count, [dof] * count, tolerance=tolerance)


def test_the_line_is_that_of_scipy_where_scatter_rules_and_of_numpy_where_it_does_not() -> None:
    rng = np.random.default_rng(4)
    log_c = -0.001 * DAYS + 0.02 * rng.standard_normal(12)
    found, line = fit_line(DAYS, log_c, np.full(12, 1e-6), np.full(12, 1e9)), linregress(DAYS, log_c)
    assert found.rate == pytest.approx(line.slope, rel=1e-6)
    assert found.std == pytest.approx(line.stderr, rel=1e-6)
    assert found.dof == pytest.approx(10, rel=1e-6)
    assert found.p == pytest.approx(line.pvalue, rel=1e-6)
    std = rng.uniform(0.05, 0.2, 12)
    calm = fit_line(DAYS, log_c, std, np.full(12, 1e9))
    (slope, _), covariance = np.polyfit(DAYS, log_c, 1, w=1 / std, cov="unscaled")
    assert calm.scatter == 0.0
    assert (calm.rate, calm.std) == pytest.approx((slope, np.sqrt(covariance[0, 0])), rel=1e-6)


def test_chance_reports_few_steady_gels_and_nearly_all_that_age() -> None:
    """100 series of each, looked at after every recording; the level is of all looks together."""
    rng, wrong, right = np.random.default_rng(11), 0, 0
    fall = np.log1p(-0.08 * DAYS / DAYS[-1])
    for _ in range(100):
        noise = 0.01 * rng.standard_normal(12)
        wrong += aged(noise, 0.01, dof=1e6).reported is not None
        right += aged(noise + fall, 0.01, dof=1e6).reported is not None
    assert wrong <= 5
    assert right >= 98


def test_the_date_follows_from_the_drift_and_goes_no_further_than_the_data_reach() -> None:
    steep = aged(np.log1p(-0.02) * DAYS / 7, 1e-7)
    assert steep.change.value == pytest.approx(0.98**11 - 1, rel=1e-4)
    assert steep.rate.value == pytest.approx(-0.02, rel=1e-4)
    assert steep.recalibrate_by == dates_of(DAYS)[-1] + datetime.timedelta(int(7 * np.log(1.05) / -np.log(0.98)))
    flat = aged(np.zeros(12), 1e-4)
    assert flat.reported is None
    assert flat.recalibrate_by == dates_of(DAYS)[-1] + datetime.timedelta(77)
    assert "say nothing of later" in flat.why
    for few in (aged(np.zeros(2), 0.01), ageing([BEGIN] * 4, [0.0] * 4, [0.01] * 4, [9.0] * 4, tolerance=0.05)):
        assert (few.change.value, few.recalibrate_by) == (None, None)
        assert "a drift takes 3 recordings that determine c" in few.change.why
    assert FIRST == 3


WEEK = Source("gelslim3 07", BEGIN, "a", "1" * 64, 2, 3.0, 0.0)


@each(
    "other, said",
    [
        (replace(WEEK, sensor="gelslim3 08", sha256="2"), "one sensor, and a is of gelslim3 07"),
        (replace(WEEK, thickness_mm=2.9, sha256="2"), r"that of a is 3 mm thick.*2\.9 mm"),
        (replace(WEEK, date=BEGIN - datetime.timedelta(1), sha256="2"), "dates run backwards: a is of 2026-01-05"),
        (replace(WEEK, recording="again"), "named twice"),
    ],
)
def test_what_does_not_belong_together_is_refused(other: Source, said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_sources([WEEK, other])
    check_sources([WEEK, replace(WEEK, thickness_mm=2.9, thickness_std_mm=0.1, sha256="2")])


def test_relaxation_is_the_share_of_the_force_that_a_hold_loses() -> None:
    time_s = np.linspace(0, 10, 400)
    force = np.where(time_s < 1, 2 * time_s, 1.5 + 0.5 * np.exp(-(time_s - 1)))
    phase = np.where(time_s < 1, "load", "hold")
    curve = Curve("1", time_s, np.minimum(time_s, 1.0), np.stack([0 * force, 0 * force, force], axis=1), phase)
    held = np.array([1.0, 1.9, 9.1, 10.0])  # where the first and the last tenth begin and end
    begin, end = 1.5 + 0.5 * (np.exp(1 - held[::2]) - np.exp(1 - held[1::2])) / 0.9
    found = relaxation([curve] * 4)
    assert found.value == pytest.approx(1 - end / begin, rel=0.01)
    assert relaxation([curve] * 2).value is None


def run(*words: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        return main()


def test_a_ledger_goes_on_from_what_it_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weeks = [week(tmp_path, k, 3.6 * 0.95**k) for k in range(3)]
    out, ledger = tmp_path / "out", tmp_path / "gels.sqlite"
    calibrated = list[str]()

    def counted(opened: list[Recording], **how: Any) -> Any:
        calibrated.extend(one.name for one in opened)
        return calibrate_each(opened, test=False, **how)

    monkeypatch.setattr(result_folders, "calibrate_each", counted)
    assert run("passport", *weeks[:2], "--out", out, "--ledger", ledger) == 0
    assert json.loads((out / "passport.json").read_text())["change"]["value"] is None
    assert run("passport", weeks[2], "--out", out, "--ledger", ledger) == 0
    assert calibrated == [one.name for one in weeks]
    told = json.loads((out / "passport.json").read_text())
    assert [one["recording"] for one in told["history"]] == [one.name for one in weeks]
    assert told["change"]["value"] == pytest.approx(0.95**2 - 1, abs=0.02)
    assert told["change_reported"] == told["history"][2]["date"]
    assert told["next_calibration"]["date"] < "2026-01-26"
    page = (out / "passport.html").read_text()
    assert told["history"][0]["sha256"] in page
    assert "A change is reported since" in page
    capsys.readouterr()
    before, other = ledger.read_bytes(), tmp_path / "other"
    other.mkdir()
    for wrong, why in (
        (week(other, 1, 3.6, serial="08"), "one sensor"),
        (week(other, 9, 3.6, thickness=2.5), "one gel"),
        (week(other, 0, 9.9), "dates run backwards"),
    ):
        assert run("passport", weeks[2], wrong, "--out", out, "--ledger", ledger) == 2
        said = capsys.readouterr().err
        assert said.startswith("error: ")
        assert why in said
        assert said.count("\n") == 1
    assert ledger.read_bytes() == before


def test_a_passport_needs_a_date(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = week(tmp_path, 0, 3.6)
    text = (place / "recording.toml").read_text()
    (place / "recording.toml").write_text("\n".join(line for line in text.split("\n") if "date" not in line))
    assert run("passport", place, "--out", tmp_path / "out") == 2
    assert "Add date to recording.toml" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
