"""Map of traction and its resultant from a height map and shear: the step that live code calls for every frame.

Set up once for a gel, a material and a view; each call narrows the contact, solves for the tractions, corrects for
large depth and propagates the uncertainties. Only the first call may change it: it learns the view's size.

Terms of the resultant's standard deviation:
- noise of depth and shear, propagated through the linear map;
- errors of depth and shear that the whole contact shares, propagated as one;
- the material's covariance;
- MODEL_STD of the resultant for cells and mask (rms error over random contacts without noise, benchmarks), and
  FEW_CELLS where the contact is hardly wider than a cell (balls on nonlinear elements: 6 % high on 3 cells);
- without shear, the uncertain share of friction's full effect;
- for a contact cut by a border, the force beyond it if its pressure continued for half the contact's width;
- the force that a hole of the map may hide.

Friction stiffens a punch of a/h .8 by 4 %, one of a/h 1.3 by 11 %, and more with depth. Measured shear contains
its effect. Without shear, with s the share of its full effect, LIKELY_SHARE +- SHARE_STD,

    force = linear, frictionless force (1 + s (stuck - 1)) (1 + s (deep - 1)),

stuck the force of a sticking gel over the frictionless one at the same depth, deep the correction for large depth.
On nonlinear elements (neo-Hooke; punches a/h .37 to 1.7, balls; w/h to .2) s = 1 is within 3 % where nothing slips
or mu is .3 and more, s = .7 at mu = .15, s = 0 without friction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import label

from tactilevision.errors import InputError
from tactilevision.force.compliance import (
    GelCompliance,
    Solution,
    candidate_cells,
    force_beyond,
    gel_compliance,
    is_cut,
    overlooked_cells,
    solve,
)
from tactilevision.force.nodes import Cells, NodeGrid, Observation, lay_grid, observe
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.profile import LIKELY_SHARE, SHARE_STD
from tactilevision.records.constants import TINY
from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.records.maps import HeightMap, ShearMap, TractionMap
from tactilevision.records.measured import Floats, Material, Pair
from tactilevision.records.rig import Gel

# of the force, for fx, fy, fz: error of cells and linear theory; benchmarks.force
MODEL_STD = np.array([0.002, 0.002, 0.008])
FEW_CELLS = 0.08  # of the normal force over the root of the number of cells
BESIDE = 1.0  # thicknesses from a deep contact, within which a weak one is not detected
STILL = 2.0  # thicknesses from a contact, beyond which the gel does not move
MAX_OF_VIEW = 0.9  # of the view: gel that covers less is flagged as small
NO_CONTACT, NO_SHEAR = "no contact", "shear not measured"
ASSUMED = "material_assumed"
Triple = tuple[float, float, float]
CUT = "contact cut by the border of the view or the gel"
SMALL_GEL = "gel smaller than the view"


@dataclass(frozen=True, slots=True)
class ForceSettings:
    """Settings of a force field.

    `spacing_mm` of the cells; `depth_correlation_px` over which pixels share their error (infinite: over a whole
    contact, as in a map integrated from slopes); `sides` accounts for the gel's free sides; `large_depth` for its
    large strain (False: linear elasticity); `cell_std` computes the standard deviation of every traction.
    """

    spacing_mm: float = 0.5
    depth_correlation_px: float = np.inf
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
        compliance: GelCompliance | None = None,
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
        grid, flags = compliance.grid, list(seen.flags)
        flags += [] if compliance.inside.mean() > MAX_OF_VIEW else [SMALL_GEL]
        cells = candidate_cells(seen)
        found = self._solve(compliance, seen, cells) if len(cells) else None
        if found is not None and len(found.cells):
            more = self._overlooked(compliance, seen, cells, found)
            found = self._solve(compliance, seen, np.union1d(cells, more)) if len(more) else found
        if found is None or len(found.cells) == 0:
            return self._nothing(grid, seen, height, *flags)
        flags += [] if len(seen.displacement_mm) == 3 else [NO_SHEAR]
        flags += [CUT] if is_cut(grid, found, seen) else []
        flags += [ASSUMED] if self.material.assumed else []
        return self._report(compliance, seen, found, height, tuple(flags))

    def _prepared(self, height: HeightMap) -> GelCompliance:
        if self.compliance is None:
            self.compliance = self._set_up(height.depth_mm.shape)
        return self.compliance

    def _observe(self, height: HeightMap, shear: ShearMap | None = None) -> Observation:
        own = self._prepared(height)
        return observe(
            own.grid,
            height,
            shear,
            inside=own.inside,
            correlation_px=self.settings.depth_correlation_px,
            away_mm=STILL * self.gel.thickness_mm,
        )

    def touched(self, height: HeightMap) -> bool:
        """Return whether anything may touch: quick, so that a free gel needs no shear. Raises as a call does."""
        return len(candidate_cells(self._observe(height))) > 0

    def without_contact(self, height: HeightMap) -> TractionMap:
        """Return the tractions of a map in which nothing touches: zero, to within the detection limit."""
        seen = self._observe(height)
        return self._nothing(self._prepared(height).grid, seen, height, *seen.flags)

    def _nothing(self, grid: NodeGrid, seen: Observation, height: HeightMap, *flags: str) -> TractionMap:
        """Return zero force along each axis, to within the force of the least contact that would be detected.

        That is a punch of one cell's radius pressed in by what a candidate needs.
        """
        reduced = self.material.youngs_modulus_MPa / (1 - self.material.poisson_ratio**2)
        deepest = -float(seen.displacement_mm[-1].min())
        least = max(CONTACT.patch_sigma * float(np.median(seen.depth_std_mm)), deepest)
        fields, unseen_N = np.zeros((3, grid.shape[0] * grid.shape[1])), 2 * grid.spacing_mm * reduced * least
        std, errors = np.array([unseen_N] * 3 + [np.nan] * 3), np.full_like(fields, np.nan)
        return _as_map(grid, fields, errors, np.zeros(6), std, (*flags, NO_CONTACT), height)

    def _fits(self, made: GelCompliance, view_px: tuple[int, int] | None) -> bool:
        """Return whether a compliance that was made before is one for this material, these settings and view."""
        seen = view_px is None or view_px == made.grid.view_px
        known = made.slopes is not None or self.material.covariance is None
        return seen and known and self.settings.sides and made.grid.spacing_mm == self.settings.spacing_mm

    def _set_up(self, view_px: tuple[int, ...]) -> GelCompliance:
        grid = lay_grid((view_px[0], view_px[1]), self.mm_per_px, spacing_mm=self.settings.spacing_mm)
        slopes, nu = self.material.covariance is not None, self.material.poisson_ratio
        return gel_compliance(self.gel, grid, poisson_ratio=nu, sides=self.settings.sides, slopes=slopes)

    def _overlooked(self, compliance: GelCompliance, seen: Observation, cells: Cells, found: Solution) -> Cells:
        """Return the cells of weak contacts that the displacement by a deep one hides."""
        reach = int(np.ceil(BESIDE * self.gel.thickness_mm / compliance.grid.spacing_mm))
        near = np.zeros(compliance.grid.shape, dtype=np.uint8)
        near.flat[cells] = 1
        near = cv2.dilate(near, np.ones((2 * reach + 1, 2 * reach + 1), dtype=np.uint8))
        moved = compliance.depth(found.cells, found.traction)
        residual = seen.displacement_mm[-1] - moved
        return overlooked_cells(residual, moved, std_mm=seen.depth_std_mm, usable=seen.known & (near == 0))

    def _solve(self, compliance: GelCompliance, seen: Observation, cells: Cells) -> Solution:
        u = seen.displacement_mm.reshape(len(seen.displacement_mm), -1)[:, cells]
        return solve(compliance, cells, displacement_mm=u, std_mm=seen.std_mm)

    def _report(
        self,
        compliance: GelCompliance,
        seen: Observation,
        found: Solution,
        height: HeightMap,
        flags: tuple[str, ...],
    ) -> TractionMap:
        grid, parts = compliance.grid, len(found.traction)
        stiffer, by_share = self._stiffening(compliance, seen, found)
        scale = self.material.youngs_modulus_MPa * stiffer
        weights = wrench_weights(grid, found.cells, parts=parts) * np.tile(scale, parts)
        total = weights @ found.traction.ravel()
        noise = np.repeat(seen.std_mm, len(found.cells))
        variance = self._seen_variance(grid, seen, found, weights, noise)
        variance += self._material_variance(compliance, found, weights, total)
        model = (MODEL_STD * np.linalg.norm(total[:3])) ** 2
        model[2] += (FEW_CELLS * total[2]) ** 2 / len(found.cells)
        if parts == 1:
            model[2] += (SHARE_STD * (weights[2] * by_share @ found.traction[0])) ** 2
        model[2] += _doubtful(grid, found, scale, float(seen.std_mm[-1]), self.material.poisson_ratio) ** 2
        variance[:3] += model
        variance[:3] += force_beyond(grid, found, seen, scale=scale, cut=CUT in flags)
        std, fields = np.sqrt(variance), np.zeros((3, grid.shape[0] * grid.shape[1]))
        fields[3 - parts :, found.cells] = found.traction * scale
        errors = np.full_like(fields, np.nan)
        if self.settings.cell_std:
            errors[3 - parts :, found.cells] = found.cell_std(noise) * scale
        if parts == 1:
            fields[:2], total[[0, 1, 5]], std[[0, 1, 5]] = np.nan, np.nan, np.nan
        deepest = float(seen.displacement_mm[-1].ravel()[found.cells].max())
        whole = _as_map(grid, fields, errors, total, std, flags, height)
        return replace(whole, depth_mm=deepest, model_std_N=float(np.sqrt(model[2])))

    def _seen_variance(
        self, grid: NodeGrid, seen: Observation, found: Solution, weights: Floats, noise: Floats
    ) -> Floats:
        """Return the variance (6,) of force and moment, N² and (N mm)², by the errors of what is seen.

        `noise` (parts C,) mm is that of each cell alone; a whole contact shares the rest.
        """
        variance = np.diag(found.propagate(weights, noise)).copy()
        if not np.isfinite(self.settings.depth_correlation_px):
            variance += found.shift(weights, seen.depth_std_mm.ravel()[found.cells]) ** 2
        if len(found.traction) == 3 and seen.shear_std_mm > 0:
            shared = np.full(len(found.cells), seen.shear_std_mm * _share(grid, found, seen.shear_alike_mm))
            variance += found.shift(weights, shared, 0) ** 2 + found.shift(weights, shared, 1) ** 2
        return np.asarray(variance)

    def _stiffening(self, compliance: GelCompliance, seen: Observation, found: Solution) -> tuple[Floats, Floats]:
        """Return the factor (C,) on the linear tractions, and its log-derivative by friction's share."""
        deep = np.ones(len(found.cells))
        if self.settings.large_depth:
            deep = depth_factors(
                compliance.grid,
                found.cells,
                pressure=found.traction[-1],
                displacement_mm=seen.displacement_mm,
                gel=self.gel,
                poisson_ratio=self.material.poisson_ratio,
            )
        if len(found.traction) == 3:
            return deep, np.zeros(len(deep))
        more = np.stack([deep - 1, np.full(len(deep), self._sticking(compliance, seen, found))])
        return np.prod(1 + LIKELY_SHARE * more, axis=0), np.sum(more / (1 + LIKELY_SHARE * more), axis=0)

    def _sticking(self, compliance: GelCompliance, seen: Observation, found: Solution) -> float:
        """Return by what fraction the normal force would be greater if the gel had not slipped at all,
        linearly.
        """
        depth = seen.displacement_mm[-1].ravel()[found.cells]
        held = np.stack([0 * depth, 0 * depth, depth])
        std = np.repeat(seen.std_mm[-1:], 3)
        stuck = solve(compliance, found.cells, displacement_mm=held, std_mm=std, adhesive=True)
        return max(0.0, float(stuck.traction[2].sum() / found.traction[0].sum()) - 1)

    def _material_variance(
        self, compliance: GelCompliance, found: Solution, weights: Floats, total: Floats
    ) -> Floats:
        """Return the variance (6,) of force and moment that the calibration's own covariance of (E, nu)
        implies.
        """
        covariance = self.material.covariance
        if covariance is None:
            return np.zeros(6)
        by_modulus = total / self.material.youngs_modulus_MPa
        by_poisson = -found.gain(weights) @ (
            compliance.by_poisson(found.cells, len(found.traction)) @ found.traction.ravel()
        )
        slope = np.stack([by_modulus, by_poisson], axis=1)
        return np.asarray(np.einsum("ki,ij,kj->k", slope, covariance, slope))


