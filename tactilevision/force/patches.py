"""Contact patches of a solution: their cells, wrenches with covariance, and their numbers over frames.

A patch is what is connected when each touching cell is grown by its neighbours: the support over which the
resultant is linear in the depth (`compliance.unclipped`). The tractions of a patch are multiplied so that their
normal force is that of the linear resultant; noise then moves the wrench w of a patch by

    dw = W (F u_shear + F_S u_z),    cov(w) = sum over components of (W F) cov(u) (W F)^T,

to which the material's covariance and the errors of the method are added, the latter along the patch's own force
and with the lever of its centre of pressure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import label

from tactilevision.force.compliance import Compliance, Solution, force_beyond, unclipped
from tactilevision.force.large_depth import patch_factor
from tactilevision.force.nodes import Cells, NodeGrid
from tactilevision.force.observe import Observation
from tactilevision.records.constants import TINY
from tactilevision.records.maps import TractionMap
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel
from tactilevision.records.wrench import Patch, Wrench, patch_of

# Errors of cells and linear theory, chosen on 100 contacts of benchmarks.force_coverage
MODEL_SHEAR = 0.0055  # of the tangential force, for fx and fy
MODEL_STD = np.array([0.0006, 0.0006, 0.0025])  # of the force, for fx, fy, fz
MODEL_PLACE_MM = 0.005  # mm: of a centre of pressure
FEW_CELLS = 0.08  # of the normal force over the number of cells
EIGHT = np.ones((3, 3), dtype=bool)  # neighbours of a cell; scipy's label, since skimage's takes a second to load
PRESSED = 0.25  # of the mean pressure: less is a cell that is hardly covered, or noise
FRICTION_STD = 0.3  # of the normal force: friction on a curved gel where shear is not measured
MODEL_DEEP = 0.12  # of the correction for large depth; benchmarks.force_depth


@dataclass(frozen=True)
class Patches:
    """The patches of a solution: `whole` is its unclipped correction, of which `share` is used, `of_support` (S,)
    the patch of each of its cells, from 0."""

    compliance: Compliance
    seen: Observation
    found: Solution
    whole: Solution
    share: float
    of_support: Cells

    @property
    def grid(self) -> NodeGrid:
        """Return the cells of the view."""
        return self.compliance.grid

    @cached_property
    def count(self) -> int:
        """Return the number of patches."""
        return int(self.of_support.max()) + 1

    @cached_property
    def place(self) -> Cells:
        """Return the place (C,) of the touching cells within the support."""
        return np.searchsorted(self.whole.cells, self.found.cells)

    @cached_property
    def of_cells(self) -> Cells:
        """Return the patch (C,) of each touching cell."""
        return self.of_support[self.place]

    @cached_property
    def traction(self) -> Floats:
        """Return the tractions (n, C) in units of E, with the unclipped normal force of each patch."""
        fixed = self.found.traction.copy()
        fixed[-1] *= np.maximum(1 + self.share * self.excess, 0.0)[self.of_cells]
        return fixed

    @cached_property
    def excess(self) -> Floats:
        """Return the unclipped normal force (P,) of each patch over the clipped one, less 1."""
        clipped = np.bincount(self.of_cells, self.found.traction[-1], self.count)
        more = np.bincount(self.of_support, self.whole.traction[0], self.count)
        return np.asarray(more / np.maximum(clipped, TINY**2))

    def mean(self, values: Floats, weight: Floats | None = None) -> Floats:
        """Return the mean (P,) of `values` (C,) over each patch, in their unit, weighted by `weight` (C,)."""
        weight = np.ones(len(values)) if weight is None else weight
        total = np.bincount(self.of_cells, weight, self.count)
        return np.asarray(np.bincount(self.of_cells, weight * values, self.count) / total)

    @cached_property
    def sizes(self) -> Cells:
        """Return the number of touching cells (P,)."""
        return np.bincount(self.of_cells, minlength=self.count)

    @cached_property
    def areas_mm2(self) -> Floats:
        """Return the area (P,) of the cells that carry at least PRESSED of their patch's mean pressure."""
        pressure = self.traction[-1]
        pressed = pressure >= PRESSED * self.mean(pressure)[self.of_cells]
        weight = pressed * self._cells_mm2(self.found.cells)
        return np.asarray(np.bincount(self.of_cells, weight, self.count), dtype=np.float64)

    def _cells_mm2(self, cells: Cells) -> Floats:
        surface = self.compliance.surface
        return np.full(len(cells), self.grid.cell_mm2) if surface is None else surface.area_mm2[cells]

    @cached_property
    def places_mm(self) -> Floats:
        """Return the centre of pressure (P, 3) of each patch on a curved surface."""
        assert self.compliance.surface is not None
        places = self.compliance.surface.places_mm[self.found.cells]
        pressure = np.maximum(self.traction[-1], 0) + TINY
        return np.stack([self.mean(one, pressure) for one in places.T], axis=1)

    def frame(self, k: int) -> Floats:
        """Return the local axes (3, 3), rows, of a patch: those of the cell nearest to its centre of pressure."""
        surface = self.compliance.surface
        if surface is None:
            return np.eye(3)
        own = self.found.cells[self.of_cells == k]
        off = np.linalg.norm(surface.places_mm[own] - self.places_mm[k], axis=1)
        return np.asarray(surface.frames[own[np.argmin(off)]])

    def depth_factors(self, gel: Gel) -> Floats:
        """Return the factor (P,) of each patch's tractions for large depth."""
        u, pressure = self.seen.displacement_mm, np.maximum(self.found.traction[-1], 0) + TINY
        stretch, thickness = np.zeros(self.count), np.full(self.count, gel.thickness_mm)
        surface = self.compliance.surface
        if surface is not None:
            along = surface.stretch(u if len(u) == 3 else np.concatenate([0 * u, 0 * u, u]))
            stretch = self.mean(along.ravel()[self.found.cells])
            thickness = self.mean(surface.thickness_mm[self.found.cells], pressure)
        elif len(u) == 3:
            along = sum(np.gradient(u[k], self.grid.spacing_mm, axis=1 - k) for k in (0, 1))
            stretch = self.mean(along.ravel()[self.found.cells])
        return patch_factor(
            np.sqrt(np.bincount(self.of_cells, self._cells_mm2(self.found.cells), self.count) / np.pi),
            self.mean(u[-1].ravel()[self.found.cells], pressure),
            stretch=stretch,
            thickness_mm=thickness,
            poisson_ratio=self.compliance.poisson_ratio,
        )

    def wrenches(self, scale: Floats) -> Floats:
        """Return force and moment (P, 6) about the pad's centre of each patch, N and N mm; `scale` (P,) MPa."""
        weights = wrench_weights(self.compliance, self.found.cells, parts=len(self.traction))
        each = (weights * self.traction.ravel()).reshape(6, len(self.traction), -1).sum(axis=1)
        return scale[:, None] * np.stack([np.bincount(self.of_cells, one, self.count) for one in each], axis=1)

    def noise_covariance(self, scale: Floats) -> Floats:
        """Return the covariance (P, 6, P, 6) of the patches' wrenches by the noise of depth and shear."""
        parts, cells, count = len(self.traction), self.found.cells, self.count
        normal = self.whole.response(self._weights(self.whole.cells, self.of_support, scale, 1))
        found = np.zeros((6 * count, 6 * count))
        if parts == 3:
            weights = self._weights(cells, self.of_cells, scale, 3).reshape(6 * count, 3, -1)
            slopes = self.found.response(weights.reshape(6 * count, -1)).reshape(6 * count, 3, -1)
            for k in (0, 1):
                found += self.seen.noise[k].propagate(slopes[:, k], cells)
            normal[:, self.place] += self._by_shear(weights, slopes, self.found.response)[:, 2]
        found += self.seen.noise[-1].propagate(normal, self.whole.cells)
        return found.reshape(count, 6, count, 6)

    def material_covariance(self, material: Material, scale: Floats, wrenches: Floats) -> Floats:
        """Return the covariance (P, 6, P, 6) of the patches' wrenches by the calibration's of E and nu."""
        shape, parts = (self.count, 6) * 2, len(self.traction)
        if material.covariance is None:
            return np.zeros(shape)
        pressure = np.zeros((1, len(self.whole.cells)))
        pressure[0, self.place] = self.found.traction[-1]
        softer = self.compliance.by_poisson(self.whole.cells, pressure)
        by_poisson = -self.whole.response(self._weights(self.whole.cells, self.of_support, scale, 1)) @ softer
        if parts == 3:
            weights = self._weights(self.found.cells, self.of_cells, scale, 3).reshape(len(by_poisson), 3, -1)
            softer = self.compliance.by_poisson(self.found.cells, self.found.traction)
            gain = self.found.gain(weights.reshape(len(weights), -1)).reshape(weights.shape)
            by_poisson -= self._by_shear(weights, gain, self.found.gain).reshape(len(weights), -1) @ softer
        slope = np.stack([wrenches.ravel() / material.youngs_modulus_MPa, by_poisson], axis=1)
        return np.asarray(slope @ material.covariance @ slope.T).reshape(shape)

    def model_covariance(self, wrenches: Floats, doubt_N: Floats, scale: Floats, *, cut: bool) -> Floats:
        """Return the covariance (P, 6, 6) by errors of the method, and by force where nothing is known.

        `doubt_N` (P,) is the deviation of the normal force by unknown friction and by large depth.
        """
        found = np.empty((self.count, 6, 6))
        for k, wrench in enumerate(wrenches):
            own, frame = self.of_cells == k, self.frame(k)
            part = replace(self.found, cells=self.found.cells[own], traction=self.traction[:, own])
            force = frame @ np.where(np.isnan(wrench[:3]), 0.0, wrench[:3])
            square = (MODEL_STD * np.linalg.norm(force)) ** 2
            square[:2] += (MODEL_SHEAR * np.linalg.norm(force[:2])) ** 2
            square[2] += (FEW_CELLS * force[2] / self.sizes[k]) ** 2 + doubt_N[k] ** 2
            square += force_beyond(self.grid, part, self.seen, scale=scale[k], cut=cut)
            if self.compliance.surface is not None and len(self.traction) == 1:
                square[:2] += (FRICTION_STD * force[2]) ** 2
            lever, moved = _levers(wrench, self.places_mm[k] if self.compliance.surface is not None else None)
            lever = lever @ frame.T
            found[k] = (lever * square) @ lever.T + MODEL_PLACE_MM**2 * (moved @ moved.T)
        return found

    def records(self, wrenches: Floats, covariance: Floats) -> tuple[Patch, ...]:
        """Return the patches of wrenches (P, 6) with covariance (P, 6, P, 6), N and N mm, numbered from 1."""
        depths = self.mean(self.seen.displacement_mm[-1].ravel()[self.found.cells])
        own = (Wrench.of(wrench, covariance[k, :, k]) for k, wrench in enumerate(wrenches))
        places = [None] * self.count if self.compliance.surface is None else self.places_mm.tolist()
        rows = zip(own, self.areas_mm2.tolist(), depths.tolist(), places, strict=True)
        return tuple(
            patch_of(k, one, area_mm2=area, depth_mm=mm, place_mm=place)
            for k, (one, area, mm, place) in enumerate(rows, start=1)
        )

    def _by_shear(self, weights: Floats, whole: Floats, linear: Callable[[Floats], Floats]) -> Floats:
        """Return the part of `whole` (6 P, 3, C) = linear(weights) that tangential tractions have, in its unit.

        On a flat gel they are fx, fy and mz, and the pressure is the other rows.
        """
        if self.compliance.surface is None:
            along_face = np.tile([1.0, 1.0, 0.0, 0.0, 0.0, 1.0], self.count)
            return np.asarray(whole * along_face[:, None, None])
        along = weights.copy()
        along[:, 2] = 0.0
        return np.asarray(linear(along.reshape(len(along), -1)).reshape(whole.shape))

    def _weights(self, cells: Cells, patch: Cells, scale: Floats, parts: int) -> Floats:
        """Return (6 P, parts n): the wrench of each patch by tractions at `cells` (n,)."""
        mine = np.tile(scale[patch] * (patch == np.arange(self.count)[:, None]), parts)
        weights = wrench_weights(self.compliance, cells, parts=parts)
        return np.asarray((mine[:, None, :] * weights).reshape(6 * self.count, -1))


