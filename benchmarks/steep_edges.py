"""How much of a face's depth does the wall's law carry, where light and camera are just what it assumes?

    python -m benchmarks.steep_edges

Surfaces are the finite elements' (mechanics/tables); lamps all round, half a pixel to .8 px of blur, a pixel's
mean. So what is printed is the law's own error: of D = EDGE_FALL (w^2/a) sqrt(px/a) as it stands, and without it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice, product
from unittest import mock

import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap import walls as steep_edges
from tactilevision.heightmap.circular_edges import CircularEdge
from tactilevision.heightmap.walls import LEAN, WallLaw, wall_light
from tactilevision.mechanics.profile import PunchCase, seen_profile
from tactilevision.mechanics.tables.punch import TableProfile
from tactilevision.records.measured import Floats

THICKNESS_MM = 3.0
FINE_MM = 0.002
INKS_MM = (0.0, 0.015, 0.03)  # sigma: how ink rounds the surface; the simulator has the last
LIMITS = (0.45, 0.6)  # steepest slopes that are read
PIXELS_MM = (0.045, 0.065, 0.095)
BLURS_PX = (0.5, 0.8)
DEPTHS = (0.03, 0.045, 0.06, 0.08, 0.1, 0.125, 0.15, 0.175, 0.2)  # w/h
EDGES = (1 / 60, 1 / 30)  # edge radius over h
POISSON = (0.40, 0.43, 0.46, 0.487, 0.499)
RADII = (0.5, 0.67, 0.85, 1.0)  # a/h
FRICTIONS = (0.15, 0.3, 0.6)


@dataclass(frozen=True, slots=True, eq=False)
class Wall:
    """A surface `z_mm` over `r_mm` (n,) beside a face of `depth_mm` and radius a, and what it was solved for."""

    case: PunchCase
    edge_over_h: float
    ink_mm: float
    r_mm: Floats
    z_mm: Floats
    radius_mm: float
    depth_mm: float


@dataclass(frozen=True, slots=True)
class Carried:
    """One reading: what the law carries, and what it should, mm; the deviation that it states."""

    case: PunchCase
    edge_over_h: float
    ink_mm: float
    px_mm: float
    depth_mm: float
    error_mm: float
    std_mm: float


def walls() -> Iterator[Wall]:
    """Every case that the tables hold."""
    from scipy.ndimage import gaussian_filter1d

    for edge, nu, a_over_h, friction, w_over_h in product(EDGES, POISSON, RADII, FRICTIONS, DEPTHS):
        case = PunchCase(nu, a_over_h, w_over_h, friction)
        a, w, e = a_over_h * THICKNESS_MM, w_over_h * THICKNESS_MM, edge * THICKNESS_MM
        r = np.arange(max(FINE_MM, a - 1.6), 1.85 * a + 1.0, FINE_MM)
        beside = r > a
        try:
            outside = -w * seen_profile(r[beside] / a, case, source=TableProfile(edge_over_h=edge))
        except InputError:  # a cell of the grid that no one solved
            continue
        fillet = e - np.sqrt(np.maximum(e * e - np.clip(r[~beside] - (a - e), 0.0, e) ** 2, 0.0))
        z = np.concatenate([np.maximum(w - fillet, outside[0]), outside])
        for ink in INKS_MM:
            yield Wall(case, edge, ink, r, gaussian_filter1d(z, max(ink / FINE_MM, 1.0)), a, w)


def shown(wall: Wall, places: Floats, *, px: float, blur_px: float) -> Floats:
    """Slopes that lamps all round show at places (n,), mm: light is blurred, and read by what even slopes show."""
    from scipy.ndimage import gaussian_filter1d, uniform_filter1d

    u, law = -np.gradient(wall.z_mm, wall.r_mm), wall_light(LEAN)
    light = [np.sign(u) * np.interp(abs(u), law.slopes, law.sine), np.interp(abs(u), law.slopes, law.cosine)]
    pixel = round(px / FINE_MM)
    sine, cosine = (uniform_filter1d(gaussian_filter1d(one, blur_px * px / FINE_MM), pixel) for one in light)
    slopes = np.sign(sine) * np.interp(abs(sine / cosine), law.seen, law.slopes)
    return np.asarray(np.interp(places, wall.r_mm, slopes))


def carried(wall: Wall, *, px: float, blur_px: float, limit: float) -> Carried | None:
    """What the law makes of a wall; None where it finds none, or leaves it as read."""
    a = wall.radius_mm
    places = np.arange(a - 12 * px, 1.8 * a, 0.5 * px)
    slopes = shown(wall, places, px=px, blur_px=blur_px)
    rim = CircularEdge((0.0, 0.0), a, 0.8 * px, 0.02 * px, places, slopes, slopes, np.full(places.size, 0.005))
    found = steep_edges.fit_edge(rim, WallLaw(limit), px=px)
    if found is None or not found.missing_mm > 0:
        return None
    inside, beyond = np.interp([a - 9 * px, found.radius_mm + found.reach_mm], wall.r_mm, wall.z_mm)
    error = found.fall_at_reach_mm - (inside - beyond)
    return Carried(wall.case, wall.edge_over_h, wall.ink_mm, px, wall.depth_mm, float(error), found.std_mm)


def read(every: list[Wall]) -> list[Carried]:
    """All readings of all walls."""
    settings = list(product(PIXELS_MM, BLURS_PX, LIMITS))
    found = (carried(wall, px=px, blur_px=blur, limit=limit) for wall in every for px, blur, limit in settings)
    return [one for one in found if one is not None]


def table(readings: list[Carried]) -> None:
    """Print errors in % of the depth by what they may depend on: mean, and half of what 68 % lie within."""
    by: dict[str, Callable[[Carried], float]] = {
        "w/h": lambda one: one.case.w_over_h,
        "a/h": lambda one: one.case.a_over_h,
        "nu": lambda one: one.case.poisson_ratio,
        "friction": lambda one: one.case.friction,
        "edge/h": lambda one: round(one.edge_over_h, 4),
        "ink, mm": lambda one: one.ink_mm,
        "px, mm": lambda one: one.px_mm,
    }
    off = np.array([one.error_mm / one.depth_mm for one in readings])
    stated = np.array([one.error_mm / one.std_mm for one in readings])
    print(f"  all {len(off)}: {_spread(off)}; {100 * np.mean(abs(stated) < 1):.0f} % within what is stated")
    for what, of in by.items():
        values = np.array([of(one) for one in readings])
        print(f"  {what}: " + "; ".join(f"{v:g} {_spread(off[values == v])}" for v in np.unique(values)))


def _spread(off: Floats) -> str:
    low, middle, high = 100 * np.quantile(off, [0.16, 0.5, 0.84])
    return f"{middle:+.1f} ± {0.5 * (high - low):.1f}"


def main() -> None:
    every = list(walls())
    print("the wall's law, error in % of the depth: median, and half of what the middle 68 % span")
    table(read(every))
    print("without what finite strain adds at the edge")
    with mock.patch.object(steep_edges, "EDGE_FALL", 0.0):
        table(read(every))


def quick() -> None:
    table(read([*islice(walls(), 12, 15)]))


if __name__ == "__main__":
    main()
