"""Reconstructed against certified depth: each fault of the picture is named, and a right picture is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_presses import indenter, observations
from test_effects import RICH

from calibration.diagnosis.vision_depth_check import fit_vision_depth, in_picture, sight_of
from calibration.effects import EFFECTS
from calibration.effects.in_picture import InPicture
from calibration.inputs.conditions import running_share
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.report.headline import fall_sentence
from calibration.report.misfit import error_fall_of_picture
from calibration.tasks.compare import compare
from calibration.tasks.diagnose import diagnose
from tactilevision.records.measured import Floats

LAW = np.array([0.2, 0.48, 0.8, 0.85, 0.9])
GAUGE = replace(RICH, depth_source="gauge")


def seen(picture: Floats, seed: int, data: Observations = GAUGE) -> Observations:
    """Forces of the plain law and a picture of these depths, with errors of each press and sample."""
    rng = np.random.default_rng(seed)
    gain, force_gain = (size * rng.standard_normal(data.count)[data.press] for size in (0.003, 0.005))
    zero = 0.004 * rng.standard_normal(data.count)[data.press]
    law = Model(FlatPunch())
    force = law.predict(LAW, data) * (1 + force_gain) + law.slope(LAW, data) * zero
    noisy = data.with_force(force + 0.004 * rng.standard_normal(data.size))
    return replace(noisy, reconstructed_mm=picture * (1 + gain) + 0.002 * rng.standard_normal(data.size))


@pytest.mark.parametrize(
    ("key", "picture", "candidates"),
    [
        pytest.param("photometric_gain", 1.02 * GAUGE.depth_mm, {"photometric_gain"}, marks=pytest.mark.slow),
        pytest.param(
            "bevel_rise",
            0.98 * GAUGE.depth_mm,
            {"photometric_gain", "bevel_rise"},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "photometric_drift",
            GAUGE.depth_mm * (1 + 0.02 * running_share(GAUGE)),
            {"photometric_drift"},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "slope_saturation",
            np.tanh(0.5 * GAUGE.depth_mm) / 0.5,
            {"slope_saturation"},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_is_wrong_with_the_picture_is_named(key: str, picture: Floats, candidates: set[str]) -> None:
    """A certified depth that forgot the rise looks like a gain below 0: the two stay one set."""
    found = diagnose(seen(picture, 1), np.random.default_rng(0))
    (named,) = (effect.key for effect in found.effects)
    assert named in candidates, f"of one set either may come first; {key} was planted"
    assert set(found.candidates) == candidates
    assert found.verdict == ("IDENTIFIED" if len(candidates) == 1 else "AMBIGUOUS")
    assert not candidates & set(found.limits.not_testable)
    low, high = found.material.after.youngs_modulus.interval95 or (0.0, 0.0)
    if key == "bevel_rise":
        assert high > 0.2 / 0.98, "E reaches up to what a forgotten rise would make of it"
        either = ("use an indenter whose bevel", "press a gauge")  # each parts the two
        assert found.measure_next[0].action.startswith(either)
    assert low < 0.2 < high


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))])
@pytest.mark.slow
def test_a_right_picture_is_left_alone(seed: int) -> None:
    found = diagnose(seen(GAUGE.depth_mm, seed), np.random.default_rng(0))
    assert found.verdict == "ADEQUATE", found.search.tried
    content = found.as_json()["reconstructed_depth"]
    assert content["ratio_median"] == pytest.approx(1, abs=0.01)
    assert 0 < found.limits.visible["photometric_gain"] < 0.01


def points(ratio: Floats, std: float) -> Observations:
    """Three presses each of five depths, as certified by frames."""
    depth = np.tile([0.14, 0.27, 0.37, 0.46, 0.55], 3)
    kinds = [indenter(f"A{k % 5}", height_std_mm=0.002) for k in range(15)]
    data = observations([np.array([d]) for d in depth], kinds, time_s=[np.array([10.0 * k]) for k in range(15)])
    rng = np.random.default_rng(3)
    picture = depth * ratio + 0.004 * rng.standard_normal(15)
    force = Model(FlatPunch()).predict(np.array([0.2, 0.48, 0.85]), data) * (1 + 0.003 * rng.standard_normal(15))
    return replace(
        data.with_force(force), depth_source="gauge", reconstructed_mm=picture, reconstructed_std_mm=std * picture
    )


def test_the_error_of_the_picture_falls_when_its_gain_is_added() -> None:
    """Read a fifth too small, with 4 um of noise; the forces have nothing to do with it."""
    data = points(np.full(15, 0.8), 0.05)
    found = compare(data, ["photometric_gain", "photometric_drift"], rng=np.random.default_rng(0))
    assert [model.effects for model in found.models] == [()]
    assert [model.effects for model in found.pictured][:2] == [(), ("photometric_gain",)]
    before, after = (model.held_out_N for model in found.pictured[:2])
    assert before == pytest.approx(0.2 * np.sqrt(np.mean(data.depth_mm**2)), rel=0.05)
    assert after < 0.1 * before
    low, high = dict(found.pictured[1].parameters)["photometric_gain.gain"].interval95 or (0.0, 0.0)
    assert low < -0.2 < high
    (fall,) = error_fall_of_picture(found.pictured)
    assert fall.unit == "mm"
    assert fall.models[:2] == ("as read", "+ photometric gain")
    assert fall.error[:2] == (before, after)


@pytest.mark.slow
def test_what_the_height_map_says_of_itself_accuses_nobody_and_what_is_beyond_it_does() -> None:
    depths = np.tile([0.14, 0.27, 0.37, 0.46, 0.55], 3)
    low = 1 - 0.2 * (depths - 0.14)  # a face that reads lower the deeper it is, by up to 8 %
    quiet = diagnose(points(low, 0.05), np.random.default_rng(0))
    assert quiet.verdict == "ADEQUATE"
    assert "balls would show it" in quiet.limits.not_testable["slope_saturation"]
    loud = diagnose(points(0.7 * low, 0.05), np.random.default_rng(0))
    assert [effect.key for effect in loud.effects] == ["photometric_gain"]
    interval = dict(loud.effects[0].parameters)["gain"].interval95
    assert interval is not None
    assert interval[0] < -0.3 < interval[1]


def test_without_a_picture_there_is_nothing_to_compare() -> None:
    assert fit_vision_depth(RICH) is None
    few = replace(RICH, reconstructed_mm=np.where(np.arange(RICH.size) < 3, RICH.depth_mm, np.nan))
    assert sight_of(few) is None


@each("effect", in_picture())
def test_switched_off_the_picture_is_the_depth(effect: InPicture) -> None:
    off = np.array([p.default for p in effect.parameters])
    np.testing.assert_array_equal(effect.inner.seen(GAUGE.depth_mm, off, GAUGE), GAUGE.depth_mm)
    for start in effect.starts(GAUGE):
        assert np.isfinite(effect.inner.seen(GAUGE.depth_mm, start, GAUGE)).all()


def test_a_pause_of_a_night_is_an_hour_of_drift() -> None:
    time = [np.array([0.0]), np.array([3600.0]), np.array([90000.0]), np.array([93600.0])]
    data = observations([np.array([0.3])] * 4, [indenter()] * 4, time_s=time)
    np.testing.assert_allclose(running_share(data), [0, 1 / 3, 2 / 3, 1])


def test_a_known_gain_of_the_picture_is_not_named_again_nor_put_into_the_force() -> None:
    data = points(np.full(15, 0.8), 0.05)
    found = diagnose(data, np.random.default_rng(0), known=[EFFECTS["photometric_gain"]])
    assert found.effects == ()
    assert "photometric_gain" not in found.fits.fitted.model.keys
    assert found.search.sight is not None
    assert "photometric_gain" in found.search.sight.base.model.keys


def test_a_comparison_says_how_far_the_picture_is_off_before_anything_is_added() -> None:
    data = points(np.full(15, 0.8), 0.05)
    found = compare(data, [], rng=np.random.default_rng(0))
    (fall,) = error_fall_of_picture(found.pictured)
    assert fall.models == ("as read",)
    assert not fall.reached
    said = fall_sentence(fall)
    assert "µm. Error of the reconstructed depth on held-out presses; repeated presses scatter by" in said
    assert "faces" not in said, "nothing was read beside them"
