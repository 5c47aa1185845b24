"""Meshes of gels from their stated shape: dome, cylinder, curved pad, wedge, and layers of several materials.

The outline in the picture is meshed by quadrilaterals along the cells of the view, coarser outside, then extruded
from the seen surface z0 to the base: along the surface's normal for a curved base, along z for a flat one.

    z0 = R - sqrt(R^2 - r^2) (dome),    z0 = sag(x) + sag(y), sag(s) = R - sqrt(R^2 - s^2) (cylinder, curved pad)
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from tactilevision.errors import InputError
from tactilevision.gel.elements import Ints
from tactilevision.gel.mesh import GelMesh
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel

LEVELS = (0.0, 0.15, 0.45, 1.0)  # ends of the elements through the thickness, from the seen surface
APART = 0.08  # of the thickness: a level nearer to an interface of layers is left out
GROWTH = 1.45  # of an element outside the view over its neighbour
COARSEST = 0.8  # of the thickness: widest element outside the view
BEYOND = 3.5  # thicknesses that an unbounded gel is continued beyond the view
CORE = 0.6  # of a round outline's radius: half side of the square of straight elements in it
STEEPEST = 0.87  # sine of the steepest surface, 60 degrees, that the camera still resolves


def shape_mesh(gel: Gel, x_mm: Floats, y_mm: Floats, *, spacing_mm: float) -> GelMesh:
    """Return the mesh of a gel's stated shape, its elements along cells with middles x (columns,), y (rows,), mm.

    Raises InputError for a geometry that is not possible.
    """
    plan, quads = _plan(gel, x_mm, y_mm, spacing_mm)
    top, normal = _surface(gel, plan)
    thickness = _thickness(gel, plan)
    levels, ratio, nu = _levels(gel)
    if gel.base == "curved" and gel.shape != "wedge":
        along = thickness[:, None] * normal
    else:
        base = thickness if gel.shape == "wedge" else np.full(len(plan), gel.thickness_mm) - top[:, 2]
        along = base[:, None] * np.array([0.0, 0.0, 1.0])
    _check_base(gel, along)
    nodes = np.concatenate([top + level * along for level in _with_middles(levels)])
    count, deep = len(plan), len(levels) - 1
    elements = np.concatenate([_slab(quads, 2 * k, count) for k in range(deep)])
    bonded = np.zeros(len(nodes), dtype=bool)
    bonded[-count:] = True
    if not gel.layers:
        return GelMesh(nodes, elements, quads, bonded, name=f"gel {gel.shape}")
    stiffer, own = np.repeat(ratio, len(quads)), np.repeat(nu, len(quads))
    return GelMesh(nodes, elements, quads, bonded, stiffer, own, name=f"gel {gel.shape}")


def _slab(quads: Ints, level: int, count: int) -> Ints:
    return np.concatenate([quads + (level + k) * count for k in range(3)], axis=1)


def _surface(gel: Gel, plan: Floats) -> tuple[Floats, Floats]:
    """Return places (n, 3) on the seen surface, mm, and unit normals into the gel."""
    x, y = plan.T
    if gel.curvature_mm is None:
        z, slope = np.zeros(len(plan)), np.zeros((len(plan), 2))
    elif gel.shape == "dome":
        radius = gel.curvature_mm[0]
        _check_steepness(gel, float(np.hypot(x, y).max()) / radius)
        root = np.sqrt(radius**2 - x**2 - y**2)
        z, slope = radius - root, plan / root[:, None]
    else:
        bent = np.array(gel.curvature_mm)
        if gel.shape == "cylinder":
            bent["xy".index(gel.axis)] = np.inf
        _check_steepness(gel, float((np.abs(plan) / bent).max()))
        share = plan / bent
        # R - sqrt(R^2 - s^2), finite for an infinite radius
        z = (plan * share / (1 + np.sqrt(1 - share**2))).sum(axis=1)
        slope = share / np.sqrt(1 - share**2)
    normal = np.column_stack([-slope, np.ones(len(plan))])
    return np.column_stack([plan, z]), normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _check_steepness(gel: Gel, sine: float) -> None:
    if sine > STEEPEST:
        raise InputError(
            "the gel's rim is steeper than 60 degrees, or its outline is wider than its sphere",
            where="gel",
            value={"curvature_mm": gel.curvature_mm, "radius_mm": gel.radius_mm, "size_mm": gel.size_mm},
            remedy="State the part of the gel that the camera sees.",
        )


def _check_base(gel: Gel, along: Floats) -> None:
    thin = float(np.linalg.norm(along, axis=1).min()) if (along[:, 2] > 0).all() else 0.0
    tight = gel.curvature_mm is not None and gel.base == "curved" and min(gel.curvature_mm) <= gel.thickness_mm
    if thin <= 0.02 * gel.thickness_mm or tight:
        raise InputError(
            "the gel has no thickness at its rim, or is thicker than its radius of curvature",
            where="gel",
            value={"thickness_mm": gel.thickness_mm, "curvature_mm": gel.curvature_mm, "base": gel.base},
            remedy='Check thickness_mm and curvature_mm; a gel on a flat base needs base = "flat".',
        )


def _thickness(gel: Gel, plan: Floats) -> Floats:
    if gel.shape != "wedge":
        return np.full(len(plan), gel.thickness_mm)
    assert gel.thickness_ends_mm is not None
    assert gel.size_mm is not None
    across = 1 - "xy".index(gel.axis)
    first, last = gel.thickness_ends_mm
    return np.asarray((first + last) / 2 + (last - first) * plan[:, across] / gel.size_mm[across])


def _levels(gel: Gel) -> tuple[Floats, Floats, Floats]:
    """Return the ends of elements through the thickness, as shares of it, and the ratio and nu of each."""
    if not gel.layers:
        return np.array(LEVELS), np.ones(len(LEVELS) - 1), np.full(len(LEVELS) - 1, np.nan)
    ends = np.cumsum([one.thickness_mm for one in gel.layers]) / gel.thickness_mm
    if not (np.diff([0.0, *ends[:-1], 1.0]) > 0).all():
        raise InputError(
            "the layers are thicker than the gel",
            where="gel",
            value={"thickness_mm": gel.thickness_mm, "layers": [one.thickness_mm for one in gel.layers]},
            remedy="thickness_mm is that of all layers together; the last one fills the rest.",
        )
    ends[-1] = 1.0
    free = [one for one in LEVELS if np.abs(ends - one).min() > APART]
    levels = np.unique(np.concatenate([[0.0], free, ends]))
    of = np.searchsorted(ends, (levels[1:] + levels[:-1]) / 2)
    nu = [np.nan if one.poisson_ratio is None else one.poisson_ratio for one in gel.layers]
    return levels, np.array([one.modulus_ratio for one in gel.layers])[of], np.array(nu)[of]


# The outline in the picture, as quadrilaterals of nine nodes.


def _plan(gel: Gel, x_mm: Floats, y_mm: Floats, spacing_mm: float) -> tuple[Floats, Ints]:
    """Return nodes (n, 2), mm, and quadrilaterals (q, 9), numbered i + 3 j."""
    coarse = COARSEST * gel.thickness_mm
    if gel.radius_mm is not None and gel.size_mm is None:
        return _round_plan(gel.radius_mm, (x_mm, y_mm), spacing_mm, coarse)
    lines = []
    for axis, middles in enumerate((x_mm, y_mm)):
        half = BEYOND * gel.thickness_mm + np.abs(middles).max() if gel.size_mm is None else gel.size_mm[axis] / 2
        lines.append(_lines(middles, half, spacing_mm, coarse))
    return _merged([_patch(lines[0], lines[1], lambda x, y: np.stack([x, y], axis=-1))])


def _round_plan(
    radius: float, middles: tuple[Floats, Floats], spacing: float, coarse: float
) -> tuple[Floats, Ints]:
    """A square of straight elements, and a petal between each of its sides and the rim."""
    core = CORE * radius
    x, y = (_lines(one, core, spacing, coarse) for one in middles)
    out = _lines(np.zeros(0), radius - core, min(spacing * GROWTH, radius - core), coarse)
    out = (out - out[0]) / (out[-1] - out[0])
    patches = [_patch(x, y, lambda x, y: np.stack([x, y], axis=-1))]
    for turn in range(4):
        side = x if turn % 2 == 0 else y
        around = np.array([[0, -1], [1, 0]]) if turn % 2 else np.eye(2)
        sign = 1 if turn < 2 else -1

        def place(t: Floats, s: Floats, around: Floats = around, sign: int = sign) -> Floats:
            angle = np.pi / 4 * t / core
            inner = np.stack([t, np.full_like(t, core)], axis=-1)
            rim = radius * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
            return np.asarray(sign * ((1 - s)[..., None] * inner + s[..., None] * rim) @ around)

        patches.append(_patch(side, out, place))
    return _merged(patches)


def _lines(middles: Floats, half: float, spacing: float, coarse: float) -> Floats:
    """Return the ends of elements on [-half, half]: the cells' own where they fit, then growing to `coarse`."""
    edges = np.append(middles - spacing / 2, middles[-1:] + spacing / 2) if len(middles) else np.array([-half])
    edges = edges[np.abs(edges) < half - 0.4 * spacing] if len(middles) else edges
    if not len(edges):
        return np.linspace(-half, half, 3)
    after = edges[-1] + _growing(half - edges[-1], spacing, coarse)
    before = edges[0] - _growing(half + edges[0], spacing, coarse)[::-1] if len(middles) else np.zeros(0)
    return np.concatenate([before, edges, after])


