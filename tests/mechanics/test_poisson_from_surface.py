"""nu from the surface beside the punch: recovered, not fooled by a map's faults, silent where it cannot tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_surfaces import PX_MM, RADIUS_MM, SHAPE, THICKNESS_MM, noise, surface, views

from tactilevision.errors import InputError
from tactilevision.mechanics.poisson_from_surface import fit_poisson_ratio
from tactilevision.mechanics.profile import LINEAR, PunchCase, linear_profile
from tactilevision.mechanics.surface_view import SurfaceView, estimate_noise, reduce_view
from tactilevision.records.measured import Floats

EXACT = replace(
    LINEAR, relative_error=0.0, shape_error=(), single_depth_std=0.0
)  # the truth of these tests is linear theory itself


def test_exact_surfaces_give_their_own_poisson_ratio() -> None:
    for nu in (0.35, 0.48, 0.497):
        made = views(nu, np.random.default_rng(1), depths_mm=(0.3, 0.5), noise_mm=0.0)
        fit = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, model=EXACT)
        assert fit.poisson_ratio.value == pytest.approx(nu, abs=2e-4)
        assert fit.poisson_ratio.unit == "1"


def test_planted_poisson_ratio_is_found_within_its_interval() -> None:
    errors = []
    for seed, nu in ((2, 0.47), (3, 0.488)):
        made = views(nu, np.random.default_rng(seed))
        fit = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, thickness_std_mm=0.03, model=EXACT)
        value, std = fit.poisson_ratio.value, fit.poisson_ratio.std
        assert value is not None
        assert std is not None
        assert 2e-4 < std < 0.006
        errors.append((value - nu) / std)
    assert np.abs(errors).max() < 3


@pytest.mark.slow
def test_intervals_cover() -> None:
    inside = []
    for seed in range(30):
        rng = np.random.default_rng(100 + seed)
        nu = rng.uniform(0.45, 0.495)
        fit = fit_poisson_ratio(views(nu, rng), thickness_mm=THICKNESS_MM, thickness_std_mm=0.03, model=EXACT)
        low, high = fit.poisson_ratio.interval95 or (0, 0)
        inside.append(low <= nu <= high)
    assert sum(inside) >= 26  # 95 % of 30 is 28.5; 25 or fewer has a chance below 1 %


def test_scale_of_the_map_does_not_matter() -> None:
    made = [replace(view, certified_depth_mm=float("nan")) for view in views(0.48, np.random.default_rng(4))]
    doubled = [replace(view, depth_mm=1.1 * view.depth_mm) for view in made]
    first, second = (fit_poisson_ratio(some, thickness_mm=THICKNESS_MM, model=EXACT) for some in (made, doubled))
    assert first.poisson_ratio.value == pytest.approx(second.poisson_ratio.value, abs=1e-3)


def test_masked_sector_and_border_do_not_bias() -> None:
    made = views(0.48, np.random.default_rng(5), depths_mm=(0.4, 0.5), noise_mm=0.0)
    hidden = np.ones(SHAPE, bool)
    hidden[:, int(SHAPE[1] / 2 + 4.8 / PX_MM) :] = False  # a bevel to the right
    hidden[:20] = False
    spoiled = [replace(view, valid=hidden, depth_mm=np.where(hidden, view.depth_mm, 9.0)) for view in made]
    fit = fit_poisson_ratio(spoiled, thickness_mm=THICKNESS_MM, model=EXACT)
    assert fit.poisson_ratio.value == pytest.approx(0.48, abs=3e-4)


def test_two_radii_are_fitted_together() -> None:
    made = []
    for radius in (1.5, RADIUS_MM):
        depth = surface(0.475, 0.4, (0, 0), radius_mm=radius)
        made.append(SurfaceView(depth, np.ones(SHAPE, bool), (PX_MM, PX_MM), radius))
    fit = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, model=EXACT)
    assert fit.poisson_ratio.value == pytest.approx(0.475, abs=3e-4)


def test_profile_that_is_known_badly_widens_the_interval_by_what_it_does() -> None:
    def stronger(r_over_a: Floats, case: PunchCase, /) -> tuple[Floats, Floats]:
        rise, outward = linear_profile(r_over_a, case)
        return 1.03 * rise, outward

    rng = np.random.default_rng(6)
    made = views(0.47, rng, depths_mm=(0.4, 0.5, 0.6), source=stronger, noise_mm=5e-4)
    models = (EXACT, replace(EXACT, relative_error=0.03))
    fits = [fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, model=model).poisson_ratio for model in models]
    bias = (fits[0].value or 0) - 0.47
    sure, unsure = (fit.std or 0 for fit in fits)
    assert np.sqrt(unsure**2 - sure**2) == pytest.approx(abs(bias), rel=0.3)


def test_one_depth_alone_is_trusted_less() -> None:
    model = replace(EXACT, single_depth_std=0.005)
    made = views(0.48, np.random.default_rng(9), depths_mm=(0.4,), noise_mm=1e-4)
    (sure, unsure) = (fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, model=one) for one in (EXACT, model))
    stds = [fit.poisson_ratio.std or 0.0 for fit in (sure, unsure)]
    assert np.sqrt(stds[1] ** 2 - stds[0] ** 2) == pytest.approx(0.005, rel=1e-3)


def test_nu_that_changes_with_depth_widens_the_interval_by_what_it_changes() -> None:
    rng = np.random.default_rng(10)
    made = [
        view
        for nu, w in ((0.47, 0.2), (0.475, 0.35), (0.48, 0.5), (0.485, 0.6))
        for view in views(nu, rng, depths_mm=(w,), noise_mm=1e-4)
    ]
    estimate = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, model=EXACT).poisson_ratio
    low, high = estimate.interval95 or (1.0, 0.0)
    assert low < 0.471
    assert high > 0.484


def test_shallow_press_in_noise_cannot_tell() -> None:
    made = views(0.48, np.random.default_rng(7), depths_mm=(0.05,), noise_mm=0.02)
    estimate = fit_poisson_ratio(made, thickness_mm=THICKNESS_MM, model=EXACT).poisson_ratio
    assert estimate.value is None
    assert "noise" in estimate.why
    low, high = estimate.interval95 or (1, 0)
    assert low <= 0.48 <= high


def test_noise_is_estimated_from_residuals() -> None:
    rng, flat = (
        np.random.default_rng(8),
        SurfaceView(np.zeros(SHAPE), np.ones(SHAPE, bool), (PX_MM, PX_MM), RADIUS_MM),
    )
    fields = [replace(flat, depth_mm=noise(rng, 0.005, 1.0)) for _ in range(6)]
    blocks = [reduce_view(view, block_mm=1.0, guard_mm=0.4, reach_mm=9.0) for view in fields]
    found = estimate_noise(blocks, [part.depth_mm for part in blocks], block_mm=1.0)
    assert np.hypot(found.std_mm, found.white_mm) == pytest.approx(0.005, rel=0.15)
    assert 1.0 < found.length_mm < 2.0  # exp(-d^2/4) and Matern's form at 1.5 mm agree within .1


def test_bad_input_is_named() -> None:
    flat = SurfaceView(np.zeros(SHAPE), np.ones(SHAPE, bool), (PX_MM, PX_MM), RADIUS_MM)
    with pytest.raises(InputError, match="face"):
        fit_poisson_ratio([flat], thickness_mm=3.0)
    with pytest.raises(InputError, match="thickness"):
        fit_poisson_ratio([flat], thickness_mm=-3.0)
    with pytest.raises(InputError, match="one shape"):
        fit_poisson_ratio([replace(flat, valid=np.ones((3, 3), bool))], thickness_mm=3.0)
