"""The seen surface of a gel in the cells of the picture: places, local axes, areas, thickness, and nodal shares.

Pixel (x, y) of the rectified picture is the point of the untouched surface at (x, y, z0(x, y)), whether rays are
parallel to z or meet in the camera's pinhole at (0, 0, D), which sees that point at (x, y) D/(D - z0) in the
plane z = 0. A cell is the part of the surface over a square of the picture. Its load is a force
per area of the picture, s = t dA/(dx dy), so the nodal shares of a unit load are means of shape functions over it,

    b_n = mean of N_n over the square,

whatever the surface's slope, and with that area compliances are symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from tactilevision.errors import InputError
from tactilevision.gel.elements import Ints, quadratic
from tactilevision.gel.mesh import GelMesh
from tactilevision.records.constants import MICRO
from tactilevision.records.measured import Bools, Floats

POINTS = 4  # of Gauss along either side of a cell
NEAREST = 16  # faces in which a point is looked for
ROUNDS = 8  # of Newton's method in a face, which doubles the digits in each


@dataclass(frozen=True)
class SurfaceCells:
    """`shape` (rows, columns) of cells `spacing_mm` wide in the picture, flat indices below.

    `places_mm` (n, 3) of the middles; `frames` (n, 3, 3), rows the local axes t1, t2 along the surface and the
    normal into the gel; `thickness_mm` (n,) the distance to the bonded surface; `inside` (rows, columns) the cells
    wholly on the gel. `camera_mm` is the pinhole's distance D, None for parallel rays.
    """

    shape: tuple[int, int]
    spacing_mm: float
    places_mm: Floats = field(repr=False)
    frames: Floats = field(repr=False)
    thickness_mm: Floats = field(repr=False)
    inside: Bools = field(repr=False)
    camera_mm: float | None = None

    @property
    def facing(self) -> Floats:
        """Return the normal's part along z (n,), 1 where the surface is parallel to the picture."""
        return np.asarray(self.frames[:, 2, 2])

    @property
    def area_mm2(self) -> Floats:
        """Return the area of the surface in each cell (n,)."""
        return np.asarray(self.spacing_mm**2 / self.facing)

    @property
    def depth_mm(self) -> Floats:
        """Return z0 of the untouched surface (rows, columns)."""
        return self.places_mm[:, 2].reshape(self.shape)

    @cached_property
    def _slope(self) -> tuple[Floats, Floats]:
        """Return dz0/dx_i (2, rows, columns), and d2z0/dx_i dx_k (2, 2, rows, columns), 1/mm."""
        slope = (-self.frames[:, 2, :2] / self.frames[:, 2, 2:]).T.reshape(2, *self.shape)
        along, down = (np.gradient(slope, self.spacing_mm, axis=axis) for axis in (2, 1))
        return slope, np.stack([along, down])

    def rise_mm(self, shift_mm: Floats) -> Floats:
        """Return z0(x + u) - z0(x) (rows, columns), mm, at a shift u (2, rows, columns), mm, to second order."""
        slope, bend = self._slope
        return np.asarray((shift_mm * (slope + (bend * shift_mm).sum(axis=1) / 2)).sum(axis=0))

    def rays(self, shift_mm: Floats | float = 0.0) -> Floats:
        """Return unit vectors (3, rows, columns) to the camera from where the surface is at x + u.

        `shift_mm` u (3, rows, columns), mm, lies along the surface.
        """
        if self.camera_mm is None:
            return np.array([0.0, 0.0, 1.0])[:, None, None]
        to = np.array([0.0, 0.0, self.camera_mm])[:, None, None] - self.places_mm.T.reshape(3, *self.shape)
        to = to - shift_mm
        return np.asarray(to / np.linalg.norm(to, axis=0))

    def local(self, moved_mm: Floats) -> Floats:
        """Return displacement (3, rows, columns), mm, along the local axes."""
        return np.asarray((self._turn * moved_mm.reshape(3, -1)).sum(axis=1).reshape(moved_mm.shape))

    def stretch(self, local_mm: Floats) -> Floats:
        """Return the stretch of the surface's area (rows, columns), a ratio, by local displacement (3, ...), mm.

        div u = tr G - n.G n,    G_ij = du_i/dx_j along the picture's axes
        """
        moved = (self._turn * local_mm.reshape(3, 1, -1)).sum(axis=0).reshape(local_mm.shape)
        normal = self.frames[:, 2].T.reshape(moved.shape)
        slopes = [np.gradient(moved, self.spacing_mm, axis=axis) for axis in (2, 1)]
        return np.asarray(sum(one[k] - (normal * one).sum(axis=0) * normal[k] for k, one in enumerate(slopes)))

    @cached_property
    def _turn(self) -> Floats:
        return np.ascontiguousarray(self.frames.transpose(1, 2, 0))


