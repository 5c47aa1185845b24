"""What slope and bend P/w against w/h can have, by finite elements, for a sharp punch on a gel of known h.

The slope beta: the largest is a Hencky solid's that sticks, by independent finite elements at a/h = .833, h = 3,
depths .15 to .6 mm, and grows with a/h as the tables of mechanics have it; the smallest a neo-Hookean one's that
slides freely, by the tables at a/h .5, where it is smallest, w/h .05 to .2. A free beta outside of this is fitting
something else: a depth zero, another thickness, a rounded edge, a gel that stiffens. A punch that
rubs at all has more than RUBBING.

The bend gamma, of P/w = c (1 + beta w/h + gamma (w/h)^2), from the tables of mechanics: neo-Hooke and Hencky, from
no friction to no slip, at this nu, a/h and edge, widened by what an error of the table as stated on its card can
make of it. Where presses go deeper than the table its parabola is carried on.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.tables.punch import force_ratio
from tactilevision.mechanics.tables.table import Table, shipped_table
from tactilevision.records import Estimate, Floats, Material, Pair

NU = (0.30, 0.40, 0.45, 0.48, 0.495)  # at which HIGHEST and LOWEST were computed
HIGHEST = (1.34, 1.23, 1.20, 1.13, 1.08)  # beta of a Hencky solid that sticks
WIDER = (0.5, 0.65, 0.83, 1.0, 1.1, 1.2)  # a/h at which the largest beta was read from the tables
GROWN = (0.66, 0.87, 1.00, 1.12, 1.30, 1.45)  # times that at .833: the most of nu .45, .48, .49, carried on to 1.2
LOWEST = (0.56, 0.08, -0.24, -0.46, -0.57)  # beta of a neo-Hookean solid without friction
RUBBING = 0.10  # least beta of a punch that rubs at all
A_OVER_H: Pair = (0.5, 1.2)  # where these figures are taken to hold
STRAINS = 20  # depths at which the bend is taken
ROUNDED = 5e-4  # of w/h beyond the table: less is rounding, not a deeper press
MIN_STRAIN = 1e-3  # over less there is no bend to speak of


def beta_range(poisson_ratio: Pair, a_over_h: float) -> Pair | None:
    """The smallest and the largest beta for any nu in this range; None where a/h is too far from the figures'."""
    if not A_OVER_H[0] <= a_over_h <= A_OVER_H[1]:
        return None
    low, high = np.clip(poisson_ratio, NU[0], NU[-1])
    places = [low, *(nu for nu in NU if low < nu < high), high]  # the largest may lie between the ends
    grown = float(np.interp(a_over_h, WIDER, GROWN))
    return float(np.min(np.interp(places, NU, LOWEST))), grown * float(np.max(np.interp(places, NU, HIGHEST)))


def beta_outside_theory(beta: Estimate, poisson_ratio: Estimate, *, a_over_h: float) -> str:
    """A sentence where all of beta's interval lies outside of what the laws allow; else empty."""
    allowed = beta_range(poisson_ratio.interval95 or (NU[0], NU[-1]), a_over_h)
    if allowed is None or beta.interval95 is None or beta.value is None:
        return ""
    low, high = beta.interval95
    if low <= allowed[1] and high >= allowed[0]:
        return ""
    return (
        f"beta = {beta.value:.2f} lies outside of what contact laws allow here "
        f"({allowed[0]:.1f} to {allowed[1]:.2f}): thickness, a rounded edge, the depth's zero "
        "or a stiffening gel are candidates"
    )


def deeper_than_elements(deepest: float) -> str:
    """A sentence where presses go deeper (w/h) than finite elements are tabulated; else empty."""
    table = float(shipped_table().axes.depths[-1])
    if deepest <= table + ROUNDED:
        return ""
    return (
        f"presses go to {deepest:.2f} of the gel's thickness, finite elements are tabulated to {table:g}: what "
        "contact laws allow is carried on from there, not known"
    )


@lru_cache(maxsize=64)
def bend_range(poisson_ratio: float, a_over_h: float, edge_over_h: float, deepest: float) -> Pair:
    """The smallest and the largest gamma of any tabulated law and friction, over depths w/h up to `deepest`.

    Beyond the table as at its ends; edges sharper or rounder than a law's own blocks as the nearest.
    """
    table = shipped_table()
    nu, ratio, depth = table.axes.poisson_ratios, table.axes.a_over_h, table.axes.depths
    place = (float(np.clip(poisson_ratio, nu[0], nu[-1])), float(np.clip(a_over_h, ratio[0], ratio[-1])))
    strain = np.linspace(1 / STRAINS, 1, STRAINS) * np.clip(deepest, MIN_STRAIN, float(depth[-1]))
    bends = [
        bend
        for block in table.blocks
        for bend in _bend(table, (block.law, block.friction), place, edge_over_h, strain)
    ]
    stated = table.card["errors"]
    sharper = edge_over_h < min(block.edge_over_h for block in table.blocks) * (1 - 1e-9)
    off = stated["interpolation_force"] + (stated["sharp_limit_at_first_touch"] if sharper else 0.0)
    error = 4 * float(off) / strain[-1] ** 2  # one that is largest half way is a parabola of this gamma
    return min([0.0, *bends]) - error, max([0.0, *bends]) + error


def _bend(
    table: Table, kind: tuple[str, float], place: Pair, edge_over_h: float, strain: Floats
) -> tuple[float, ...]:
    """gamma of one law and friction, weighed as forces are; none where the table holds too few depths."""
    law, friction = kind
    edges = [block.edge_over_h for block in table.blocks if block.law == law]
    lowest = 0.0 if len(set(edges)) > 1 else edges[0]
    contact = FlatContact(place[1], float(np.clip(edge_over_h, lowest, max(edges))), 1.0, friction, law)
    try:
        secant, known = force_ratio(strain, contact, material=Material(1.0, place[0]), table=table)
    except InputError:
        return ()
    if np.count_nonzero(known) < 4 or np.ptp(strain[known]) < MIN_STRAIN:
        return ()
    eps, weight = strain[known], strain[known]
    start, _, bend = np.polynomial.polynomial.polyfit(eps, secant[known], 2, w=weight)
    return (float(bend / start),)
