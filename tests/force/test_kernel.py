"""Cell compliance against closed forms and against its own symmetries."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tactilevision.errors import InputError
from tactilevision.force.compliance import candidate_cells, roughness
from tactilevision.force.kernel import layer_cells
from tactilevision.force.nodes import NodeGrid, cell_means, lay_grid
from tactilevision.force.noise import CellNoise, StatedStd, measured_noise, stated_noise
from tactilevision.force.observe import Observation
from tactilevision.records.measured import Bools, Floats


def test_on_a_deep_gel_a_cell_moves_as_a_loaded_square_on_a_half_space() -> None:
    grid = lay_grid((40, 40), (0.1, 0.1), spacing_mm=0.5)
    cells = layer_cells(grid, thickness_mm=20.0, poisson_ratio=0.4)
    own = cells.block(np.array([0]), 1)[0, 0]
    mean = (4 * np.log(1 + np.sqrt(2)) - 4 / 3 * (np.sqrt(2) - 1)) * 0.5 * (1 - 0.4**2) / np.pi
    # The base, 40 cells below, takes 1.5 % off, the waves left out of the sum .6 %.
    assert own == pytest.approx(0.979 * mean, rel=0.005)


def test_a_wide_even_load_sinks_by_the_constrained_modulus() -> None:
    grid = lay_grid((64, 64), (0.5, 0.5), spacing_mm=0.5)
    cells = layer_cells(grid, thickness_mm=1.0, poisson_ratio=0.3)
    sunk = cells.table.reshape(127, 127, 3, 3)[31:95, 31:95, 2, 2].sum()  # from all cells to the middle one
    assert sunk == pytest.approx((1 + 0.3) * (1 - 0.6) / (1 - 0.3), rel=1e-3)


def test_compliance_is_symmetric_and_positive_definite() -> None:
    grid = lay_grid((60, 60), (0.1, 0.1), spacing_mm=0.5)
    block = layer_cells(grid, thickness_mm=3.0, poisson_ratio=0.49).block(np.arange(144))
    assert np.abs(block - block.T).max() < 1e-12 * np.abs(block).max()
    assert np.linalg.eigvalsh(block).min() > 0


def test_cell_means_of_a_plane_are_its_values_at_the_middles() -> None:
    grid = lay_grid((47, 61), (0.13, 0.11), spacing_mm=0.5)
    x = (np.arange(61) - 30) * 0.13
    y = (np.arange(47) - 23) * 0.11
    plane = 0.3 * x[None, :] - 0.2 * y[:, None]
    means, known = cell_means(grid, plane, valid=None)
    assert known.all()
    # Overlaps weigh whole pixels, so a tilt is off by less than a pixel's own step.
    assert np.abs(means - (0.3 * grid.x_mm[None, :] - 0.2 * grid.y_mm[:, None])).max() < 0.3 * 0.13 / 2


@pytest.mark.parametrize("length_mm", [0.1, 1.5])
def test_the_noise_of_a_mean_follows_from_its_correlation_length(length_mm: float) -> None:
    """By the definition: the mean over an area A has the variance s^2 l^2/A; and the same is measured on a map."""
    grid, rng = lay_grid((400, 400), (0.1, 0.1), spacing_mm=0.5), np.random.default_rng(3)
    pixels = rng.standard_normal((400, 400))
    if length_mm > 0.1:
        pixels = 15 * gaussian_filter(pixels, 15 / np.sqrt(4 * np.pi), mode="wrap")
    depth, known = cell_means(grid, 0.01 * pixels, valid=None)
    square = grid.shape[0] * grid.shape[1]
    mean, every = np.full((1, square), 1 / square), np.arange(square)
    stated, area = stated_noise(0.01, length_mm, grid), square * grid.cell_mm2
    assert stated.total[0, 0] == pytest.approx(depth.std(), rel=0.08)
    assert stated.propagate(mean, every)[0, 0] == pytest.approx(0.01**2 * length_mm**2 / area, rel=0.05)
    found = measured_noise(grid, depth, StatedStd(np.full(grid.shape, 0.02)), known)
    assert found is not None
    few = np.flatnonzero(np.hypot(*np.meshgrid(grid.x_mm, grid.y_mm)) < 2.5)
    total = [one.propagate(np.ones((1, len(few))), few)[0, 0] for one in (found, stated)]
    assert total[0] == pytest.approx(total[1], rel=0.3)


def test_a_scale_or_spacing_that_makes_no_grid_is_refused() -> None:
    with pytest.raises(InputError, match="scale in mm"):
        lay_grid((100, 100), (float("nan"), 0.1), spacing_mm=0.5)
    with pytest.raises(InputError, match="at least a pixel"):
        lay_grid((100, 100), (0.6, 0.6), spacing_mm=0.5)
    with pytest.raises(InputError, match="less than 4 cells"):
        lay_grid((10, 10), (0.1, 0.1), spacing_mm=0.5)


def test_roughness_leaves_a_constant_alone_and_sees_a_step() -> None:
    cells = np.array([11, 12, 13, 21, 22, 23])
    matrix = roughness(cells, (5, 10))
    assert np.abs(matrix @ np.ones(6)).max() < 1e-15
    assert np.array([1, 0, 0, 1, 0, 0]) @ matrix @ np.array([1, 0, 0, 1, 0, 0]) == pytest.approx(0.5)


def seen(depth_mm: Floats, std_mm: Floats, known: Bools) -> Observation:
    grid, none = NodeGrid((20, 20), 0.5, (100, 100), (0.1, 0.1)), np.zeros((20, 20))
    return Observation(
        depth_mm[None], np.zeros(1), known, (), (CellNoise(grid, std_mm, none, none, 1.0),), None, known
    )


def test_a_single_deep_cell_is_noise_and_a_group_is_a_contact() -> None:
    depth = np.zeros((20, 20))
    depth[3, 3] = 0.1
    depth[10:13, 10:13] = 0.1
    known, std = np.ones((20, 20), dtype=bool), np.full((20, 20), 0.001)
    assert len(candidate_cells(seen(depth, std, known))) == 9
    assert len(candidate_cells(seen(depth, std, ~known))) == 0


def test_where_the_map_is_less_sure_more_is_asked_for() -> None:
    depth = np.zeros((20, 20))
    depth[2:5, 2:5] = depth[10:13, 10:13] = 0.1
    std = np.full((20, 20), 0.005)
    std[:6, :6] = 0.03  # a corner that the light hardly reaches
    kept = candidate_cells(seen(depth, std, np.ones((20, 20), dtype=bool)))
    assert len(kept) == 9
    assert kept.min() >= 200