def surface_cells(
    mesh: GelMesh, x_mm: Floats, y_mm: Floats, *, spacing_mm: float
) -> tuple[SurfaceCells, sparse.csr_array]:
    """Return the cells whose middles have x and y (columns,), (rows,), mm, on the mesh's seen surface.

    Also the nodal shares (N, n) of their unit loads, dimensionless.

    Raises InputError where no cell of the view lies on it.
    """
    step, weight = np.polynomial.legendre.leggauss(POINTS)
    offset, count = step * spacing_mm / 2, POINTS**2
    grid_x, grid_y = np.meshgrid(x_mm, y_mm)
    x, y = (
        (grid_x.ravel()[:, None, None] + offset).repeat(POINTS, 1),
        grid_y.ravel()[:, None, None] + offset[:, None],
    )
    points = np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2)
    face, values, places, normals = _hit(mesh, points)
    shape = len(y_mm), len(x_mm)
    whole: Bools = np.asarray((face >= 0).reshape(-1, count).all(axis=1))
    if not whole.any():
        raise InputError(
            "no part of the view is on the gel",
            where=mesh.name,
            value=f"surface x {_span(mesh, 0)}, y {_span(mesh, 1)} mm, view x {x_mm[0]:.3g} to {x_mm[-1]:.3g} mm",
            remedy="Check the unit and the origin of the mesh: the picture's centre is x = y = 0.",
        )
    share = np.outer(weight, weight).ravel() / 4
    used = np.repeat(whole, count)
    rows = mesh.seen[np.maximum(face, 0)][used]
    columns = np.repeat(np.flatnonzero(np.repeat(whole, count)) // count, rows.shape[1])
    heavy = np.tile(share, np.count_nonzero(whole))[:, None] * values[used]
    shares = sparse.csr_array((heavy.ravel(), (rows.ravel(), columns)), shape=(len(mesh.nodes_mm), len(whole)))
    middle = np.einsum("p,npi->ni", share, places.reshape(-1, count, 3))
    normal = np.einsum("p,npi->ni", share, normals.reshape(-1, count, 3))
    nearest = distance_transform_edt(np.invert(whole.reshape(shape)), return_distances=False, return_indices=True)
    at = np.ravel_multi_index(tuple(nearest), shape).ravel()
    middle[:, 2], normal = middle[at, 2], normal[at]
    frames = _frames(normal)
    thickness = np.asarray(cKDTree(mesh.nodes_mm[mesh.bonded]).query(middle)[0])
    return SurfaceCells(shape, spacing_mm, middle, frames, thickness[at], whole.reshape(shape)), shares


def _frames(normal: Floats) -> Floats:
    """Return the axes (n, 3, 3) of surfaces with `normal` (n, 3): t1 runs with the picture's x."""
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.array([1.0, 0.0, 0.0]) - normal[:, :1] * normal
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along, np.cross(normal, along), normal], axis=1)