def wrench_weights(grid: NodeGrid, cells: np.ndarray[tuple[int], np.dtype[np.intp]], *, parts: int) -> Floats:
    """Return (6, parts * C): force and moment by the tractions; parts is 3, or 1 for the normal one alone."""
    row, column = np.divmod(cells, grid.shape[1])
    x, y, one, none = grid.x_mm[column], grid.y_mm[row], np.ones(len(cells)), np.zeros(len(cells))
    along_x = np.stack([one, none, none, none, none, -y])
    along_y = np.stack([none, one, none, none, none, x])
    along_z = np.stack([none, none, one, y, -x, none])
    return grid.cell_mm2 * np.concatenate([along_x, along_y, along_z][3 - parts :], axis=1)


def _share(grid: NodeGrid, found: Solution, alike_mm: float) -> float:
    """Return the share of an error that is constant over `alike_mm` that remains in the mean over the contact."""
    width = 2 * float(np.sqrt(len(found.cells) * grid.cell_mm2 / np.pi))
    return min(1.0, alike_mm / width)


def _doubtful(grid: NodeGrid, found: Solution, scale: Floats, std_mm: float, poisson_ratio: float) -> float:
    """Return the force of the cells whose pressure is within two deviations of none: noise that may not pull only
    pushes.
    """
    pressure = found.traction[-1]
    noise = std_mm / (grid.spacing_mm * (1 - poisson_ratio**2))
    return float(grid.cell_mm2 * (pressure * scale)[pressure < 2 * noise].sum())


