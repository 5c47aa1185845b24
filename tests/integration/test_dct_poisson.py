"""The transform pair: the same equations solved whatever the picture's length has for factors."""

from __future__ import annotations

import numpy as np
from each import each

from tactilevision.heightmap.poisson import TransformSolver, divergence, edge_divergence, gradient


@each("shape", [(24, 30), (37, 30), (24, 41), (61, 37), (2, 13), (13, 2), (320, 427)])
@each("mm_per_px", [(0.06, 0.06), (0.03, 0.11), (0.11, 0.03)])
def test_the_solution_solves_the_equations_of_the_picture_alone(
    shape: tuple[int, int], mm_per_px: tuple[float, float]
) -> None:
    solver = TransformSolver(shape, mm_per_px, np.float64)
    right = edge_divergence(*np.random.default_rng(0).standard_normal((2, *shape)), half=solver.half)
    depth = solver.solve(right.copy())
    assert np.allclose(divergence(*gradient(depth, mm_per_px), mm_per_px), right, atol=1e-9 * np.abs(right).max())
    assert abs(depth.mean()) < 1e-12 * np.abs(depth).max()


def test_only_lengths_without_small_factors_are_continued() -> None:
    assert TransformSolver((320, 427), (1.0, 1.0), np.float32).inverse.shape == (320, 432)
    assert TransformSolver((427, 320), (1.0, 1.0), np.float32).inverse.shape == (432, 320)
    assert TransformSolver((240, 320), (1.0, 1.0), np.float32).inverse.shape == (240, 320)


def test_single_precision_keeps_six_digits_of_a_ball() -> None:
    y, x = np.mgrid[:320, :427] * 0.064
    r = np.hypot(x - 12.0, y - 9.0)
    depth = np.maximum(0.4 - r**2 / 16.0, 0.0)
    edges = gradient(depth, (0.064, 0.064))
    single = TransformSolver((320, 427), (0.064, 0.064), np.float32)
    found = single.solve(divergence(*edges, (0.064, 0.064)).astype(np.float32))
    assert np.abs(found - (depth - depth.mean())).max() < 2e-6
