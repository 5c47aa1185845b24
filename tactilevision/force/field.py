"""Map of traction and its resultant from a height map and shear: the step that live code calls for every frame.

Set up once for a gel, a material and a view; each call narrows the contact, solves for the tractions, corrects for
large depth and propagates the uncertainties. Only the first call may change it: it learns the view's size.

Terms of the wrench's covariance (patches.py):
- noise of depth and shear (noise.py), propagated through the linear map;
- the material's covariance;
- MODEL_STD of the resultant for cells and mask (rms error over random contacts without noise, benchmarks), and
  FEW_CELLS where the contact is hardly wider than a cell (balls on nonlinear elements: 6 % high on 3 cells);
- without shear, the uncertain share of friction's full effect;
- for a contact cut by a border, the force beyond it if its pressure continued for half the contact's width;
- the force that a hole of the map may hide.

Friction stiffens a punch of a/h .8 by 4 %, one of a/h 1.3 by 11 %, and more with depth. Measured shear contains
its effect. Without shear, s is the share of its full effect: either all or nothing, all with the probability p =
LIKELY_SHARE, so its mean is p and its variance p (1 - p), and

    force = linear, frictionless force (1 + s (stuck - 1)) (1 + s (deep - 1)),

stuck the force of a sticking gel over the frictionless one at the same depth, deep the correction for large depth.
On nonlinear elements (neo-Hooke; punches a/h .37 to 1.7, balls; w/h to .2) s = 1 is within 3 % where nothing slips
or mu is .3 and more, s = .7 at mu = .15, s = 0 without friction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.force.compliance import (
    Compliance,
    Solution,
    candidate_cells,
    compliance_for,
    is_cut,
    overlooked_cells,
    solve,
)
from tactilevision.force.mesh_compliance import MeshCompliance
from tactilevision.force.nodes import Cells, NodeGrid, cell_means, lay_grid
from tactilevision.force.observe import Observation, observe, with_residual
from tactilevision.force.patches import MODEL_DEEP, Patches, find_patches
from tactilevision.force.slip import find_slip
from tactilevision.force.unseen import Unseen
from tactilevision.gel.surface import SurfaceCells
from tactilevision.mechanics.profile import LIKELY_SHARE
from tactilevision.records.constants import Z90
from tactilevision.records.maps import HeightMap, ShearMap, TractionMap
from tactilevision.records.measured import Bools, Floats, Material, Pair
from tactilevision.records.rig import Gel
from tactilevision.records.wrench import triple

BESIDE = 1.0  # thicknesses from a deep contact, within which a weak one is not detected
STILL = 2.0  # thicknesses from a contact, beyond which the gel does not move
MAX_OF_VIEW = 0.9  # of the view: gel that covers less is flagged as small
NO_CONTACT, NO_SHEAR = "no contact", "shear not measured"
ASSUMED = "material_assumed"
CUT = "contact cut by the border of the view or the gel"
SMALL_GEL = "gel smaller than the view"
DEEP = "deeper than the presses of the calibration: its stiffening is extrapolated"
BEYOND = 1.1  # of the deepest and the fastest press: less is their own error


@dataclass(frozen=True, slots=True)
class ForceSettings:
    """Settings of a force field.

    `spacing_mm` of the cells; `sides` accounts for the gel's free sides; `large_depth` for its large strain
    (False: linear elasticity); `cell_std` computes the standard deviation of every traction.
    """

    spacing_mm: float = 0.5
    sides: bool = True
    large_depth: bool = True
    cell_std: bool = True


class ForceField:
    """Map from depth and shear to traction: `ForceField(gel, material, mm_per_px)(height, shear)`.

    `view_px` of the maps sets it up at once, else the first map does; `compliance` is the gel's if it was computed
    before. Without shear fx and fy are NaN.
    """

    def __init__(
        self,
        gel: Gel,
        material: Material,
        mm_per_px: Pair,
        *,
        view_px: tuple[int, int] | None = None,
        settings: ForceSettings | None = None,
        compliance: Compliance | None = None,
    ) -> None:
        self.gel, self.material, self.mm_per_px = gel, material, mm_per_px
        self.settings = ForceSettings() if settings is None else settings
        self.compliance = compliance if compliance is not None and self._fits(compliance, view_px) else None
        if self.compliance is None and view_px is not None:
            self.compliance = self._set_up(view_px)

    def __call__(self, height: HeightMap, shear: ShearMap | None = None) -> TractionMap:
        """Return the traction on the gel at the moment of `height`.

        Raises InputError for maps of another scale or size.
        """
        if not isinstance(height, HeightMap):
            raise InputError(
                "a force field takes a height map",
                where="ForceField",
                value=type(height).__name__,
                remedy="Make one with reconstructor.height_map(rgb), or HeightMap(...) of other depths.",
            )
        compliance, seen = self._prepared(height), self._observe(height, shear)
        grid, flags, cells = compliance.grid, self._flags(seen), candidate_cells(seen)
        if len(cells) == 0:
            return self._nothing(grid, seen, height, *flags)
        found = self._solve(compliance, seen, cells)
        if len(found.cells):
            seen, left = self._after(compliance, seen, found)
            more = self._overlooked(compliance, seen, cells, left)
            if len(more):
                found = self._solve(compliance, seen, np.union1d(cells, more))
                seen, left = self._after(compliance, seen, found)
        if len(found.cells) == 0:
            return self._nothing(grid, seen, height, *flags)
        flags += [] if len(seen.displacement_mm) == 3 else [NO_SHEAR]
        flags += [CUT] if is_cut(grid, found, seen) else []
        flags += [ASSUMED] if self.material.assumed else []
        deepest = self.material.deepest_mm
        flags += [DEEP] if deepest and self._depth(seen, found) > BEYOND * deepest else []
        return self._report(find_patches(compliance, seen, found, left), height, tuple(flags))

    def _prepared(self, height: HeightMap) -> Compliance:
        if self.compliance is None:
            self.compliance = self._set_up(height.depth_mm.shape)
        return self.compliance

    def _observe(self, height: HeightMap, shear: ShearMap | None = None) -> Observation:
        own = self._prepared(height)
        away_mm = STILL * self.gel.thickness_mm
        seen = observe(own.grid, height, shear, inside=own.inside, away_mm=away_mm, surface=own.surface)
        if isinstance(own, MeshCompliance):
            own.check_depth(seen.displacement_mm[-1], seen.known)
            if shear is not None:
                own.check_shear(cell_means(own.grid, shear.u_x_mm, valid=shear.valid)[1])
        return seen

    def _flags(self, seen: Observation) -> list[str]:
        assert self.compliance is not None
        return [*seen.flags, *([] if self.compliance.inside.mean() > MAX_OF_VIEW else [SMALL_GEL])]

    def free(self, height: HeightMap) -> TractionMap | None:
        """Return the tractions of a map in which nothing touches, so that a free gel needs no shear; else None.

        Raises as a call does.
        """
        seen = self._observe(height)
        if len(candidate_cells(seen)):
            return None
        return self._nothing(self._prepared(height).grid, seen, height, *self._flags(seen))

    def without_contact(self, height: HeightMap) -> TractionMap:
        """Return the tractions of a map in which nothing touches: zero, to within the detection limit."""
        seen = self._observe(height)
        return self._nothing(self._prepared(height).grid, seen, height, *seen.flags)

    def _nothing(self, grid: NodeGrid, seen: Observation, height: HeightMap, *flags: str) -> TractionMap:
        """Return zero normal force, whose deviation is that of an upper limit, and zero shear where it is seen.

        A hidden force lies anywhere on the cells that are known; friction below 1 limits its shear.
        """
        seen, material = with_residual(seen, seen.displacement_mm[-1], seen.far), self.material
        rel = (
            0.0
            if material.covariance is None
            else np.sqrt(material.covariance[0, 0]) / material.youngs_modulus_MPa
        )
        hidden_N = material.youngs_modulus_MPa * self._unseen.limit(seen, relative_std=float(rel))
        count = np.count_nonzero(seen.known)
        arm_x, arm_y = (
            np.sqrt(seen.known.sum(axis=axis) @ one**2 / count) if count else np.nan
            for axis, one in enumerate((grid.x_mm, grid.y_mm))
        )
        levers = np.array([1.0, 1.0, 1.0, arm_y, arm_x, np.hypot(arm_x, arm_y)])
        fields, total = np.zeros((3, seen.known.size)), np.zeros((1, 6))
        covariance = np.diag((levers * hidden_N / Z90) ** 2).reshape(1, 6, 1, 6)
        if len(seen.displacement_mm) == 1:
            flags = (*flags, NO_SHEAR)
            _forget_shear(fields, total, covariance)
        errors = np.full_like(fields, np.nan)
        found = _as_map(grid, fields, errors, total[0], covariance[0, :, 0], (*flags, NO_CONTACT), height)
        return replace(_on_surface(found, self._prepared(height)), could_hide_N=hidden_N)

    @cached_property
    def _unseen(self) -> Unseen:
        assert self.compliance is not None
        return Unseen(self.compliance)

    def _fits(self, made: Compliance, view_px: tuple[int, int] | None) -> bool:
        """Return whether a compliance that was made before is one for this material, these settings and view."""
        seen = view_px is None or view_px == made.grid.view_px
        known = made.slopes is not None or self.material.covariance is None
        return seen and known and self.settings.sides and made.grid.spacing_mm == self.settings.spacing_mm

    def _set_up(self, view_px: tuple[int, ...]) -> Compliance:
        grid = lay_grid((view_px[0], view_px[1]), self.mm_per_px, spacing_mm=self.settings.spacing_mm)
        slopes, nu = self.material.covariance is not None, self.material.poisson_ratio
        return compliance_for(self.gel, grid, poisson_ratio=nu, sides=self.settings.sides, slopes=slopes)

    def _after(self, compliance: Compliance, seen: Observation, found: Solution) -> tuple[Observation, Floats]:
        """Return the observation with the noise of the residual, and the residual depth (rows, columns), mm."""
        left = seen.displacement_mm[-1] - compliance.depth(found.cells, found.traction)
        return with_residual(seen, left, seen.known & ~self._near(compliance, found.cells)), left

    def _near(self, compliance: Compliance, cells: Cells) -> Bools:
        """Return the cells (rows, columns) within BESIDE thicknesses of `cells`."""
        reach = int(np.ceil(BESIDE * self.gel.thickness_mm / compliance.grid.spacing_mm))
        near = np.zeros(compliance.grid.shape, dtype=np.uint8)
        near.flat[cells] = 1
        return np.asarray(cv2.dilate(near, np.ones((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)), dtype=bool)

    def _overlooked(self, compliance: Compliance, seen: Observation, cells: Cells, left: Floats) -> Cells:
        """Return the cells of weak contacts that the displacement by a deep one hides."""
        usable = seen.known & ~self._near(compliance, cells)
        moved = seen.displacement_mm[-1] - left
        return overlooked_cells(left, moved, std_mm=seen.depth_std_mm, usable=usable)

    def _solve(self, compliance: Compliance, seen: Observation, cells: Cells) -> Solution:
        u = seen.displacement_mm.reshape(len(seen.displacement_mm), -1)[:, cells]
        return solve(compliance, cells, displacement_mm=u, std_mm=seen.std_mm)

    def _report(self, patches: Patches, height: HeightMap, flags: tuple[str, ...]) -> TractionMap:
        seen, found, grid = patches.seen, patches.found, patches.grid
        parts = len(found.traction)
        stiffer, doubt = self._stiffening(patches)
        scale = self.material.youngs_modulus_MPa * stiffer
        wrenches = patches.wrenches(scale)
        doubt_N = np.hypot(doubt, (1 - patches.share) * patches.excess) * wrenches[:, 2]
        model = patches.model_covariance(wrenches, doubt_N, scale, cut=CUT in flags)
        every = patches.noise_covariance(scale) + patches.material_covariance(self.material, scale, wrenches)
        for k, more in enumerate(model):
            every[k, :, k] += more
        fields, errors = np.zeros((3, seen.known.size)), np.full((3, seen.known.size), np.nan)
        fields[3 - parts :, found.cells] = patches.traction * scale[patches.of_cells]
        if self.settings.cell_std:
            noise = np.concatenate([one.total.ravel()[found.cells] for one in seen.noise])
            errors[3 - parts :, found.cells] = found.cell_std(noise) * scale[patches.of_cells]
        if patches.compliance.surface is not None:
            _turn_to_picture(patches.compliance.surface, found.cells, fields, errors)
        if parts == 1:
            _forget_shear(fields, wrenches, every)
        total, covariance = wrenches.sum(axis=0), every.sum(axis=(0, 2))
        whole = _on_surface(_as_map(grid, fields, errors, total, covariance, flags, height), patches.compliance)
        numbers = np.zeros(grid.shape, dtype=np.intp)
        numbers.flat[found.cells] = patches.of_cells + 1
        return replace(
            whole,
            depth_mm=self._depth(seen, found),
            model_std_N=float(np.sqrt(model[:, 2, 2].sum())),
            patch_map=numbers,
            patches=tuple(
                replace(one, slip=slip)
                for one, slip in zip(patches.records(wrenches, every), find_slip(patches, scale), strict=True)
            ),
        )

    @staticmethod
    def _depth(seen: Observation, found: Solution) -> float:
        return float(seen.displacement_mm[-1].ravel()[found.cells].max())

    def _stiffening(self, patches: Patches) -> tuple[Floats, Floats]:
        """Return the factor (P,) on the linear tractions, and its relative deviation, by friction and by depth."""
        deep = patches.depth_factors(self.gel) if self.settings.large_depth else np.ones(patches.count)
        if len(patches.found.traction) == 3:
            return deep, MODEL_DEEP * (deep - 1)
        stuck = self._sticking(patches)
        more = np.stack([deep - 1, np.full(len(deep), stuck)])
        by_share = np.sum(more / (1 + LIKELY_SHARE * more), axis=0)
        doubt = np.sqrt(LIKELY_SHARE * (1 - LIKELY_SHARE)) * by_share
        return np.prod(1 + LIKELY_SHARE * more, axis=0), np.hypot(doubt, MODEL_DEEP * (deep - 1))

    def _sticking(self, patches: Patches) -> float:
        """Return by what fraction the normal force would be greater if the touching cells had not slipped at all,
        linearly. Gel that does not touch is free in both cases.
        """
        seen, found = patches.seen, patches.found
        depth = seen.displacement_mm[-1].ravel()[found.cells]
        held = np.stack([0 * depth, 0 * depth, depth])
        std = np.repeat(seen.std_mm[-1:], 3)
        stuck = solve(patches.compliance, found.cells, displacement_mm=held, std_mm=std, adhesive=True)
        return max(0.0, float(stuck.traction[2].sum() / found.traction[0].sum()) - 1)


def _forget_shear(fields: Floats, wrenches: Floats, covariance: Floats) -> None:
    """Set what is not known without shear to NaN: t_x and t_y, and of wrenches (P, 6) fx, fy and mz."""
    unknown = [0, 1, 5]
    fields[:2], wrenches[:, unknown] = np.nan, np.nan
    covariance[:, unknown], covariance[..., unknown] = np.nan, np.nan


def _turn_to_picture(surface: SurfaceCells, cells: Cells, fields: Floats, errors: Floats) -> None:
    """Turn tractions (3, n) at `cells` from local axes to the picture's, per area of the surface; MPa."""
    share, turn = surface.facing[cells], surface.frames[cells]
    fields[:, cells] = share * np.einsum("nai,an->in", turn, fields[:, cells])
    known = np.nan_to_num(errors[:, cells])
    spread = share * np.sqrt(np.einsum("nai,an->in", turn**2, known**2))
    errors[:, cells] = np.where(np.isnan(errors[2, cells]), np.nan, spread)