def triple(values: Floats) -> Triple:
    """Return values (3,) as three plain numbers, in their N or N mm."""
    return (float(values[0]), float(values[1]), float(values[2]))


def _as_map(grid: NodeGrid, fields: Floats, errors: Floats, total: Floats, std: Floats, flags: tuple[str, ...],
            height: HeightMap) -> TractionMap:  # fmt: skip
    maps = fields.reshape(3, *grid.shape)
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
    )


# Correction of the linear layer for large depth: thinner gel under a contact, and a stretched contact.
#
#     factor = [a' kappa(nu, a'/h')] / [a kappa(nu, a/h)],    a' = a (1 + e/2),    h' = h - w a^2/(a^2 + h^2)
#
# per patch of touching cells: a = sqrt(area/pi), w the mean depth weighted by the pressure, e the patch's mean
# surface stretch du_x/dx + du_y/dy. The weight joins two limits: a wide patch thins the gel by its whole depth, a
# narrow one strains it only near by. The factor is 1 at w = 0. Without shear e = 0, as for a sticking gel; a
# sliding gel stretches and responds as the linear layer does.
#
# No number is fitted, but the form was chosen on nonlinear finite elements (neo-Hooke, flat punches a/h .5 to
# 1.33, nu .45 to .48, friction 0, .3 and no slip): there the linear resultant is 5 % low at w/h = .1 and 3 to 19
# % at .2, the corrected one within 2.4 %. Held-out cases (balls of 4 and 6 mm, punches of 1.1, 3.2 and 5 mm, nu
# .42 to .48, any friction) are within 3.4 %, most within 2 %. Source of kappa: Hayes et al. (1972), as in
# mechanics/kappa.py.

