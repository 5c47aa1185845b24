"""The independent generator agrees with published figures, and a run that was cut goes on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from each import each

from benchmarks.others_curves import __main__ as command
from benchmarks.others_curves.judge import _held, exact
from benchmarks.others_curves.law import kappa, kappa_between, rounded
from benchmarks.others_curves.recording import KINDS, make
from benchmarks.others_curves.strength import SEEN
from calibration.diagnosis.refit import adopt, refit_with
from calibration.effects import EFFECTS
from calibration.inputs.checks import clear_of_touch, usable
from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured
from calibration.tasks.compare import base_fit, base_model
from calibration.tasks.diagnose import diagnose
from tactilevision.recording.read import read_recording


@pytest.mark.parametrize(("nu", "a_over_h", "published"), [(0.45, 0.3, 1.414098), (0.45, 0.4, 1.599276)])
def test_the_stiffness_is_that_of_hayes(nu: float, a_over_h: float, published: float) -> None:
    assert kappa(nu, a_over_h) == pytest.approx(published, abs=2e-6)


def test_a_rounded_face_ends_as_a_flat_one() -> None:
    radius, share = rounded(np.array([0.0, 0.02, 0.4]), 2.0, 0.1)
    assert radius[0] == pytest.approx(1.9)
    assert radius[0] < radius[1] < radius[2] < 2
    assert share[0] < share[1] < share[2] < 1


def test_a_contact_that_grows_stiffens_without_steps() -> None:
    """Ratios once rounded to .01 drew steps of .7 % into the force of a rounded edge."""
    grown = np.linspace(0.473, 0.5, 10)
    exact = [kappa(0.48, float(one)) for one in grown]
    np.testing.assert_allclose(kappa_between(0.48, grown, ends=(0.47, 0.5)), exact, rtol=1e-6)


@each("kind", KINDS)
def test_a_seed_makes_one_recording_that_can_be_read(kind: str, tmp_path: Path) -> None:
    seed = 7 if kind == "near" else 3  # of the second recording that is drawn, one of up to 200
    names = ("a",) if kind == "near" else ("a", "b")  # each of the search's recordings takes as long as one
    made = [make(tmp_path / name, kind, seed, rich=False) for name in names]
    assert made[0].told == made[-1].told
    assert kind != "near" or (made[0].near and made[0].strength > SEEN)
    assert len(made[0].sizes) in {"clean": (0,), "pair": (2,), "allowed": (1, 2)}.get(kind, (1,))
    recording = read_recording(tmp_path / "a")
    assert len(recording.curves) == made[0].presses
    assert sum(curve.time_s.size for curve in recording.curves) == made[0].samples


def test_readings_leave_their_interval_where_what_is_hidden_is_larger_than_their_noise(tmp_path: Path) -> None:
    """95 % of them are held where nothing is; a jump of the zero takes them out, and a wider noise back in."""
    for kind, low, high in (("clean", 0.94, 0.96), ("outside", 0.3, 0.9)):  # a zero that drifts by 64 mN
        made = make(tmp_path / kind, kind, 7, rich=True)
        reader = made.reader
        own_N = np.hypot(reader.force_N, reader.depth_mm * made.slope_N_per_mm[made.force_N > 0])
        said = {
            "sample_mN": 1e3 * float(np.median(own_N)),
            "press_gain_percent": 100 * reader.gain,
            "press_zero_um": 1e3 * reader.zero_mm,
        }
        assert low < _held(made, said) < high
        assert _held(made, said | {"sample_mN": 100.0}) > 0.95


def test_what_hides_beside_another_effect_is_weaker_than_alone(tmp_path: Path) -> None:
    made = make(tmp_path, "pair", 610000, rich=True)  # a bias of the force and an ageing gel
    assert set(made.each) == set(made.sizes)
    assert min(made.each.values()) > 8
    assert max(made.each.values()) < made.strength


@pytest.mark.slow
def test_faces_that_never_let_go_show_adhesion_and_nothing_beside(tmp_path: Path) -> None:
    """The work that was found first, under a noise that knew of no clinging face, was far too small: UNKNOWN."""
    make(tmp_path, "single", 761239, rich=True)
    recording = read_recording(tmp_path)
    found = diagnose(observe_curves(Measured(recording, curves=recording.curves)), np.random.default_rng(7))
    assert (found.verdict, [effect.key for effect in found.effects]) == ("IDENTIFIED", ["adhesion"])


def test_the_interval_of_a_share_is_exact() -> None:
    low, high = exact(0, 300)
    assert low == 0.0
    assert high == pytest.approx(1 - 0.025 ** (1 / 300), rel=1e-6)
    assert exact(10, 10)[1] == 1.0


def test_what_is_in_the_log_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[int] = []

    def look(kind: str, seed: int, *, rich: bool, screen: bool, count: int) -> dict[str, object]:
        looked.append(seed)
        told = {"noise": "white", "stated": True, "presses": 9, "sizes": {}, "strength": 0.0, "cpu_s": 1.0}
        return {
            "kind": kind,
            "seed": seed,
            "rich": rich,
            "screen": screen,
            "count": count,
            "verdict": "ADEQUATE",
            **told,
        }

    monkeypatch.setattr(command, "look", look)
    log = tmp_path / "log.jsonl"
    for count in (2, 3):
        command.main(["--count", str(count), "--log", str(log)])
    assert looked == [1, 2, 3]
    assert [json.loads(line)["seed"] for line in log.read_text().splitlines()] == [1, 2, 3]


def test_a_touch_far_above_zero_is_found_under_the_noise_that_is_left(tmp_path: Path) -> None:
    """Readings of air stand in the gel there; from the first fit alone the next came to .016 of .029 mm."""
    made = make(tmp_path, "pair", 646069, rich=True)
    recording = read_recording(tmp_path)
    data = clear_of_touch(usable(observe_curves(Measured(recording, curves=recording.curves))))
    base = base_fit(base_model(data), data)
    fitted = adopt(base, refit_with(base, EFFECTS["depth_zero"]))
    assert fitted.values[-1] == pytest.approx(made.sizes["depth_zero"], abs=0.008)