def find_patches(compliance: Compliance, seen: Observation, found: Solution, left_mm: Floats) -> Patches:
    """Return the patches of a solution that leaves `left_mm` (rows, columns), mm, of the depth."""
    whole, share = unclipped(compliance, seen, found, left_mm)
    support = np.zeros(compliance.grid.shape, dtype=bool)
    support.flat[whole.cells] = True
    numbers = np.asarray(label(support, EIGHT)[0], dtype=np.intp).ravel()[whole.cells]
    return Patches(compliance, seen, found, whole, share, numbers - 1)


def wrench_weights(compliance: Compliance, cells: Cells, *, parts: int) -> Floats:
    """Return (6, parts * C): force and moment by the tractions; parts is 3, or 1 for the normal one alone."""
    grid, surface = compliance.grid, compliance.surface
    if surface is not None:
        axes = surface.frames[cells, 3 - parts :]
        moment = np.cross(surface.places_mm[cells, None], axes)
        return np.asarray(grid.cell_mm2 * np.concatenate([axes, moment], axis=2).transpose(2, 1, 0).reshape(6, -1))
    row, column = np.divmod(cells, grid.shape[1])
    x, y, one, none = grid.x_mm[column], grid.y_mm[row], np.ones(len(cells)), np.zeros(len(cells))
    along_x = np.stack([one, none, none, none, none, -y])
    along_y = np.stack([none, one, none, none, none, x])
    along_z = np.stack([none, none, one, y, -x, none])
    return grid.cell_mm2 * np.concatenate([along_x, along_y, along_z][3 - parts :], axis=1)


