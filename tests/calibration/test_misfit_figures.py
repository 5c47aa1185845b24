"""The numbers behind the figures of a misfit: whose residual, against what, on which scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_presses import indenter, observations
from scipy.stats import chi2
from test_screen import MODEL

from calibration.effects import get_effect
from calibration.effects.depth_zero import DepthZero
from calibration.fit.least_squares import Fit
from calibration.inputs.conditions import true_repeats
from calibration.inputs.deadline import Deadline
from calibration.inputs.observations import Observations
from calibration.report.headline import fall_lead, fall_note
from calibration.report.misfit import (
    error_fall_of_comparison,
    force_curves,
    residual_strips,
)
from calibration.tasks.compare import Comparison, compare
from tactilevision.errors import InputError
from tactilevision.records.measured import Floats
from tactilevision.records.misfit import ForceCurves

ZERO_MM = 0.03  # planted
LAW = np.array([0.2, 0.48, 0.6, 0.85])


def presses(count: int = 12) -> Observations:
    """Two radii in turn, made in the reverse of the order in which they stand, down and up again."""
    depth = np.concatenate([np.linspace(0.03, 0.6, 9), np.linspace(0.54, 0.03, 6)])
    phase = ["load"] * 9 + ["unload"] * 6
    data = observations(
        [depth] * count,
        [indenter(f"R{k % 2}", 1.5 + k % 2) for k in range(count)],
        time_s=[300.0 * k + np.linspace(0, 3, depth.size) for k in range(count)],
        phase=[phase] * count,
    )
    return replace(data, presses=replace(data.presses, order=np.arange(float(count))[::-1]))


def noisy(data: Observations, force_N: Floats, rng: np.random.Generator) -> Observations:
    """4 mN a sample and .5 % of the force a press."""
    gain = 0.005 * rng.standard_normal(data.count)
    return data.with_force(force_N * (1 + gain[data.press]) + 0.004 * rng.standard_normal(data.size))


@pytest.fixture(scope="module")
def found() -> Comparison:
    data, effect = presses(), DepthZero()
    model = MODEL + effect
    values = np.append(LAW, 0.0)
    values[model.slices(data)[effect.key]] = ZERO_MM
    seen = noisy(data, model.predict(values, data), np.random.default_rng(3))
    return compare(seen, ["depth_zero"], rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def fits(found: Comparison) -> dict[str, Fit]:
    return {" + ".join(("law", *one.effects)): one.fitted for one in found.models}


@pytest.fixture(scope="module")
def curves(fits: dict[str, Fit]) -> ForceCurves:
    return force_curves(fits)


def test_curves_hold_every_sample_once_in_the_order_of_pressing(curves: ForceCurves, fits: dict[str, Fit]) -> None:
    data = fits["law"].data
    assert [one.label for one in curves.presses] == [f"p{k}" for k in range(12)][::-1]
    assert sum(one.measured_N.size for one in curves.presses) == data.size
    assert curves.radii_mm == (1.5, 2.5)
    assert curves.whole
    for one in curves.presses:
        rows = data.press == data.presses.label.index(one.label)
        assert one.time_s[0] == 0
        np.testing.assert_array_equal(one.measured_N, data.normal_N[rows])
        for model, fitted in enumerate(fits.values()):
            np.testing.assert_array_equal(one.residual_N[model], fitted.residual_N[rows])
        assert set(one.phase) == {"load", "unload"}
    squares = sum(one.rms_N**2 * one.measured_N.size for one in curves.presses)
    assert np.sqrt(squares / data.size) == pytest.approx([one.rms_error_N for one in fits.values()])


def test_the_most_telling_presses_keep_their_order(curves: ForceCurves) -> None:
    kept = curves.most_changed(3)
    fall = {one.label: abs(one.rms_N[0] - one.rms_N[1]) for one in curves.presses}
    assert {one.label for one in kept} == set(sorted(fall, key=fall.__getitem__)[-3:])
    labels = [one.label for one in curves.presses]
    assert [labels.index(one.label) for one in kept] == sorted(labels.index(one.label) for one in kept)


def test_strips_are_sorted_by_evidence_and_share_one_scale(found: Comparison, fits: dict[str, Fit]) -> None:
    shown = residual_strips(fits, [one.covariates for one in found.models])
    assert len(shown.strips) > 2
    p = [strip.p_adjusted[0] for strip in shown.strips]
    assert p == sorted(p)
    assert len({"w", "w/h", "1/w"} & {strip.name for strip in shown.strips}) == 1, "the depth is shown once"
    assert shown.reach_N == pytest.approx(np.quantile(np.abs(shown.residual_N), 0.98))
    first = shown.strips[0]
    swing_N = np.ptp(first.mean_N, axis=1)
    assert swing_N[1] < 0.3 * swing_N[0], "the effect takes the pattern off"
    way = next(strip for strip in shown.strips if strip.name == "load/unload")
    assert [way.levels[round(value)] for value in way.centre] == ["load", "unload"]
    mask = way.values == 2
    np.testing.assert_allclose(way.mean_N[:, 1], [fitted.residual_N[mask].mean() for fitted in fits.values()])


def test_the_error_falls_to_the_band_of_the_repeatability(found: Comparison) -> None:
    fall = error_fall_of_comparison(found)
    assert fall.models == ("base model", "+ depth zero")
    assert fall.held_out
    assert fall.error == tuple(one.held_out_N for one in found.models)
    assert fall.error[1] < 0.5 * fall.error[0]
    repeats = true_repeats(found.stated)
    assert repeats is not None
    assert fall.band == repeats.interval95
    assert fall.band[0] < fall.repeatability < fall.band[1]
    dof = 12 - 2  # two radii
    assert fall.band[0] == pytest.approx(fall.repeatability * np.sqrt(dof / chi2.isf(0.025, dof)))
    assert 0.9 < fall.removed <= 1
    assert fall_lead(fall).endswith(
        f"depth zero removes {100 * fall.removed:.0f} % of the error that can be removed"
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_scatter_of_repeats_is_what_was_planted_whatever_the_curve(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth, count = np.linspace(0.05, 0.6, 40), 16
    data = observations([depth] * count, [indenter()] * count, time_s=[60.0 * k + depth for k in range(count)])
    each, common = 0.02 * rng.standard_normal(count)[data.press], np.exp(3 * data.depth_mm)  # no contact law
    repeats = true_repeats(data.with_force(common + each))
    assert repeats is not None
    assert (repeats.presses, repeats.groups) == (count, 1)
    assert repeats.std == pytest.approx(np.std(each[data.first], ddof=1), rel=1e-3)


def test_where_no_press_is_repeated_there_is_no_band(found: Comparison) -> None:
    data = found.stated
    assert true_repeats(data.take([0, 1])) is None, "one degree of freedom"
    places = replace(data.presses, x_mm=np.arange(float(data.count)))
    assert true_repeats(replace(data, presses=places)) is None
    fall = replace(error_fall_of_comparison(found), repeatability=float("nan"), band=None)
    assert not np.isfinite(fall.removed)
    assert "%" not in fall_lead(fall)
    assert "no press is repeated" in fall_note(fall)


def test_fits_of_other_presses_are_refused(fits: dict[str, Fit]) -> None:
    one = fits["law"]
    fewer = replace(one, data=one.data.take([0, 1]))
    with pytest.raises(InputError, match="different presses"):
        force_curves({"a": one, "b": fewer})
    with pytest.raises(InputError, match="no model"):
        force_curves({})


@pytest.mark.slow
def test_backlash_is_suggested_and_added_by_its_key() -> None:
    """Lost motion of 20 um: the depth reads otherwise on the way back."""
    data, effect = presses(6), get_effect("backlash")
    model = MODEL + effect
    force = model.predict(np.append(LAW, 0.02), data)
    seen = noisy(data, force, np.random.default_rng(4))
    alone = compare(seen, [], rng=np.random.default_rng(0))
    assert alone.suggested[0] == "backlash"
    found = compare(seen, [alone.suggested[0]], rng=np.random.default_rng(0))
    assert found.suggested == ()
    low, high = dict(found.models[1].parameters)["backlash.size_mm"].interval95 or (0.0, 0.0)
    assert low < 0.02 < high
    assert found.models[1].held_out_N < 0.5 * found.models[0].held_out_N
    material = found.models[1].material
    assert material is not None
    assert material.youngs_modulus.value == pytest.approx(0.2, rel=0.02)


@pytest.mark.slow
def test_no_effect_is_added_after_the_time() -> None:
    data = presses(4)
    seen = noisy(data, MODEL.predict(LAW, data), np.random.default_rng(5))
    late = compare(seen, ["depth_zero"], rng=np.random.default_rng(0), deadline=Deadline(0.0))
    assert late.left_out == (("depth_zero", "the time was over"),)
    assert len(late.models) == 1
    assert not Deadline.after(None).passed
    assert not Deadline.after(60).passed
