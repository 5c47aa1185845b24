"""Flat punch with a rounded edge on a bonded layer: the contact grows with depth from b = a - rho to a.

The face is f(r) = (r - b)^2/(2 rho) beyond b, which the equation of punch_equation.py takes as its sag s. With phi
the flat punch's solution at the contact's radius r and psi(y) that for the right-hand side (2/pi) M(y, 1),

    w = [s(r) + Int_b/r^1 psi s dx] / phi(1),    P = 2 E* r [w Int phi dx - Int_b/r^1 phi s dx],
    s(x) = (x/rho) [sqrt(x^2 - b^2) - b arccos(b/x)],

exact for a linear, frictionless layer; on a half-space (phi = 1, psi = 0) Sneddon's. The layer's factors on w and
on the depth lost by the rounding are smooth in nu, r/h and b/r and kept as a polynomial (relative error below
2e-4). Compared with finite elements that slide (neo-Hooke, nu .48, a/h .5 to 1.17, h 3 mm, w to .6 mm) the force
over a sharp punch's is within .3 % for rho to .2 mm, .8 % for .3 mm, 1.4 % for .5 mm; a half-space's growth is 1,
2.9 and 5.2 % off. For a gel that sticks to the edge the half-space's growth is right within .5 % at w to .3 mm and
1.3 % to .6 mm (3 % at a/h .5), while the layer's is up to 4 % off. `sticking` interpolates between the two.
Sources: Sneddon, Int. J. Eng. Sci. 3 (1965) 47; Hayes et al., J. Biomech. 5 (1972) 541; Ciavarella, Hills, Monno,
Proc. IMechE C 212 (1998) 319.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from tactilevision.files.cache import kept_array
from tactilevision.mechanics.kappa import OFFSET
from tactilevision.mechanics.punch_equation import (
    KERNEL_END,
    KERNEL_NODES,
    NODES,
    equation_matrix,
    gauss,
    layer_defect,
    legendre_series,
)
from tactilevision.records.constants import MICRO
from tactilevision.records.measured import Floats

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

SHARP_MM = 1e-5  # a smaller rounding is ignored
MIN_FLAT = 0.05  # least flat part of the radius
KEPT = 256  # growths that are kept
STEPS = 33  # of the contact's radius in the spline of its growth
RATIOS = (0.05, 5)  # r/h, range of the table
SIZES = (9, 16, 8)  # nodes over nu, ln(r/h) and b/r


Punch = tuple[float, float, float, float, float]  # radius, edge and thickness in mm, nu, sticking


def rounded_contact(
    depth_mm: Floats,
    outer_mm: float,
    edge_mm: float,
    thickness_mm: float,
    poisson_ratio: float,
    sticking: float = 0.0,
) -> tuple[Floats, Floats]:
    """Return the radius of the contact in mm, and the share of a flat punch's force of that radius, at each depth
    (N,).

    `sticking` from 0 (the gel slides over the edge) to 1 (it sticks to it).
    """
    punch = (outer_mm, edge_mm, thickness_mm, poisson_ratio, sticking)
    return _met(depth_mm, punch, _growths([punch]))


def contacts_and_slopes(
    depths_mm: Sequence[Floats], punches: Sequence[Punch], *, along: Sequence[int]
) -> Iterator[tuple[Floats, Floats]]:
    """Yield `rounded_contact` (2, N) of each punch at its depths, and the derivatives (k, 2, N) with respect to k
    of its arguments, the depth being number 0.

    By differences, over arguments that shape the growth one-sided.
    """
    orders = [order for order in along if order]
    moved = [[_moved(punch, order) for order in orders] for punch in punches]
    growths = _growths([*punches, *(one for ones in moved for one in ones)])
    for depth, punch, others in zip(depths_mm, punches, moved, strict=True):
        sides = [depth] if len(orders) == len(along) else [depth, depth - MICRO, depth + MICRO]
        here, *ends = np.split(np.array(_met(np.concatenate(sides), punch, growths)), len(sides), axis=1)
        slopes = {0: (ends[1] - ends[0]) / (2 * MICRO)} if ends else {}
        for order, other in zip(orders, others, strict=True):
            change = np.subtract(_met(depth, other, growths), here)
            slopes[order] = change / (other[order - 1] - punch[order - 1])
        yield here, np.array([slopes[order] for order in along]).reshape(len(along), *here.shape)


def _moved(punch: Punch, order: int) -> Punch:
    """Return the punch with one argument a little larger; nu and sticking, which end there, a little smaller."""
    more = list(punch)
    more[order - 1] += MICRO * max(punch[order - 1], MIN_FLAT) * (-1 if order > 3 else 1)
    return tuple(more)  # type: ignore[return-value]


class _Growth(NamedTuple):
    """Root of the growth and share of force `through` the cube root of the depth, until the whole edge is in."""

    through: PPoly
    flat_mm: float
    need_mm: float
    lost_mm: float


def _met(depth_mm: Floats, punch: Punch, growths: Mapping[Punch, _Growth]) -> tuple[Floats, Floats]:
    """Return what `rounded_contact` does."""
    outer_mm, edge_mm = punch[:2]
    if edge_mm < SHARP_MM:
        return np.full(depth_mm.shape, outer_mm), np.ones(depth_mm.shape)
    growth = growths[punch]
    root, met = growth.through(np.cbrt(np.clip(depth_mm, 0, growth.need_mm))).T
    full = 1 - growth.lost_mm / np.maximum(depth_mm, growth.need_mm)
    whole = depth_mm >= growth.need_mm
    flat_mm = growth.flat_mm
    return flat_mm + (outer_mm - flat_mm) * np.where(whole, 1.0, root) ** 2, np.where(whole, full, met)


_GROWN: dict[Punch, _Growth] = {}


def _growths(punches: Sequence[Punch]) -> dict[Punch, _Growth]:
    """Return the growth of each punch with an edge; a fit asks for the same few at every other step."""
    found = {punch: _GROWN.get(punch) for punch in punches if punch[1] >= SHARP_MM}
    new = [punch for punch, known in found.items() if known is None]
    made = dict(zip(new, _grow(new), strict=True)) if new else {}
    if len(_GROWN) > KEPT:
        _GROWN.clear()
    _GROWN.update(made)
    return {punch: known or made[punch] for punch, known in found.items()}


def _grow(punches: Sequence[Punch]) -> Iterator[_Growth]:
    """Yield the growth of each punch, all made together."""
    from scipy.interpolate import PPoly

    outer, edge, thickness, _, sticking = np.array(punches).T[:, :, None]
    b = outer - np.minimum(edge, (1 - MIN_FLAT) * outer)
    grid = np.linspace(0, 1, STEPS)  # root of how far the contact has grown: w goes with its cube
    r = b + (outer - b) * grid**2
    layer = _of_layers([punch[3] for punch in punches], r / thickness, b / r)
    need, lost = _half_space(r, b, edge) * np.where(sticking == 0, layer, layer ** (1 - sticking))
    share = np.ones(need.shape)
    share[:, 1:] = 1 - lost[:, 1:] / need[:, 1:]
    knots = np.cbrt(need)
    for k, coefficients in enumerate(_splines(knots, np.stack(np.broadcast_arrays(grid, share), axis=2))):
        through = PPoly.construct_fast(coefficients, knots[k])
        yield _Growth(through, float(b[k, 0]), float(need[k, -1]), float(lost[k, -1]))


def _splines(x: Floats, y: Floats) -> Floats:
    """Return the coefficients (k, 4, n - 1, m) of cubic splines, not-a-knot, through y (k, n, m) at x (k, n).

    They are scipy's CubicSpline's, of many splines in the time of one. Raises ValueError where x does not rise.
    """
    from scipy.linalg.lapack import dgtsv

    dx = np.diff(x)
    if not (np.isfinite(x).all() and np.isfinite(y).all() and (dx > 0).all()):
        raise ValueError("the contact does not grow with depth")
    step, slope = dx[..., None], np.diff(y, axis=1) / dx[..., None]
    upper, middle, lower, right = np.zeros(x.shape), np.empty(x.shape), np.zeros(x.shape), np.empty(y.shape)
    middle[:, 1:-1], upper[:, 1:-1], lower[:, :-2] = 2 * (dx[:, :-1] + dx[:, 1:]), dx[:, :-1], dx[:, 1:]
    right[:, 1:-1] = 3 * (step[:, 1:] * slope[:, :-1] + step[:, :-1] * slope[:, 1:])
    first, last = x[:, 2] - x[:, 0], x[:, -1] - x[:, -3]
    middle[:, 0], upper[:, 0], middle[:, -1], lower[:, -2] = dx[:, 1], first, dx[:, -2], last
    first, last = first[:, None], last[:, None]
    right[:, 0] = (step[:, 0] + 2 * first) * step[:, 1] * slope[:, 0] + step[:, 0] ** 2 * slope[:, 1]
    right[:, 0] /= first
    right[:, -1] = step[:, -1] ** 2 * slope[:, -2] + (2 * last + step[:, -1]) * step[:, -2] * slope[:, -1]
    right[:, -1] /= last
    # one system: the splines do not meet
    *_, found, _ = dgtsv(lower.ravel()[:-1], middle.ravel(), upper.ravel()[:-1], right.reshape(-1, y.shape[2]))
    along = found.reshape(y.shape)
    bend = (along[:, :-1] + along[:, 1:] - 2 * slope) / step
    parts = (bend / step, (slope - along[:, :-1]) / step - bend, along[:, :-1], y[:, :-1])
    return np.ascontiguousarray(np.stack(parts, axis=1))


def _half_space(r: Floats, b: Floats, edge_mm: Floats | float) -> Floats:
    """Return the depth at which the contact reaches r (k, n), and the depth that the rounding loses, (2, k, n)."""
    x = np.sqrt((r - b) * (r + b)) / b
    small = x < 0.05  # where the differences below cancel
    gap = np.where(small, x**3 * (1 / 3 - x**2 * (1 / 5 - x**2 / 7)), x - np.arctan(x))
    lost = np.where(
        small, x**5 * (1 / 15 - x**2 * (1 / 35 - x**2 / 63)), x**3 / 3 + x / 2 - (1 + x**2) / 2 * np.arctan(x)
    )
    return np.array([r * b * gap, b**3 * lost / r]) / edge_mm


def _of_layers(poisson_ratios: Sequence[float], ratio: Floats, flat: Floats) -> Floats:
    """Return what k layers make of both over a half-space, (2, k, n): at r/h = `ratio` and b/r = `flat`, (k, n)
    each.
    """
    _, alpha = _variables(np.array(poisson_ratios), ratio)
    over_ratio, over_flat = (  # chebvander in a third of its time
        np.cos(np.arccos(x)[..., None] * np.arange(size))
        for x, size in ((alpha, SIZES[1]), (2 * flat - 1, SIZES[2]))
    )
    tables = np.stack([_table_at(one) for one in poisson_ratios])  # (k, 2, ...)
    found = np.sum((over_ratio[:, None] @ tables) * over_flat[:, None], axis=3)
    return np.asarray(found.swapaxes(0, 1))


@lru_cache(maxsize=64)  # one nu serves all punches
def _table_at(poisson_ratio: float) -> Floats:
    nu, _ = _variables(np.array([poisson_ratio]), np.ones(1))
    return np.asarray(np.tensordot(chebyshev.chebvander(nu, SIZES[0] - 1)[0], _table(), axes=(0, 1)))


def _variables(nu: Floats, ratio: Floats) -> tuple[Floats, Floats]:
    """Return nu and r/h as the polynomials take them, from -1 to 1; outside, the nearest."""
    ends = -np.log(0.5 + OFFSET), -np.log(OFFSET)
    along = (-np.log(0.5 + OFFSET - np.clip(nu, 0, 0.5)) - ends[0]) / (ends[1] - ends[0])
    low, high = np.log(RATIOS)
    return 2 * along - 1, 2 * (np.log(np.clip(ratio, *RATIOS)) - low) / (high - low) - 1


@lru_cache(maxsize=1)
def _table() -> Floats:
    """Return the coefficients (2, *SIZES) through the exact ratios at Chebyshev's nodes, kept in the cache."""
    return kept_array("edges", (SIZES, RATIOS), make=_solved_table)


