"""What no effect explains is described: its scatter, its scale, its press, its place in the height map."""

from __future__ import annotations

import numpy as np
import pytest
from made_presses import GEL
from test_effects import BASE, RICH
from test_screen import MODEL, TRUTH, measured, presses, pure

from calibration.diagnosis.covariates import change_point
from calibration.diagnosis.score_test import SCATTER, score_test
from calibration.diagnosis.unexplained import describe
from calibration.diagnosis.vision_depth_check import in_picture
from calibration.effects import EFFECTS
from calibration.fit.least_squares import fit
from calibration.fit.repeats import refit_with_pure_noise
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.noise.model import Scatter
from calibration.report.drawing import Surface, residual_map
from tactilevision.mechanics.profile import exact_profile
from tactilevision.records.maps import HeightMap


def test_a_wave_in_the_depth_is_measured_in_size_and_length() -> None:
    data = presses(16)
    wave = 0.03 * np.sin(2 * np.pi * data.depth_mm / 0.2)
    fitted = pure(measured(data, MODEL.predict(TRUTH, data) + wave, np.random.default_rng(0)))
    left = describe(fitted, score_test(fitted, (), rng=np.random.default_rng(0), draws=49).covariates)
    assert left.rms_N == pytest.approx(0.03 / np.sqrt(2), rel=0.5)
    assert 0.02 < left.length_mm < 0.12, "a sine's length scale lies below a quarter of its period"
    assert left.covariates[0].startswith(("w", "1/w"))


@pytest.mark.slow
def test_jumps_at_random_depths_show_in_the_scatter_and_heavy_tails_do_not() -> None:
    law, rng = Model(FlatPunch()), np.random.default_rng(2)
    clean = law.predict(BASE, RICH)
    loading = RICH.phase == "load"
    places = rng.uniform(0.1, 0.5, RICH.count)[RICH.press]
    drop = 0.04 * np.exp(-np.maximum(RICH.depth_mm - places, 0) / 0.05) * (RICH.depth_mm > places) * loading
    tails = 0.004 * rng.standard_t(3, RICH.size) / np.sqrt(3)
    found = []
    for force in (clean + tails, clean - drop + 0.004 * rng.standard_normal(RICH.size)):
        fitted = refit_with_pure_noise(fit(law, RICH.with_force(force)))
        seen = score_test(fitted, (), rng=np.random.default_rng(0), draws=99)
        found.append({c.key: c.p for c in seen.covariates}[SCATTER])
    assert found[0] > 0.05 > 0.01 > found[1]


def test_few_presses_cannot_show_scatter() -> None:
    assert not Scatter(presses(4)).seen


def test_a_protocol_that_runs_from_small_to_large_is_no_jump() -> None:
    """Slow presses first, fast ones after: what the rate does to them is no change at a press."""
    data = presses(20).take([k for k in range(20) if k % 2 == 0] + [k for k in range(20) if k % 2])
    force = MODEL.predict(TRUTH, data) * np.where(data.presses.speed_mm_s > 0.5, 1.04, 1.0)[data.press]
    assert change_point(pure(measured(data, force, np.random.default_rng(0))), np.random.default_rng(1)) is None


def drawn_surface(seed: int, tilt: float = 0.0) -> Surface:
    """The exact surface of a press of .4 mm in the middle of a picture, with 3 um of noise and a tilt (mm/mm)."""
    y, x = np.mgrid[-8:8:161j, -8:8:161j]
    r = np.hypot(x, y)
    rise, _ = exact_profile(np.maximum(r / 2.5, 1.001), 0.48, a_over_h=2.5 / 3)
    rng = np.random.default_rng(seed)
    depth = np.where(r < 2.5, 0.4, -0.4 * rise) + tilt * x + 0.003 * rng.standard_normal(r.shape)
    height = HeightMap(depth, np.ones(r.shape, bool), (0.1, 0.1), np.full(r.shape, 0.003))
    return Surface(height, (0.0, 0.0), 2.5, 0.4, "right")


@pytest.mark.slow
def test_the_exact_surface_leaves_nothing_and_a_tilt_shows_in_the_azimuth() -> None:
    clean = residual_map([drawn_surface(k) for k in range(6)], GEL)
    tilted = residual_map([drawn_surface(k, tilt=0.002) for k in range(6)], GEL)
    assert clean is not None
    assert tilted is not None
    assert np.nanquantile(np.abs(clean.residual_mm), 0.98) < 0.008, "all but the steep rim of the nearest pixels"
    assert np.isnan(clean.residual_mm[30, 50]), "nothing is compared towards the bevel"
    p_clean, p_tilted = ({c.key: c.p_adjusted for c in one.covariates} for one in (clean, tilted))
    assert min(p_clean.values()) > 0.01
    assert p_tilted["height map: azimuth"] < 1e-3
    assert residual_map([drawn_surface(0)], GEL) is None


def test_every_effect_of_the_picture_is_in_the_catalogue() -> None:
    assert {effect.key for effect in in_picture()} <= set(EFFECTS)