WIDEST = 3  # largest a/h: kappa's table ends there
THINNEST = 0.5  # largest w/h of a known factor


def depth_factors(
    grid: NodeGrid,
    cells: np.ndarray[tuple[int], np.dtype[np.intp]],
    *,
    pressure: Floats,
    displacement_mm: Floats,
    gel: Gel,
    poisson_ratio: float,
) -> Floats:
    """Return the factor (C,) on the tractions of `cells`.

    `displacement_mm` (3 or 1, rows, columns): x, y, z, or z alone without shear.
    """
    touching = np.zeros(grid.shape, dtype=bool)
    touching.flat[cells] = True
    patches, count = label(touching)
    which = patches.ravel()[cells] - 1
    weight = np.maximum(pressure, 0) + TINY
    depth = np.bincount(which, weight * displacement_mm[-1].ravel()[cells], count) / np.bincount(
        which, weight, count
    )
    size = np.bincount(which, minlength=count)
    stretch = np.zeros(count)
    if len(displacement_mm) == 3:
        along_x, along_y = (np.gradient(displacement_mm[k], grid.spacing_mm, axis=1 - k) for k in (0, 1))
        stretch = np.bincount(which, (along_x + along_y).ravel()[cells], count) / size
    factor = patch_factor(
        np.sqrt(size * grid.cell_mm2 / np.pi),
        depth,
        stretch=stretch,
        thickness_mm=gel.thickness_mm,
        poisson_ratio=poisson_ratio,
    )
    return factor[which]


def patch_factor(
    radius_mm: Floats, depth_mm: Floats, *, stretch: Floats, thickness_mm: float, poisson_ratio: float
) -> Floats:
    """Return the factor of each patch (n,), a ratio, from arrays (n,)."""
    depth = np.clip(depth_mm, 0, THINNEST * thickness_mm)
    thinner = thickness_mm - depth * radius_mm**2 / (radius_mm**2 + thickness_mm**2)
    wider = radius_mm * (1 + np.clip(stretch, -0.5, 0.5) / 2)
    now, before = (np.minimum(a / h, WIDEST) for a, h in ((wider, thinner), (radius_mm, thickness_mm)))
    return np.asarray(
        wider * fast_kappa(poisson_ratio, now) / (radius_mm * fast_kappa(poisson_ratio, before)), dtype=np.float64
    )