def _levers(wrench: Floats, place: Floats | None) -> tuple[Floats, Floats]:
    """Return the change (6, 3) of a wrench (6,), N and N mm, by its force where it acts, and (6, 2) by place."""
    fx, fy, fz = np.where(np.isnan(wrench[:3]), 0.0, wrench[:3])
    x, y, z = (-wrench[4] / fz, wrench[3] / fz, 0.0) if fz > 0 else (0.0, 0.0, 0.0)
    if place is not None:
        x, y, z = place
    lever = np.vstack([np.eye(3), [[0, -z, y], [z, 0, -x], [-y, x, 0]]])
    moved = np.vstack([np.zeros((3, 2)), [[0, fz], [-fz, 0], [fy, -fx]]])
    return lever, moved


class PatchTracker:
    """Numbers of contact patches that stay the same over frames. Not thread-safe.

    A patch keeps the number of the patch of the frame before with which it shares most cells. Each number is given
    once. `numbered` (rows, columns) are those of the last frame, 0 outside.
    """

    def __init__(self) -> None:
        self.numbered: Cells | None = None
        self._next = 1

    def __call__(self, found: TractionMap) -> TractionMap:
        """Return the map (rows, columns) of the next frame, MPa, with these numbers."""
        own = np.zeros(found.t_z.shape, dtype=np.intp) if found.patch_map is None else found.patch_map
        names = self.follow(own)
        patches = sorted(
            (replace(one, number=names[one.number]) for one in found.patches), key=lambda one: one.number
        )
        return replace(found, patches=tuple(patches), patch_map=self.numbered)

    def follow(self, own: Cells) -> dict[int, int]:
        """Return lasting numbers of the patches of a map (rows, columns) of the frame's own numbers, 0 outside."""
        names: dict[int, int] = {}
        if self.numbered is not None:
            both = (own > 0) & (self.numbered > 0)
            pairs, shared = np.unique(np.stack([own[both], self.numbered[both]]), axis=1, return_counts=True)
            for k in np.argsort(-shared, kind="stable"):
                now, before = pairs[:, k].tolist()
                if now not in names and before not in names.values():
                    names[now] = before
        for now in np.unique(own[own > 0]).tolist():
            if now not in names:
                names[now], self._next = self._next, self._next + 1
        table = np.zeros(max(names, default=0) + 1, dtype=np.intp)
        table[list(names)] = list(names.values())
        self.numbered = table[own]
        return names