def _growing(length: float, first: float, coarse: float) -> Floats:
    """Return the ends (n,) of elements that fill `length`, each GROWTH times the one before, `coarse` at most."""
    sizes: list[float] = []
    while sum(sizes) < length:
        sizes.append(min(first * GROWTH ** len(sizes), max(coarse, first)))
    if len(sizes) > 1 and sum(sizes) - length > sizes[-1] / 2:
        sizes.pop()
    return np.asarray(np.cumsum(sizes) * length / sum(sizes))


def _with_middles(ends: Floats) -> Floats:
    return np.sort(np.concatenate([ends, [(a + b) / 2 for a, b in pairwise(ends)]]))


def _patch(u: Floats, v: Floats, place: Callable[[Floats, Floats], Floats]) -> Floats:
    """Return the nodes (v, u, 2) of a grid of elements with ends `u` and `v`, placed by `place`."""
    x, y = np.meshgrid(_with_middles(u), _with_middles(v))
    return place(x, y)


def _merged(patches: list[Floats]) -> tuple[Floats, Ints]:
    """Join patches by the nodes that they share, and turn each quadrilateral the same way round."""
    places, quads, before = np.concatenate([one.reshape(-1, 2) for one in patches]), [], 0
    for one in patches:
        number = before + np.arange(one.shape[0] * one.shape[1]).reshape(one.shape[:2])
        parts = [number[j : j - 2 or None : 2, i : i - 2 or None : 2] for j in range(3) for i in range(3)]
        quads.append(np.stack([part.ravel() for part in parts], axis=1))
        before = number.max() + 1
    scale = float(np.ptp(places)) * 1e-9
    _, first, same = np.unique(np.round(places / scale / 1e3), axis=0, return_index=True, return_inverse=True)
    every = same.ravel()[np.concatenate(quads)]
    nodes = places[first]
    a, b = nodes[every[:, 2]] - nodes[every[:, 0]], nodes[every[:, 6]] - nodes[every[:, 0]]
    turned = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0
    every[turned] = every[turned][:, [0, 3, 6, 1, 4, 7, 2, 5, 8]]
    return nodes, every
