"""Upper limit of the normal force that a map without contact may hide.

A hidden contact is a flat punch or a ball, its contact radius a from one cell to one thickness, pressed in by w. It
sinks the cells by w T_a and has the force w P_a, both of the frictionless layer. At every place the depths u with
deviation s fit

    w = sum(T u / s^2) / sum(T^2 / s^2),    std(w)^2 = sum over cells of cov(f, f),    f = T / s^2 / sum(T^2 / s^2)

so with 95 % probability no contact has more than P_a (w + 1.645 std(w)); the greatest of these over shapes, radii and
places is the limit, at least that of w = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.signal import fftconvolve

from tactilevision.force.compliance import GelCompliance
from tactilevision.force.kernel import layer_cells
from tactilevision.force.nodes import NodeGrid
from tactilevision.force.noise import likeness
from tactilevision.force.observe import Observation
from tactilevision.records.constants import TINY, Z90
from tactilevision.records.measured import Floats

Waves = npt.NDArray[np.complexfloating]
RADII = 4  # contact radii from one cell to one thickness, in equal steps of their logarithm
FINE = 6  # fine cells over a radius
SEEN_SHARE = 0.5  # least share of a template's square on known cells
FAINT = 0.05  # of the deepest: cells of a template beyond are left out


@dataclass(frozen=True, slots=True)
class Template:
    """Depth (k, k) of the cells by a contact of unit depth, and its force in units of E, N/mm per MPa."""

    depth: Floats
    force: float

    def alike(self, length: float) -> tuple[float, float, float]:
        """Return by what white, slow and shared noise of equal size count, for a correlation `length` in cells."""
        near = np.abs(np.subtract.outer(*[np.arange(len(self.depth))] * 2))
        along = likeness(length, len(self.depth))[near]
        square = float((self.depth**2).sum())
        slow = float((self.depth * (along @ self.depth @ along)).sum())
        return 1.0, slow / square, float(self.depth.sum()) ** 2 / square


@dataclass(frozen=True)
class Unseen:
    """Limits of hidden forces on a gel."""

    compliance: GelCompliance

    def limit(self, seen: Observation, *, relative_std: float = 0.0) -> float:
        """Return the upper 95 % limit of a hidden normal force in units of E (MPa); NaN where too little is known.

        `relative_std` is the uncertainty of E.
        """
        noise, known = seen.noise[-1], seen.known
        if not known.any():
            return float("nan")
        std = np.maximum(noise.total, TINY)
        weight, (rows, columns) = np.where(known, 1 / std**2, 0.0), known.shape
        (times, squares), most = self._waves, self._most
        pair = np.stack([weight * seen.displacement_mm[-1], weight]).astype(np.float32)
        spectra = fft.rfft2(pair, self._shape)
        fitted, square = (
            fft.irfft2(one * form, self._shape)[:, :rows, :columns]
            for one, form in zip(spectra, (times, squares), strict=True)
        )
        usable = square > SEEN_SHARE * np.median(weight[known]) * most[:, None, None]
        found_mm = np.where(usable, fitted / np.maximum(square, TINY), 0.0)
        shares = [
            float(np.mean((one[known] / std[known]) ** 2)) for one in (noise.white, noise.slow, noise.shared)
        ]
        spread = np.sqrt(self._alike(noise.length_mm / self.compliance.grid.spacing_mm) @ shares)[
            :, None, None
        ] / np.sqrt(np.maximum(square, TINY))
        depth_mm = np.maximum(found_mm, 0.0)
        upper_mm = depth_mm + Z90 * np.hypot(spread, relative_std * depth_mm)
        forces = np.array([one.force for one in self.templates])
        return float(np.max(forces[:, None, None] * upper_mm, where=usable, initial=0.0))

    @cached_property
    def templates(self) -> tuple[Template, ...]:
        """Return the contacts that may hide."""
        grid, thickness = self.compliance.grid, self.compliance.gel.thickness_mm
        radii = np.geomspace(grid.spacing_mm, max(thickness, grid.spacing_mm), RADII)
        nu = self.compliance.poisson_ratio
        return tuple(
            one for a in radii for one in _templates(a, grid.spacing_mm, thickness_mm=thickness, poisson_ratio=nu)
        )

    @cached_property
    def _shape(self) -> tuple[int, int]:
        """Return the shape of a transform in which no template wraps onto the cells."""
        widest = max(len(one.depth) for one in self.templates)
        rows, columns = (fft.next_fast_len(n + widest, real=True) for n in self.compliance.grid.shape)
        return rows, columns

    @cached_property
    def _waves(self) -> tuple[Waves, Waves]:
        """Return the conjugate transforms (templates, ky, kx) of the templates and of their squares."""
        placed = np.zeros((len(self.templates), *self._shape), dtype=np.float32)
        for to, one in zip(placed, self.templates, strict=True):
            half = len(one.depth) // 2
            to[: len(one.depth), : len(one.depth)] = one.depth
            to[:] = np.roll(to, (-half, -half), axis=(0, 1))
        return np.conj(fft.rfft2(placed)), np.conj(fft.rfft2(placed**2))

    def _alike(self, length: float) -> Floats:
        """Return (templates, 3) as Template.alike; lengths are few."""
        if length not in self._known:
            self._known[length] = np.array([one.alike(length) for one in self.templates])
        return self._known[length]

    @cached_property
    def _known(self) -> dict[float, Floats]:
        return {}

    @cached_property
    def _most(self) -> Floats:
        """Return the sum of squares (templates,) of each template."""
        return np.array([float((one.depth**2).sum()) for one in self.templates])


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
    found = []
    for pressure in (punch, np.maximum(level * punch - bowl, 0.0) / level):
        field = np.zeros((count, count))
        field.flat[touching] = pressure
        moved = fftconvolve(kernel, field, mode="valid")
        cells = moved.reshape(count // split, split, count // split, split).mean(axis=(1, 3))
        found.append(Template(np.where(cells > FAINT, cells, 0.0), float(pressure.sum() * fine_mm**2)))
    return found[0], found[1]