def _on_surface(found: TractionMap, compliance: Compliance) -> TractionMap:
    """Return the map with areas and normals of a curved surface."""
    surface = compliance.surface
    if surface is None:
        return found
    normal = surface.frames[:, 2].T.reshape(3, *surface.shape)
    return replace(found, area_mm2=surface.area_mm2.reshape(surface.shape), normal=normal)


def _as_map(grid: NodeGrid, fields: Floats, errors: Floats, total: Floats, covariance: Floats,
            flags: tuple[str, ...], height: HeightMap) -> TractionMap:  # fmt: skip
    std, maps = np.sqrt(np.diag(covariance)), fields.reshape(3, *grid.shape)
    return TractionMap(
        t_x=maps[0],
        t_y=maps[1],
        t_z=maps[2],
        mm_per_px=(grid.spacing_mm, grid.spacing_mm),
        resultant_N=triple(total[:3]),
        resultant_std_N=triple(std[:3]),
        flags=flags,
        first_mm=(float(grid.x_mm[0]), float(grid.y_mm[0])),
        std_MPa=errors.reshape(3, *grid.shape),
        moment_Nmm=triple(total[3:]),
        moment_std_Nmm=triple(std[3:]),
        time_s=height.time_s,
        name=height.name,
        covariance=covariance,
    )
