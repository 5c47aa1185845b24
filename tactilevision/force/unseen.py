"""Upper limit of the normal force that a map without contact may hide.

The hidden contact is a flat punch or a ball, pressed in by w, whose contact radius is one thickness of the gel.
Narrower contacts hide less force: .1 to .6 of it for radii of .3 to .6 thicknesses. It displaces the cells by
w T and has the force w P, both of the frictionless layer. At each place the depths u, of standard deviation s,
are compared with T by the filter F, which is T divided by the power of the noise,

    w = sum(F u/s^2) / sum(F T/s^2),

so with 95 % probability no contact has a force above P (w + 1.645 std(w)), w at least 0. The greatest of these
over shapes and places is the limit. On a curved gel it is multiplied by the greatest ratio of the gel's stiffness
under a punch to the layer's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.force.compliance import Compliance
from tactilevision.force.kernel import layer_cells
from tactilevision.force.mesh_compliance import MeshCompliance, punch_ratios
from tactilevision.force.nodes import NodeGrid
from tactilevision.force.noise import likeness
from tactilevision.force.observe import Observation
from tactilevision.records.constants import TINY, Z90
from tactilevision.records.measured import Floats
from tactilevision.robust import median

Waves = npt.NDArray[np.complexfloating]
FLOOR = 0.3  # of the variance: least power that a filter divides by, since templates are not exact
FINE = 6  # fine cells over a radius
SEEN_SHARE = 0.5  # least share of a template's square on known cells
FAINT = 0.05  # of the deepest: shallower cells are not in a template


@dataclass(frozen=True, slots=True)
class Template:
    """Depth (k, k) of the cells by a contact of unit depth, and its force in units of E, N/mm per MPa."""

    depth: Floats
    force: float


@dataclass(frozen=True)
class Unseen:
    """Limits of hidden forces on a gel."""

    compliance: Compliance

    def limit(self, seen: Observation, *, relative_std: float = 0.0) -> float:
        """Return the upper 95 % limit of a hidden normal force in units of E (MPa); NaN where too little is known.

        `relative_std` is the uncertainty of E.
        """
        noise, known = seen.noise[-1], seen.known
        if not known.any():
            return float("nan")
        std = np.maximum(noise.total, TINY)
        weight, (rows, columns) = np.where(known, 1 / std**2, 0.0), known.shape
        parts, count = (noise.white, noise.slow, noise.shared), np.count_nonzero(known)
        white, slow, shared = (float(np.vdot(weight, one * one)) / count for one in parts)
        alike = _slow_power(noise.length_mm / self.compliance.grid.spacing_mm, self._shape)
        power = np.asarray(white + slow * alike, dtype=np.float32)
        divided, typical = np.maximum(power, FLOOR), float(median(weight[known]))
        filters = np.stack([1 / divided, power / divided**2, np.ones_like(power)])
        gain, square, norm = filters.reshape(3, -1) @ self._power.T
        whole = np.abs(self._waves[0][:, 0, 0]) / divided[0, 0]
        spread = np.sqrt(square + shared * whole**2)
        pair = np.stack([weight * seen.displacement_mm[-1], weight]).astype(np.float32) / np.float32(typical)
        spectra = fft.rfft2(pair, self._shape)
        both = np.stack([spectra[0] / divided, spectra[1]])[:, None] * self._waves
        fitted, square = fft.irfft2(both, self._shape)[..., :rows, :columns]
        share = square / norm[:, None, None]
        usable, share = share > SEEN_SHARE, np.maximum(share, FLOOR)
        depth_mm = np.maximum(fitted / (gain[:, None, None] * share), 0.0)
        variance = (spread / gain) ** 2 / np.float32(typical)
        upper_mm = depth_mm + Z90 * np.sqrt(variance[:, None, None] / share + (relative_std * depth_mm) ** 2)
        forces = np.array([one.force for one in self.templates], dtype=np.float32)
        return self._stiffer * float(np.max(forces[:, None, None] * upper_mm, where=usable, initial=0.0))

    @cached_property
    def templates(self) -> tuple[Template, ...]:
        """Return the contacts that may hide."""
        cell_mm, thickness = self.compliance.grid.spacing_mm, self.compliance.gel.thickness_mm
        return _templates(
            max(thickness, cell_mm), cell_mm, thickness_mm=thickness, poisson_ratio=self.compliance.poisson_ratio
        )

    @cached_property
    def _stiffer(self) -> float:
        """Return the greatest stiffness of a curved gel under a punch over that of the flat layer, 1 at least."""
        own = self.compliance
        return max(1.0, float(punch_ratios(own).max())) if isinstance(own, MeshCompliance) else 1.0

    @cached_property
    def _shape(self) -> tuple[int, int]:
        """Return the shape of a transform in which no template wraps onto the cells."""
        widest = max(len(one.depth) for one in self.templates)
        rows, columns = (fft.next_fast_len(n + widest, real=True) for n in self.compliance.grid.shape)
        return rows, columns

    @cached_property
    def _waves(self) -> Waves:
        """Return the conjugate transforms (2, templates, ky, kx) of the templates and of their squares."""
        placed = np.zeros((len(self.templates), *self._shape), dtype=np.float32)
        for to, one in zip(placed, self.templates, strict=True):
            half = len(one.depth) // 2
            to[: len(one.depth), : len(one.depth)] = one.depth
            to[:] = np.roll(to, (-half, -half), axis=(0, 1))
        return np.asarray(np.conj(fft.rfft2(np.stack([placed, placed**2]))))

    @cached_property
    def _power(self) -> Floats:
        """Return the weights (templates, ky * kx) whose product with a power is that of the templates, summed over
        the plane whose half the transforms hold.
        """
        twice = np.full(self._shape[1] // 2 + 1, 2.0 / np.prod(self._shape))
        twice[0] /= 2
        if self._shape[1] % 2 == 0:
            twice[-1] /= 2
        power = np.abs(self._waves[0]) ** 2 * twice
        return np.asarray(power.reshape(len(power), -1), dtype=np.float32)


@lru_cache(maxsize=32)
def _slow_power(length: float, shape: tuple[int, int]) -> Floats:
    """Return the power (ky, kx) of slow noise of unit deviation, for a correlation `length` in cells."""
    down, across = (likeness(length, n)[np.minimum(np.arange(n), n - np.arange(n))] for n in shape)
    return np.maximum(fft.rfft2(np.outer(down, across)).real, 0.0)


def _templates(
    radius_mm: float, cell_mm: float, *, thickness_mm: float, poisson_ratio: float
) -> tuple[Template, Template]:
    """Return the punch and the ball of a contact radius, solved on cells finer than the radius.

    The pressure of a ball is that of depths d - r^2/2R, where d and R leave none at the edge.
    """
    split = int(np.ceil(FINE * cell_mm / radius_mm))
    fine_mm, count = cell_mm / split, (2 * int(np.ceil((radius_mm + thickness_mm / 2) / cell_mm)) + 1) * split
    grid = NodeGrid((count, count), fine_mm, (count, count), (fine_mm, fine_mm))
    layer = layer_cells(grid, thickness_mm=thickness_mm, poisson_ratio=poisson_ratio)
    r = np.hypot(*np.meshgrid(grid.x_mm, grid.y_mm)).ravel()
    touching = np.flatnonzero(r <= radius_mm)
    punch, bowl = np.linalg.solve(
        layer.block(touching, 1), np.stack([np.ones(len(touching)), r[touching] ** 2], axis=1)
    ).T
    edge = r[touching] > radius_mm - fine_mm
    level = float(bowl[edge].sum() / punch[edge].sum())
    kernel = layer.table.reshape(2 * count - 1, 2 * count - 1, 9)[..., 8]
    found, size = [], [fft.next_fast_len(2 * count - 1, real=True)] * 2  # of fields without wrapping
    waves, inner = fft.rfft2(kernel, size), slice(count - 1, 2 * count - 1)
    for pressure in (punch, np.maximum(level * punch - bowl, 0.0) / level):
        field = np.zeros((count, count))
        field.flat[touching] = pressure
        moved = fft.irfft2(waves * fft.rfft2(field, size), size)[inner, inner]
        cells = moved.reshape(count // split, split, count // split, split).mean(axis=(1, 3))
        found.append(Template(np.where(cells > FAINT, cells, 0.0), float(pressure.sum() * fine_mm**2)))
    return found[0], found[1]
