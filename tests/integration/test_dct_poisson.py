"""The transform pair solves the equations of a picture of any size."""

from __future__ import annotations

import numpy as np
from each import each

from tactilevision.heightmap.poisson import divergence, edge_divergence, gradient, solve_poisson


@each("shape", [(24, 30), (37, 30), (24, 41), (61, 37), (2, 13), (13, 2), (320, 427)])
@each("mm_per_px", [(0.06, 0.06), (0.03, 0.11), (0.11, 0.03)])
def test_the_solution_solves_the_equations_of_the_picture_alone(
    shape: tuple[int, int], mm_per_px: tuple[float, float]
) -> None:
    dz_dx, dz_dy = np.random.default_rng(0).standard_normal((2, *shape))
    right = edge_divergence(dz_dx, dz_dy, mm_per_px)
    depth = solve_poisson(right, mm_per_px)
    assert np.allclose(divergence(*gradient(depth, mm_per_px), mm_per_px), right, atol=1e-9 * np.abs(right).max())
    assert abs(depth.mean()) < 1e-12 * np.abs(depth).max()


def test_single_precision_keeps_six_digits_of_a_ball() -> None:
    y, x = np.mgrid[:320, :427] * 0.064
    r = np.hypot(x - 12.0, y - 9.0)
    depth = np.maximum(0.4 - r**2 / 16.0, 0.0)
    edges = gradient(depth, (0.064, 0.064))
    found = solve_poisson(divergence(*edges, (0.064, 0.064)).astype(np.float32), (0.064, 0.064))
    assert np.abs(found - (depth - depth.mean())).max() < 2e-6