def _span(mesh: GelMesh, axis: int) -> str:
    places = mesh.nodes_mm[mesh.seen, axis]
    return f"{places.min():.3g} to {places.max():.3g}"


def _hit(mesh: GelMesh, points: Floats) -> tuple[Ints, Floats, Floats, Floats]:
    """Return face (P,), shape functions (P, n), place and unit normal (P, 3) where rays at x, y meet the gel.

    The face is -1 where none does.
    """
    corners = mesh.nodes_mm[mesh.seen]
    n, count = mesh.seen.shape[1], len(points)
    near = cKDTree(corners[..., :2].mean(axis=1)).query(points, k=min(NEAREST, len(corners)))[1].reshape(count, -1)
    face, values = np.full(count, -1), np.zeros((count, n))
    places = np.concatenate([points, np.zeros((count, 1))], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (count, 1))
    left = np.arange(count)
    for rank in range(near.shape[1]):
        own = near[left, rank]
        shape, slope, inside = _solved(corners[own], points[left])
        at = left[inside]
        face[at], values[at] = own[inside], shape[inside]
        places[at] = np.einsum("pn,pni->pi", shape[inside], corners[own[inside]])
        tangent = np.einsum("pnk,pni->pki", slope[inside], corners[own[inside]])
        across = np.cross(tangent[:, 0], tangent[:, 1])
        across *= np.sign(across[:, 2:])
        normals[at] = across / np.linalg.norm(across, axis=1, keepdims=True)
        left = left[~inside]
    return face, values, places, normals


def _solved(corners: Floats, target: Floats) -> tuple[Floats, Floats, Bools]:
    """Return shape functions (P, n), their slopes (P, n, 2) and whether the point lies in its face (P, n, 3)."""
    triangle = corners.shape[1] == 6
    local = np.full((len(target), 2), 1 / 3 if triangle else 0.0)
    shape, slope = _face_functions(local, triangle=triangle)
    for _ in range(ROUNDS):
        off = target - np.einsum("pn,pni->pi", shape, corners[..., :2])
        (a, b), (c, d) = np.einsum("pni,pnk->ikp", corners[..., :2], slope)
        size = a * d - b * c
        size = np.where(np.abs(size) > MICRO**2, size, np.inf)
        step = np.stack([d * off[:, 0] - b * off[:, 1], a * off[:, 1] - c * off[:, 0]], axis=1) / size[:, None]
        local = np.clip(local + step, -3, 3)
        shape, slope = _face_functions(local, triangle=triangle)
    off = np.abs(target - np.einsum("pn,pni->pi", shape, corners[..., :2])).max(axis=1)
    size_mm = np.ptp(corners[..., :2], axis=1).max(axis=1)
    if triangle:
        inside = np.minimum(local.min(axis=1), 1 - local.sum(axis=1)) > -MICRO
    else:
        inside = np.abs(local).max(axis=1) < 1 + MICRO
    return shape, slope, inside & (off < MICRO * size_mm)


def _face_functions(local: Floats, *, triangle: bool) -> tuple[Floats, Floats]:
    if triangle:
        corner = np.column_stack([1 - local.sum(axis=1), local])
        steep = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
        a, b = [0, 0, 1], [1, 2, 2]
        values = np.concatenate([corner * (2 * corner - 1), 4 * corner[:, a] * corner[:, b]], axis=1)
        own = (4 * corner - 1)[:, :, None] * steep
        between = 4 * (corner[:, a, None] * steep[b] + corner[:, b, None] * steep[a])
        return values, np.concatenate([own, between], axis=1)
    (f, df), (g, dg) = (quadratic(local[:, k]) for k in (0, 1))
    values = np.einsum("pj,pi->pji", g, f).reshape(-1, 9)
    slopes = [np.einsum("pj,pi->pji", *pair).reshape(-1, 9) for pair in ((g, df), (dg, f))]
    return values, np.stack(slopes, axis=-1)
