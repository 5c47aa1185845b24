"""Recordings with faults are made as the literature has them, and answers are counted rightly."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from benchmarks.experimenter import __main__ as command, faults, judge
from benchmarks.experimenter.design import Gel
from benchmarks.experimenter.named import RIGHT
from benchmarks.experimenter.recording import KINDS, TESTABLE, make, straight_law
from benchmarks.others_curves.noise import Reader
from benchmarks.others_curves.protocol import Press, Protocol
from tactilevision.recording.read import read_recording

WHITE = Reader(0.004, 0.0, 0.004, 0.003, 0.0, np.inf, np.inf, 0.0, stated=True)


def scene(*radii_mm: float, way_s: float = 5.0, hold_s: float = 60.0) -> faults.Scene:
    """Presses of .4 mm into 3 mm of gel, one of each radius, held and taken back."""
    presses = list[Press]()
    for k, radius in enumerate(radii_mm):
        corners = np.array(
            [[0, 1, 1 + way_s, 1 + way_s + hold_s, 1 + 2 * way_s + hold_s], [0, 0, 0.4, 0.4, -0.05]]
        )
        corners[1, :2] = -0.05
        time = np.unique(np.concatenate([corners[0], np.linspace(0, corners[0, -1], 120)]))
        depth = np.interp(time, *corners)
        phase = ("load",) * time.size
        presses.append(
            Press(radius, 100.0 * k + time, depth, phase, corners, 30.0, 0.1, hold_s, (0.0, 0.0), 0, 22.0)
        )
    gel = Gel(0.25, 0.48, 0.9, 3.0, {radius: radius for radius in radii_mm})
    return faults.Scene(gel, Protocol(tuple(presses), 3.0))


def strength(made: faults.Scene, kind: str, **sizes: float) -> float:
    """Std of a fault in these presses."""
    read = [faults.FAULTS[kind][0](made, k, sizes) for k in range(len(made.plan.presses))]
    return straight_law(made.gel, made.plan, WHITE, read, nu_std=0.005).leaves()[0]


@each("kind", KINDS[::5])
def test_a_seed_makes_one_recording_that_can_be_read(kind: str, tmp_path: Path) -> None:
    made = [make(tmp_path / name, kind, 3) for name in ("a", "b")]
    assert made[0] == made[1]
    assert (tmp_path / "a/curves.csv").read_bytes() == (tmp_path / "b/curves.csv").read_bytes()
    assert 8 <= len(read_recording(tmp_path / "a").curves) == made[0].presses <= 40
    assert (made[0].strength == 0) == (kind == "clean")


def test_drainage_takes_a_time_that_goes_as_the_radius_squared() -> None:
    """Of a step: half has drained at D t / a^2 = .256, where the published g is one half."""
    made, sizes = scene(1.0, 2.0, way_s=0.01, hold_s=12.0), {"drains": 0.1, "diffusivity_mm2_s": 0.4}
    half_s = []
    for k in (0, 1):
        press, _, _, elastic = made.sound(k)
        _, force = faults.poroelastic(made, k, sizes)
        held = np.flatnonzero(press.depth_mm >= 0.4)
        left = (force[held] / elastic[held] - 0.9) / 0.1
        half_s.append(np.interp(-0.5, -left, press.time_s[held] - press.time_s[held[0]]))
    np.testing.assert_allclose(half_s, [0.256 / 0.4, 4 * 0.256 / 0.4], rtol=0.03)
    np.testing.assert_allclose(faults.drainage(np.array([0.0, 0.256])), [1.0, 0.5], atol=2e-3)


def test_a_filter_lags_by_its_time_constant_and_creep_is_a_share_of_the_load() -> None:
    made = scene(1.0)
    press, t, _, elastic = made.sound(0)
    _, late = faults.low_pass(made, 0, {"filter_s": 0.2})
    middle = (t > 4) & (t < 5)
    slope = np.gradient(elastic, t)
    np.testing.assert_allclose((elastic - late)[middle], 0.2 * slope[middle], rtol=0.05)
    _, crept = faults.sensor_creep(made, 0, {"creep": 0.03, "settles_s": 2.0})
    end = np.flatnonzero(press.depth_mm >= 0.4)[-1]
    assert crept[end] / elastic[end] == pytest.approx(1.03, abs=1e-4)


def test_a_tilted_face_meets_the_whole_one_in_value_and_slope() -> None:
    made, tilt = scene(2.0), 0.01
    edge = 2 * 2.0 * tilt
    press = made.plan.presses[0]
    near = np.array([edge - 1e-4, edge, edge + 1e-4])
    moved = Press(2.0, press.time_s[:3], near, ("load",) * 3, press.corners, 1.0, 1.0, 1.0, (0.0, 0.0), 0, 22.0)
    one = faults.Scene(made.gel, Protocol((moved,), 3.0))
    _, force = faults.tilt_soft_frame(one, 0, {"tilt_rad": tilt, "give_mm_per_N": 0.0})
    np.testing.assert_allclose(force, made.gel.force_N(press, near), rtol=1e-5)


def test_strength_grows_with_the_size_and_what_the_law_absorbs_has_none() -> None:
    three, one = scene(1.0, 1.5, 2.5), scene(1.5)
    assert strength(three, "force_not_tared", force_N=0.0) == 0
    single, double = (strength(three, "force_not_tared", force_N=b) for b in (0.1, 0.2))
    assert double == pytest.approx(2 * single, rel=1e-6)
    assert single > TESTABLE
    assert strength(one, "wrong_thickness", thinner=0.2) < 0.3  # E, beta and nu take all of it
    assert strength(three, "wrong_thickness", thinner=0.2) > TESTABLE


def test_a_gel_that_is_thinner_by_a_known_share_moves_the_stiffness_as_published() -> None:
    """1 % of the thickness is .93 % of E at nu .4797, a/h 2.5/3."""
    gel = Gel(0.2, 0.4797, 0.9, 3.0, {2.5: 2.5})
    press, shallow = scene(2.5).plan.presses[0], np.array([1e-6])
    ratio = gel.force_N(press, shallow, thickness_mm=2.97) / gel.force_N(press, shallow)
    assert float(ratio[0]) == pytest.approx(1.0093, abs=3e-4)


def row(kind: str, *, covered: bool, flags: tuple[str, ...] = (), **diagnosis: Any) -> dict[str, Any]:
    """An answer as the log has it."""
    of: dict[str, Any] = {
        "verdict": "IDENTIFIED",
        "effects": [],
        "candidates": [],
        "depends_on": [],
        "flags": [],
    }
    shared = {"interval_MPa": [0.2, 0.3], "covered": covered, "cpu_s": 1.0}
    return {
        "kind": kind,
        "seed": 1,
        "sizes": {},
        "strength": 0.0 if kind == "clean" else 9.0,
        "off_E": 0.1,
        "stated": {"tolerances": [0.0, 0.0]},
        "calibrate": shared | {"flags": list(flags)},
        "diagnose": shared | of | {"wanders": []} | diagnosis,
    }


def test_answers_are_counted() -> None:
    right = row("contact_late", covered=True, effects=["depth_zero"], candidates=["depth_zero", "force_bias"])
    wrong = row("contact_late", covered=False, effects=["tilt"], candidates=["tilt"])
    among = row(
        "gent", covered=True, flags=("model_insufficient",), verdict="AMBIGUOUS", candidates=["stiffening"]
    )
    open_set = row("swelling", covered=False, flags=("few_presses",), verdict="UNKNOWN")
    failed = row("gent", covered=False) | {"diagnose": {"failed": "RAISED x", "covered": False, "cpu_s": 1.0}}
    rows = [right, wrong, among, open_set, failed]
    assert [*map(judge.named, rows)] == [True, False, True, True, False]
    assert [*map(judge.sure_and_wrong, rows)] == [False, True, False, False, False]
    assert [*map(judge.silent_and_wrong, rows)] == [False, True, False, True, True]
    quiet = row("backlash", covered=True) | {"strength": 1.0}
    text = judge.report([*rows, quiet, row("clean", covered=True, verdict="ADEQUATE")])
    assert next(line for line in text.splitlines() if "silent and wrong" in line).count("3 of    5") == 1
    assert "not testable: backlash 1" in text
    assert set(RIGHT) == set(faults.FAULTS)


def test_what_is_in_the_log_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[tuple[str, int]] = []

    def look(kind: str, seed: int, *, calibrate_only: bool) -> dict[str, Any]:
        looked.append((kind, seed))
        return row(kind, covered=True) | {"seed": seed, "calibrate_only": calibrate_only, "presses": 9}

    monkeypatch.setattr(judge, "look", look)
    log = tmp_path / "log.jsonl"
    for count in (1, 2):
        command.main(["--kinds", "gent,backlash", "--count", str(count), "--clean", "1", "--log", str(log)])
    assert looked == [("gent", 1), ("backlash", 1), ("clean", 1), ("gent", 2), ("backlash", 2)]
    assert len({json.dumps(json.loads(line)) for line in log.read_text().splitlines()}) == 5
