"""The gel's surface as triangles: dense where it is steep, with the normals that the height map has there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.records.measured import Bools, Floats
from tactilevision.synthetic.gel import Area, Grid, Singles, Surface

_FINER = 3  # places for each pixel where it is steep
_COARSER = 6  # of these places, one in so many elsewhere: every second pixel
_MARGIN_PX = 64  # of gel around what the camera sees


@dataclass(frozen=True, slots=True, eq=False)
class HeightField:
    """`depth_mm` (H, W) at columns `x_mm` (W,) and rows `y_mm` (H,), not evenly spaced; z into the gel."""

    x_mm: Floats
    y_mm: Floats
    depth_mm: Singles

    def vertices(self) -> Singles:
        """(H W, 3) with y upwards, so that the axes are right-handed."""
        x, y = np.meshgrid(self.x_mm, self.y_mm)
        return np.stack([x, -y, self.depth_mm], axis=-1).reshape(-1, 3).astype(np.float32)

    def normals(self) -> Singles:
        """(H W, 3), towards the camera."""
        q, p = np.gradient(self.depth_mm.astype(np.float64), self.y_mm, self.x_mm)
        normal = np.stack([-p, q, np.ones_like(p)], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return normal.reshape(-1, 3).astype(np.float32)

    def faces(self) -> npt.NDArray[np.uint32]:
        """(2 (H - 1) (W - 1), 3) vertices of each triangle."""
        number = np.arange(self.depth_mm.size, dtype=np.uint32).reshape(self.depth_mm.shape)
        a, b, c, d = (
            part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
        )
        return np.concatenate([np.stack([a, c, b], axis=-1), np.stack([b, c, d], axis=-1)])


def height_field(surface: Surface, seen: Grid) -> HeightField:
    """The surface on the grid that the camera sees (its pixels) and around it."""
    fine = Grid(*(_finer(axis) for axis in (seen.x_mm, seen.y_mm)))
    depth = surface.depth_mm(fine)
    columns = _kept(fine.x_mm, [(area.centre_mm[0], area.half_mm[0]) for area in surface.steep])
    rows = _kept(fine.y_mm, [(area.centre_mm[1], area.half_mm[1]) for area in surface.steep])
    return HeightField(fine.x_mm[columns], fine.y_mm[rows], depth[np.ix_(rows, columns)])


def whole(seen: Grid) -> Area:
    """The area of a whole grid."""
    half = float(seen.x_mm[-1] - seen.x_mm[0]) / 2, float(seen.y_mm[-1] - seen.y_mm[0]) / 2
    return Area((0.0, 0.0), half)


def _finer(axis: Floats) -> Floats:
    step = (axis[1] - axis[0]) / _FINER
    count = (axis.size + 2 * _MARGIN_PX) * _FINER
    middle = (axis[0] + axis[-1]) / 2
    return np.asarray(middle + (np.arange(count) - (count - 1) / 2) * step)


def _kept(axis: Floats, spans: list[tuple[float, float]]) -> Bools:
    kept = np.zeros(axis.size, bool)
    kept[::_COARSER] = kept[-1] = True
    for middle, half in spans:
        kept |= np.abs(axis - middle) <= half
    return kept
