"""Compliance of the gel's surface, stored as arrays, and its inverse on the cells in contact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.linalg import lapack
from scipy.ndimage import binary_fill_holes

from tactilevision.errors import ConvergenceError, InputError
from tactilevision.files.opening import check_numbers
from tactilevision.force.kernel import REACH, WAVES, CellCompliance, layer_cells
from tactilevision.force.lateral_boundaries import (
    LOAD_MM,
    SOLVED_AT,
    STATION_MM,
    SideTable,
    from_side,
    side_tables,
    station_shape,
)
from tactilevision.force.mesh_compliance import MeshCompliance, mesh_compliance
from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.force.observe import Observation
from tactilevision.records.constants import ROUNDING, TINY
from tactilevision.records.contact_thresholds import CONTACT, cell_limit_mm
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Gel

# The unbounded layer's exact compliance, and the contribution of the gel's free sides:
#
#     C = C_layer (Fourier, exact) + C_sides (finite elements, smooth: within about two thicknesses of a side)
#
# Superposition: the opposite of the layer's stress at the side acts on the free side (lateral_boundaries.py). Only
# that smooth part is discretised coarsely. E scales both; both are computed for one nu.

POISSON_STEP = 1e-3  # step in Poisson's ratio of the compliance's derivative


@dataclass(frozen=True, slots=True)
class Slopes:
    """Derivatives by nu of the layer's compliance and of the sides'."""

    layer: CellCompliance
    sides: SideTable | None


@dataclass(frozen=True)
class GelCompliance:
    """Compliance between cells at modulus 1 MPa; `inside` (rows, columns): the cells on the gel.

    `slopes` is for the derivative by nu; None: not computed.
    """

    gel: Gel
    poisson_ratio: float
    layer: CellCompliance
    inside: Bools = field(repr=False)
    sides: SideTable | None = None
    slopes: Slopes | None = field(default=None, repr=False)

    surface = None  # the picture's plane

    @property
    def grid(self) -> NodeGrid:
        """The cells."""
        return self.layer.grid

    @property
    def cell_unit(self) -> float:
        """Return the size of a cell over its reduced modulus, mm/MPa at modulus 1 MPa."""
        return self.grid.spacing_mm * (1 - self.poisson_ratio**2)

    def block(self, cells: Cells, parts: int = 3) -> Floats:
        """Return displacement by traction between cells, (parts C, parts C), as CellCompliance does."""
        block = self.layer.block(cells, parts)
        return block if self.sides is None else block + self.sides.block(cells, parts)

    def depth(self, cells: Cells, traction: Floats) -> Floats:
        """Return the depth (rows, columns) everywhere that `traction` (3 or 1, C) at `cells` makes.

        Sides are neglected.
        """
        rows, columns = self.grid.shape
        shape, waves = self._depth_waves
        fields = np.zeros((len(traction), rows * columns), dtype=np.float32)
        fields[:, cells] = traction
        spectra = fft.rfft2(fields.reshape(-1, rows, columns), shape)
        moved = fft.irfft2((waves[-len(traction) :] * spectra).sum(axis=0), shape)[
            rows - 1 : 2 * rows - 1, columns - 1 : 2 * columns - 1
        ]
        return np.asarray(moved, dtype=np.float64)

    @cached_property
    def _depth_waves(self) -> tuple[tuple[int, int], npt.NDArray[np.complex64]]:
        """Shape of the transform, and (3, ky, kx): depth by t_x, t_y, t_z."""
        rows, columns = self.grid.shape
        # a convolution of length 2 n - 1 wraps only outside the part that is read
        shape = (fft.next_fast_len(2 * rows - 1, real=True), fft.next_fast_len(2 * columns - 1, real=True))
        table = self.layer.table.reshape(2 * rows - 1, 2 * columns - 1, 3, 3)[:, :, 2].astype(np.float32)
        return shape, np.stack([fft.rfft2(table[..., k], shape) for k in range(3)])

    def by_poisson(self, cells: Cells, traction: Floats) -> Floats:
        """Return the derivative by nu, (parts C,), of the displacement by `traction` (parts, C) on these cells."""
        assert self.slopes is not None
        found = self.slopes.layer.block(cells, len(traction)) @ traction.ravel()
        if self.sides is None or self.slopes.sides is None:
            return found
        return np.asarray(found + self.slopes.sides.moved(cells, traction).ravel())


Compliance = GelCompliance | MeshCompliance


def compliance_for(
    gel: Gel, grid: NodeGrid, *, poisson_ratio: float, sides: bool = True, slopes: bool = False
) -> Compliance:
    """Return the compliance of a gel of any shape for the cells of `grid`, as the functions of its kind do."""
    if gel.is_flat:
        return gel_compliance(gel, grid, poisson_ratio=poisson_ratio, sides=sides, slopes=slopes)
    return mesh_compliance(gel, grid, poisson_ratio=poisson_ratio, slopes=slopes)


def gel_compliance(
    gel: Gel, grid: NodeGrid, *, poisson_ratio: float, sides: bool = True, slopes: bool = False
) -> GelCompliance:
    """Build, or read from the cache, the compliance of `gel` for the cells of `grid`, with `slopes` if asked for.

    Raises InputError if no cell is on the gel.
    """
    inside = on_gel(gel, grid)
    if not inside.any():
        raise InputError(
            "no part of the view is on the gel",
            where="gel_compliance",
            value=gel,
            remedy="Check radius_mm or size_mm of [sensor.gel].",
        )
    h = gel.thickness_mm
    layer = layer_cells(grid, thickness_mm=h, poisson_ratio=poisson_ratio)
    tables = side_tables(gel, grid, poisson_ratio=poisson_ratio) if sides else None
    table, slope = tables or (None, None)
    change = None
    if slopes:
        below = layer_cells(grid, thickness_mm=h, poisson_ratio=poisson_ratio - POISSON_STEP)
        change = Slopes(CellCompliance(grid, (layer.table - below.table) / POISSON_STEP), slope)
    return GelCompliance(gel, poisson_ratio, layer, inside, table, change)


def on_gel(gel: Gel, grid: NodeGrid) -> Bools:
    """Return the mask (rows, columns) of the cells that lie wholly on the gel."""
    half = grid.spacing_mm / 2
    x, y = np.meshgrid(np.abs(grid.x_mm) + half, np.abs(grid.y_mm) + half)
    return np.asarray(from_side(gel, np.stack([x, y], axis=-1)) >= -ROUNDING)


# A gel's compliance as arrays, since it takes a second, or ten with free sides. The key names all that
# the numbers depend on; arrays of another key are not used.

Arrays = Mapping[str, npt.NDArray[Any]]
KEY, LAYER, LAYER_SLOPE, SIDES, SIDES_SLOPE = "key", "layer", "layer_slope", "sides", "sides_slope"


def as_arrays(made: GelCompliance) -> dict[str, npt.NDArray[Any]]:
    """Return all that is computed of a compliance with slopes, mm/MPa at modulus 1 MPa, any shape, and its key."""
    assert made.slopes is not None
    key = np.array(_key(made.gel, made.grid, made.poisson_ratio))
    sides = {SIDES: made.sides, SIDES_SLOPE: made.slopes.sides}
    arrays = {KEY: key, LAYER: made.layer.table, LAYER_SLOPE: made.slopes.layer.table}
    return arrays | {name: one.table for name, one in sides.items() if one is not None}


def of_arrays(arrays: Arrays, gel: Gel, *, grid: NodeGrid, poisson_ratio: float, where: object) -> GelCompliance:
    """Restore the compliance from `as_arrays`, mm/MPa, of any shape.

    Another gel's, or version's, is computed anew. Raises InputError if the arrays have the key and do not fit it.
    """
    if KEY not in arrays or str(arrays[KEY]) != _key(gel, grid, poisson_ratio):
        return gel_compliance(gel, grid, poisson_ratio=poisson_ratio, slopes=True)
    cells = (2 * grid.shape[0] - 1) * (2 * grid.shape[1] - 1), 9
    sides = (3 * math.prod(station_shape(grid)),) * 2
    layer, slope = (CellCompliance(grid, _checked(arrays, name, cells, where)) for name in (LAYER, LAYER_SLOPE))
    here, change = (
        SideTable(grid, _checked(arrays, name, sides, where)) if name in arrays else None
        for name in (SIDES, SIDES_SLOPE)
    )
    return GelCompliance(gel, poisson_ratio, layer, on_gel(gel, grid), here, Slopes(slope, change))


def _checked(arrays: Arrays, name: str, shape: tuple[int, ...], where: object) -> npt.NDArray[Any]:
    found = arrays.get(name)
    fits = found is not None and found.shape == shape and found.dtype.kind in "fi"
    if found is None or not fits or not np.isfinite(found).all():
        raise InputError(f"the compliance's {name} is missing or has another shape", where=where, value=shape)
    check_numbers(found, what=f"a number of the compliance's {name}", where=where)
    return found


def _key(gel: Gel, grid: NodeGrid, poisson_ratio: float) -> str:
    """Return all that the numbers depend on."""
    outline = gel.shape, gel.radius_mm, gel.size_mm, gel.thickness_mm, round(poisson_ratio, 9)
    steps = WAVES, REACH, POISSON_STEP, SOLVED_AT, STATION_MM, LOAD_MM
    return repr((*outline, grid.shape, grid.spacing_mm, *steps))


# Cells that may carry force: candidates from the depth, narrowed by the force itself.
#
# Candidates are deeper than three standard deviations and than a share of the deepest
# (records/contact_thresholds.py). The edge of a contact is at least a third as deep as its middle (Hertz: a half;
# flat punch: all), so no contact down to a tenth of the deepest is lost. Patches of candidates count if their
# deepest cell exceeds five deviations and, in deviations of each place, the greatest rise: outside a punch the gel
# rises by an eighth of its depth at most, so a map that rises more shows its own error. A slow error leaves a few
# hundred independent places in a view, of which five deviations are exceeded by chance once in thousands of
# frames. Narrowing: pressure is positive, so cells of negative pressure are excluded until there are none, and so
# are cells below FAINTEST of the greatest pressure, which are ringing at the contact's edge.

FAINTEST = 0.02  # of the greatest pressure: bound of the ringing at a contact's edge
DOUBT = 0.3  # of a contact's displacement of the gel around it: linear theory against large depth


def candidate_cells(seen: Observation) -> Cells:
    """Return the flat indices of the cells that may touch, by depth and its standard deviation.

    Empty where nothing does.
    """
    depth_mm, std_mm, known = seen.displacement_mm[-1], seen.depth_std_mm, seen.known
    if not known.any():
        return np.zeros(0, dtype=np.intp)
    deep = known & (depth_mm > cell_limit_mm(std_mm, float(depth_mm[known].max())))
    pull = depth_mm / (std_mm + TINY)
    return _patches(deep, pull, max(CONTACT.patch_sigma, -float(pull[known].min())))


def overlooked_cells(left_mm: Floats, moved_mm: Floats, *, std_mm: Floats, usable: Bools) -> Cells:
    """Return flat indices of the cells (rows, columns) of a weak contact next to a deep one.

    There the residual depth `left_mm` over the displacement by the deep one (`moved_mm`) is significant. `usable`
    excludes what is near the deep contact. A patch must exceed its deviation plus the error of the deep contact's
    displacement, by a larger factor than any place rises: the map's slow error is as often a rise.
    """
    if not usable.any():
        return np.zeros(0, dtype=np.intp)
    doubt = DOUBT * float(np.abs(moved_mm[usable]).max())
    deep = usable & (left_mm > CONTACT.cell_sigma * std_mm + doubt)
    share = left_mm / (CONTACT.patch_sigma * std_mm + doubt + TINY)
    return _patches(deep, share, max(1.0, -float(share[usable].min())))


def _patches(deep: Bools, score: Floats, least: float) -> Cells:
    """Return indices of the cells in patches of `deep` cells, without isolated ones, that score above `least`."""
    around = cv2.boxFilter(deep.view(np.uint8), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    deep = deep & (around >= CONTACT.cell_neighbours)
    sure = deep & (score > least)
    if not sure.any():
        return np.zeros(0, dtype=np.intp)
    patches = cv2.connectedComponents(deep.view(np.uint8), connectivity=4)[1]
    return np.flatnonzero(np.bincount(patches[sure], minlength=int(patches.max()) + 1)[patches])


def roughness(cells: Cells, shape: tuple[int, int]) -> Floats:
    """Return a quarter of the graph Laplacian of the cells (C,): R, dimensionless (C, C).

    x R x is the squared step to the neighbours.

    The edge of the set is free, so a constant traction is not rough and its sum is unbiased.
    """
    place = cells + cells // shape[1]  # with a gap between rows
    apart = np.abs(place[:, None] - place)
    matrix = -0.25 * ((apart == 1) | (apart == shape[1] + 1))
    matrix.flat[:: len(cells) + 1] = -matrix.sum(axis=1)
    return np.asarray(matrix)


def at_border(cells: Cells, usable: Bools) -> Bools:
    """Return the mask (C,) of the cells with an unknown neighbour: at the border of the view, gel or map."""
    row, column = np.divmod(cells, usable.shape[1])
    framed = np.zeros((usable.shape[0] + 2, usable.shape[1] + 2), dtype=bool)
    framed[1:-1, 1:-1] = usable
    around = framed[row, column + 1] & framed[row + 2, column + 1] & framed[row + 1, column]
    return np.asarray(~(around & framed[row + 1, column + 2] & framed[row + 1, column + 1]))


# Traction on the touching cells from the surface displacement.
#
#     (C + a I + R) x = u,        t = x + a (C + a I + R)^-1 x            (iterated Tikhonov, order 2)
#
# C the compliance between the touching cells, R = r_c L per component c with L their roughness. C is the energy's
# own matrix, so the unknown shape of the traction inside a cell causes a small error of the force; the second step
# corrects the bias of a in the slow components, and so of the resultant.
#
# Weights, from the cell and from the noise alone:
#     a   = SUBCELL d/E*                              a traction that is not constant over a cell of width d
#     r_c = SUBCELL_STEP d/E* + sigma_c/tau_c         the same between cells, plus noise over signal: the filter
#                                                     lambda/(lambda + sigma/tau) is one half where the noise sigma
#                                                     of u equals the displacement lambda tau of the traction's rms
# SUBCELL and SUBCELL_STEP are dimensionless, since d/E* is the only compliance of a cell that is small against the
# thickness. They were chosen on 24 random contacts (Hertz, flat punch, ridge, two at a time) on one layer without
# and with noise; the benchmark samples others, and other gels, cells and noise. Standard deviations are of the
# linear map t = F u with fixed cells.

SUBCELL = 0.42  # of d/E*: traction that is uneven over a cell; chosen on 24 random contacts, see above
SUBCELL_STEP = 0.10  # of d/E*: the same between cells; chosen on the same contacts
MISFIT = 0.03  # of the deepest: what cells leave of the depth by nonlinear elements; benchmarks.force_depth
MAX_ITERATIONS = 40  # rounds of narrowing


@dataclass(frozen=True, slots=True)
class Solution:
    """`traction` (n, C) in units of E, n = 3 for (x, y, z) or 1 for z alone; `factor` Cholesky's of M;
    `subcell` is a.
    """

    cells: Cells
    traction: Floats
    factor: Floats
    subcell: float

    def gain(self, weights: Floats) -> Floats:
        """Return weights (K, nC) @ M^-1."""
        return np.asarray(lapack.spotrs(self.factor, weights.T, lower=1)[0].T, dtype=np.float64)

    def response(self, weights: Floats) -> Floats:
        """Return the slope (K, nC) of weights (K, nC) @ traction by the displacement, cells fixed."""
        once = self.gain(weights)
        return np.asarray(once + self.subcell * self.gain(once))

    def cell_std(self, std_mm: Floats) -> Floats:
        """Return the standard deviation (n, C) of each traction.

        The components' coupling (2 % of it) is neglected.
        """
        count, found = len(self.cells), np.empty_like(self.traction)
        for k in range(len(found)):
            rows = self.factor[k * count : (k + 1) * count, : (k + 1) * count]
            own = lapack.dpotrf(rows @ rows.T, lower=1, overwrite_a=1)[0] if k else rows
            inverse = lapack.dpotri(own, lower=1)[0]
            inverse = inverse + inverse.T
            inverse.flat[:: count + 1] /= 2
            full = inverse + self.subcell * (inverse @ inverse)
            found[k] = np.sqrt((full**2) @ std_mm[k * count : (k + 1) * count] ** 2)
        return found


def solve(
    compliance: Compliance, cells: Cells, *, displacement_mm: Floats, std_mm: Floats, adhesive: bool = False
) -> Solution:
    """Solve for the tractions in MPa of modulus 1 from `displacement_mm` (n, C) of `cells`; `std_mm` (n,).

    n is 3 for x, y, z, or 1 for z alone, as of a contact without friction. With 3 the contact is first narrowed by
    the pressure alone, a system a ninth as large. `adhesive` keeps cells that pull.
    """
    parts = len(displacement_mm)
    if parts == 3 and not adhesive:
        first = solve(compliance, cells, displacement_mm=displacement_mm[2:], std_mm=std_mm[2:])
        if len(first.cells) == 0:
            return first
        kept = np.isin(cells, first.cells, assume_unique=True)
        cells, displacement_mm = cells[kept], displacement_mm[:, kept]
    whole = compliance.block(cells, parts)
    return _narrow(whole, compliance.grid, cells, displacement_mm, std_mm, compliance.cell_unit, adhesive)


def _narrow(
    whole: Floats, grid: NodeGrid, cells: Cells, u: Floats, std_mm: Floats, unit: float, adhesive: bool
) -> Solution:
    """Solve and exclude the cells of negative pressure until there are none; possibly no cell remains."""
    active, rough = np.arange(len(cells)), roughness(cells, grid.shape)
    rms = _rms_guess(u, unit)
    for _ in range(MAX_ITERATIONS):
        factor, x = _solved(whole, rough, active, u[:, active], unit, std_mm / rms)
        faintest = -np.inf if adhesive else FAINTEST * float(np.max(x[-1], initial=0.0))
        drop = x[-1] < faintest
        rms = _rms(x, std_mm / unit)
        if not drop.any():
            return Solution(cells[active], x, factor, SUBCELL * unit)
        active = active[~drop]
        if len(active) == 0:
            return Solution(cells[:0], x[:, :0], factor[:0, :0], SUBCELL * unit)
    raise ConvergenceError(f"the contact did not settle in {MAX_ITERATIONS} rounds")


def _solved(
    whole: Floats, rough: Floats, active: Cells, u: Floats, unit: float, noise: Floats
) -> tuple[Floats, Floats]:
    """Return the factor of M, in single precision, and the tractions, refined once in double."""
    count, parts = len(active), len(u)
    if count == len(rough):
        matrix = whole.copy()
    else:
        every = np.concatenate([active + k * len(rough) for k in range(parts)])
        matrix, rough = whole[np.ix_(every, every)], rough[np.ix_(active, active)]
        rough.flat[:: count + 1] -= rough.sum(axis=1)
    for k in range(parts):
        matrix[k * count : (k + 1) * count, k * count : (k + 1) * count] += (
            SUBCELL_STEP * unit + noise[k]
        ) * rough
    matrix.flat[:: len(matrix) + 1] += SUBCELL * unit
    factor, fault = lapack.spotrf(matrix.T.astype(np.float32), lower=1, overwrite_a=1)
    if fault:
        raise ConvergenceError("the compliance of the touching cells is not positive definite")
    once = lapack.spotrs(factor, u.ravel(), lower=1)[0].astype(np.float64)
    once += lapack.spotrs(factor, u.ravel() - matrix @ once, lower=1)[0]
    again, _ = lapack.spotrs(factor, once, lower=1)
    return factor, (once + SUBCELL * unit * again).reshape(parts, count)


def unclipped(
    compliance: Compliance, seen: Observation, found: Solution, left_mm: Floats
) -> tuple[Solution, float]:
    """Solve for what the pressures of `found` (C,) lack over its cells and the rings about them, pulls included,
    by the depth (rows, columns) that they leave, mm.

    Noise that may not pull only pushes, so the sum of pressures without negative ones is too large. With the sum
    of this solution added it is linear in the depth, over a support that noise hardly moves, and so unbiased:

        dt = F_S (u - C t),    F_S = M_S^-1 + a M_S^-2,    M_S = C_S + a I + R_S

    A residual r that noise s and elasticity (MISFIT of the deepest) do not explain is an error of the map, which
    the bound on pulls keeps from the force. So the second value is the share of dt to be used,

        min(1, (s^2 + (MISFIT w)^2) / mean(r^2))
    """
    grid, touching = compliance.grid, np.zeros(compliance.grid.shape, dtype=np.uint8)
    touching.flat[found.cells] = 1
    ring = 2 * seen.noise[-1].rings + 1
    support = np.flatnonzero(cv2.dilate(touching, np.ones((ring, ring), np.uint8)).astype(bool) & seen.known)
    left = left_mm.ravel()[support]
    unit, whole = compliance.cell_unit, compliance.block(support, 1)
    if compliance.sides is not None:
        within = np.zeros((len(found.traction), len(support)))
        within[:, np.searchsorted(support, found.cells)] = found.traction
        left = left - compliance.sides.moved(support, within)[-1]
    rms = _rms(found.traction[-1:], seen.std_mm[-1:] / unit)
    every = np.arange(len(support))
    rough = roughness(support, grid.shape)
    factor, more = _solved(whole, rough, every, left[None], unit, seen.std_mm[-1:] / rms)
    deepest = float(seen.displacement_mm[-1].ravel()[found.cells].max())
    likely = float(np.mean(seen.depth_std_mm.ravel()[support] ** 2)) + (MISFIT * deepest) ** 2
    return Solution(support, more, factor, SUBCELL * unit), min(1.0, likely / float(np.mean(left**2) + TINY**2))


def _rms_guess(u: Floats, unit: float) -> Floats:
    """Guess the rms of the traction: a displacement that changes over some cells, tied to the largest."""
    size = np.sqrt(_mean_square(u)) / (4 * unit)
    return np.asarray(np.maximum(size, 1e-2 * size.max()) + TINY**2)


def _rms(x: Floats, noise: Floats) -> Floats:
    """Return the rms of the traction, corrected for the noise, but not below a third of the noise."""
    return np.asarray(np.sqrt(np.maximum(_mean_square(x) - noise**2, noise**2 / 10)) + TINY**2)


def _mean_square(x: Floats) -> Floats:
    return np.asarray(np.einsum("kc,kc->k", x, x) / x.shape[1])


# Force where nothing is known: beyond a border that cuts the contact, and in holes of the map.


def is_cut(grid: NodeGrid, found: Solution, seen: Observation) -> bool:
    """Return whether pressure reaches the border: the sum over its cells is significant.

    Its deviation includes errors that the whole contact shares, and those of each cell.
    """
    if not at_border(found.cells, seen.known).any():
        return False
    edge = at_border(found.cells, binary_fill_holes(seen.known))
    if not edge.any():
        return False
    weights = np.zeros((1, found.traction.size))
    weights[0, -len(found.cells) :] = edge
    slopes = found.response(weights).reshape(1, len(seen.noise), -1)
    parts = zip(seen.noise, slopes.swapaxes(0, 1), strict=True)
    square = sum(float(noise.propagate(slope, found.cells)[0, 0]) for noise, slope in parts)
    return float(found.traction[-1][edge].sum()) > CONTACT.cell_sigma * float(np.sqrt(square))


def force_beyond(grid: NodeGrid, found: Solution, seen: Observation, *, scale: Floats, cut: bool) -> Floats:
    """Return the squared force (3,), N², that may lie where nothing is known.

    Beyond a border that cuts the contact: its cells' traction continued for half the contact's width. In a hole of
    the map: the mean traction around it, over the hole's area at most.
    """
    square = np.zeros(len(found.traction))
    beside = at_border(found.cells, seen.known)
    if beside.any():
        whole = np.asarray(binary_fill_holes(seen.known))
        outer = at_border(found.cells, whole)
        inner = beside & ~outer
        half_width, traction = np.sqrt(len(found.cells) / np.pi), found.traction * scale
        if cut:
            square += (grid.cell_mm2 * traction[:, outer].sum(axis=1) * half_width) ** 2
        if inner.any():
            missing = min(np.count_nonzero(whole & ~seen.known), half_width * np.count_nonzero(inner))
            square += (grid.cell_mm2 * traction[:, inner].mean(axis=1) * missing) ** 2
    return np.concatenate([np.zeros(3 - len(square)), square])