def _solved_table() -> Floats:
    places = [chebyshev.chebpts1(size) for size in SIZES]
    top, bottom = 0.5 + OFFSET, OFFSET
    nus = 0.5 + OFFSET - top ** (1 - (places[0] + 1) / 2) * bottom ** ((places[0] + 1) / 2)
    ratios = np.exp(np.log(RATIOS[0]) + (places[1] + 1) / 2 * np.log(RATIOS[1] / RATIOS[0]))
    v = (places[2] + 1) / 2
    exact = np.array([[exact_ratios(float(n), float(q), v=v) for q in ratios] for n in nus])  # nu, r/h, 2, v
    for axis, place in ((0, places[0]), (1, places[1]), (3, places[2])):
        inverse = np.linalg.inv(chebyshev.chebvander(place, place.size - 1))
        exact = np.moveaxis(np.tensordot(inverse, exact, axes=(1, axis)), 0, axis)
    return np.asarray(np.moveaxis(exact, 2, 0))


def exact_ratios(poisson_ratio: float, ratio: float, *, v: Floats) -> Floats:
    """Return the ratios of `_of_layer` without interpolation: at nu, r/h, and b/r = `v` (n,) in (0, 1)."""
    x, weights = gauss(NODES)
    u, u_weights = gauss(KERNEL_NODES, KERNEL_END)
    waves = np.cos(np.multiply.outer(x, ratio * u))
    at_edge = 2 / np.pi * ratio * waves @ (u_weights * layer_defect(u, poisson_ratio) * np.cos(ratio * u))
    right = np.stack([np.ones(NODES), at_edge], axis=1)
    phi, psi = np.linalg.solve(equation_matrix(poisson_ratio, ratio), right).T
    flat, edge, kappa = legendre_series(phi), legendre_series(psi), float(weights @ phi)
    y = v[:, None] + (1 - v[:, None]) * x**2  # sag begins like (x - v)^1.5
    dy = 2 * (1 - v[:, None]) * x * weights
    sag = y * (np.sqrt(np.maximum(y**2 - v[:, None] ** 2, 0)) - v[:, None] * np.arccos(v[:, None] / y))
    need, lost = _half_space(np.ones(v.size), v, 1.0)
    whole = need + np.sum(edge(y) * sag * dy, axis=1)
    return np.array([whole / float(flat(1.0)) / need, np.sum(flat(y) * sag * dy, axis=1) / kappa / lost])
