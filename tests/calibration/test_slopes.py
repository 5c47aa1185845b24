"""Slopes beside the faces against certified depths: gain, drift and a ceiling are named; sound slopes are not."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from made_presses import indenter, observations

from calibration.diagnosis.forward_selection import forward_selection
from calibration.diagnosis.vision_depth_check import fit_vision_depth, in_picture
from calibration.effects.cast_shadow import CastShadow
from calibration.inputs.conditions import covariates
from calibration.inputs.observations import EdgeDrop, Observations
from calibration.report.diagnosis_report import shown_size
from calibration.report.headline import fall_sentence
from calibration.report.misfit import error_fall_of_picture
from calibration.tasks.compare import compare
from calibration.tasks.diagnose import diagnose
from tactilevision.mechanics.profile import PunchCase, seen_profile
from tactilevision.mechanics.tables.punch import profile_model
from tactilevision.plots.misfit import draw_error_fall
from tactilevision.records.measured import Floats

DEPTHS = np.tile([0.18, 0.27, 0.36, 0.45], 3)
EDGES = np.geomspace(0.4, 1.25, 5)
FINE = 12  # steps of a ring over which a ceiling acts on the local slope


def seen(seed: int, *, gain: Floats | float = 1.0, ceiling: float = np.inf) -> Observations:
    """Twelve presses of a gel of friction .25: faces with walls read 2 % low, rings with 2 % noise of a press."""
    rng = np.random.default_rng(seed)
    size = DEPTHS.size
    data = observations(
        [np.array([d]) for d in DEPTHS],
        [indenter(f"A{k % 4}") for k in range(size)],
        time_s=[np.array([7.0 * k]) for k in range(size)],
    )
    factor = gain * (1 + 0.01 * rng.standard_normal(size))
    falls = []
    for k, depth in enumerate(DEPTHS):
        for azimuth in (0, 90, 180, 270):
            quarter = 1.03 if azimuth < 90 else 0.98
            for begin, end in pairwise(EDGES):
                fall = factor[k] * quarter * _fall(depth, (begin, end), ceiling)
                noise = 5e-4 * rng.standard_normal()
                ends = float(f"{begin:.2f}"), float(f"{end:.2f}")
                falls.append(EdgeDrop(0, data.presses.label[k], azimuth, *ends, fall + noise, 0.05, 0.6))
    walls = np.tanh(1.5 * DEPTHS / ceiling) / (1.5 * DEPTHS / ceiling) if np.isfinite(ceiling) else 1.0
    face = DEPTHS * factor * walls * 0.98 + 0.002 * rng.standard_normal(size)
    return replace(
        data, depth_source="gauge", reconstructed_mm=face, reconstructed_std_mm=0.05 * face, falls=tuple(falls)
    )


def _fall(depth: float, ring: tuple[float, float], ceiling: float) -> float:
    """mm, of slopes no steeper than the light shows them."""
    places = np.linspace(*ring, FINE + 1)
    model = profile_model(0.48, 2.5 / 3, deepest=depth / 3)
    rise = depth * seen_profile(1 + places / 2.5, PunchCase(0.48, 2.5 / 3, depth / 3, 0.25), source=model.source)
    slope, step = np.diff(rise) / np.diff(places), np.diff(places)
    return float(np.sum(step * (ceiling * np.tanh(slope / ceiling) if np.isfinite(ceiling) else slope)))


@pytest.mark.parametrize(
    ("key", "fault", "truth"),
    [
        pytest.param("photometric_gain", {"gain": 0.75}, -0.25, marks=pytest.mark.slow),
        pytest.param("photometric_drift", {"gain": 1 - 0.15 * np.arange(12) / 11}, -0.15, marks=pytest.mark.slow),
        pytest.param("slope_saturation", {"ceiling": 0.35}, 1 / 0.35, marks=pytest.mark.slow),
    ],
)
def test_what_is_wrong_with_slopes_is_named_with_its_size(key: str, fault: dict[str, Any], truth: float) -> None:
    fitted = fit_vision_depth(seen(3, **fault))
    assert fitted is not None
    found = forward_selection(fitted, in_picture(fitted.data), rng=np.random.default_rng(0), level=0.025)
    assert [step.best.effect.key for step in found.steps] == [key]
    first = found.steps[0].best.effect.parameters[0].name
    low, high = found.current.estimate(f"{key}.{first}").interval95 or (0.0, 0.0)
    assert low < truth < high
    assert low > 0 or high < 0


def shaded(seed: int) -> Observations:
    """Gel that a lamp does not reach reads .2 w steeper, out to 2.6 w - .2 mm beside the face."""
    sound = seen(seed)
    deep = dict(zip(sound.presses.label, sound.depth_mm, strict=True))
    falls = [
        replace(f, fall_mm=f.fall_mm + 0.2 * deep[f.press] * _dark(deep[f.press], f) * (f.to_mm - f.from_mm))
        for f in sound.falls
    ]
    return replace(sound, falls=tuple(falls))


@pytest.mark.slow
def test_shadows_beside_faces_are_named() -> None:
    fitted = fit_vision_depth(shaded(7))
    assert fitted is not None
    found = forward_selection(fitted, in_picture(fitted.data), rng=np.random.default_rng(0), level=0.025)
    assert [step.best.effect.key for step in found.steps] == ["cast_shadow"]
    assert found.current.estimate("cast_shadow.reach").value == pytest.approx(2.6, rel=0.3)


def test_shadows_are_cured_by_leaving_out_what_a_wall_may_shade_or_not_at_all() -> None:
    force = 0.9 * DEPTHS * (1 + 0.8 * DEPTHS / 3) * (1 + 2e-3 * np.resize([1, -1, 0], DEPTHS.size))
    dark = shaded(7).with_force(force)
    treated = CastShadow().treat(dark)
    depth_mm = dict(zip(dark.presses.label, dark.depth_mm, strict=True))
    inside = [fall for fall in dark.falls if fall.from_mm < 4.1 * depth_mm[fall.press] - 0.35]
    assert inside
    assert set(treated.falls) == set(dark.falls) - set(inside)
    cured = compare(dark, ["cast_shadow"], rng=np.random.default_rng(0))
    as_read, after = (model.held_out_N for model in cured.pictured)
    assert after < 0.5 * as_read
    assert cured.pictured[1].parameters == ()
    (fall,) = error_fall_of_picture(cured.pictured)
    assert dark.reconstructed_mm is not None
    faces = float(np.sqrt(np.mean((dark.reconstructed_mm - DEPTHS) ** 2)))
    assert fall.faces == pytest.approx((faces, faces)), "shadows beside them leave the faces alone"
    assert f"{1e3 * faces:.1f}" in fall_sentence(fall)
    labels = [one.get_text() for one in draw_error_fall(fall).legends[0].get_texts()]
    assert {"the faces", "the gel outside the faces"} <= set(labels)
    deep = replace(dark, falls=tuple(fall for fall in dark.falls if fall in inside))
    left = compare(deep, ["cast_shadow"], rng=np.random.default_rng(0))
    assert left.left_out[0][0] == "cast_shadow"


def _dark(depth_mm: float, fall: EdgeDrop) -> float:
    """Share of a ring in shadow, its places drawn one by one."""
    places = np.linspace(fall.from_mm, fall.to_mm, FINE)
    return float(np.mean(places < 2.6 * depth_mm - 0.2))


@pytest.mark.slow
def test_a_lamp_that_fades_is_named_by_its_side() -> None:
    sound = seen(8)
    order = {label: k / 11 for k, label in enumerate(sound.presses.label)}

    def read(fall: EdgeDrop) -> float:
        return float(fall.fall_mm * (1 - 0.3 * np.cos(np.deg2rad(fall.azimuth_deg)) * order[fall.press]))

    fitted = fit_vision_depth(replace(sound, falls=tuple(replace(f, fall_mm=read(f)) for f in sound.falls)))
    assert fitted is not None
    found = forward_selection(fitted, in_picture(fitted.data), rng=np.random.default_rng(0), level=0.025)
    assert [step.best.effect.key for step in found.steps] == ["lamp_fading"]


def test_effects_beside_faces_leave_faces_alone_and_vanish_when_off() -> None:
    fitted = fit_vision_depth(seen(4))
    assert fitted is not None
    data = fitted.data
    assert data.slopes is not None
    face = np.isnan(data.slopes.slope)
    for key in ("cast_shadow", "lamp_fading"):
        effect = {one.key: one for one in in_picture(data)}[key]
        assert not effect.missing(data)
        off = np.array([p.default for p in effect.parameters])
        np.testing.assert_allclose(effect.inner.seen(data.depth_mm, off, data), data.depth_mm)
        on = effect.inner.seen(data.depth_mm, effect.starts(data)[0] * 3, data)
        np.testing.assert_array_equal(on[face], data.depth_mm[face])
        assert (on[~face] != data.depth_mm[~face]).any()


def test_sound_slopes_accuse_nobody_and_are_looked_at_by_slope_and_azimuth() -> None:
    fitted = fit_vision_depth(seen(4))
    assert fitted is not None
    assert {"slope", "azimuth beside the face", "order", "w"} <= {c.name for c in covariates(fitted.data)}
    found = forward_selection(fitted, in_picture(fitted.data), rng=np.random.default_rng(0), level=0.025)
    assert not found.steps
    assert found.last.lack_of_fit > 0.005


@pytest.mark.slow
def test_five_presses_are_too_few_for_slopes() -> None:
    data = seen(5).take(np.arange(3))
    both = fit_vision_depth(replace(data, reconstructed_mm=data.depth_mm))
    assert both is None, "three faces alone are too few, too"
    five = fit_vision_depth(seen(5).take(np.arange(5)))
    assert five is not None
    assert five.data.slopes is None
    six = fit_vision_depth(seen(5).take(np.arange(6)))
    assert six is not None
    assert six.data.slopes is not None
    kept = {data.presses.label[0]}
    one = replace(seen(5), falls=tuple(f for f in seen(5).falls if f.press in kept))
    alone = fit_vision_depth(one)
    assert alone is not None
    assert alone.data.slopes is None


@pytest.mark.slow
def test_a_zero_of_the_map_moves_no_slope() -> None:
    fitted = fit_vision_depth(seen(6))
    assert fitted is not None
    slopes = fitted.data.slopes
    assert slopes is not None
    moved = fitted.model.slope(fitted.values, fitted.data)
    beside = np.isfinite(slopes.slope)
    np.testing.assert_allclose(moved[beside], 0, atol=1e-9)
    assert (np.abs(moved[~beside] - 1) < 0.2).all()


@pytest.mark.slow
def test_a_ceiling_of_slopes_has_no_unit_and_moves_no_certified_depth() -> None:
    data = seen(4).take(np.arange(8))
    pressed = data.with_force(0.9 * data.depth_mm * (1 + 0.8 * data.depth_mm / 3) + 1e-3 * np.resize([1, -1], 8))
    found = diagnose(pressed, np.random.default_rng(0))
    assert found.as_json()["smallest_visible_unit"]["slope_saturation"] == "1"
    assert 0 < found.limits.visible["slope_saturation"] < 8
    assert not shown_size(found, "slope_saturation").endswith("mm")
    assert found.limits.below_visibility["slope_saturation"] == 0
