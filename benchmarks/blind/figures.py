"""The gel's elastic force, from printed and computed figures: no equation of the analyst's stands behind it.

    P = E h^2 F(w/h, a/h, nu)

by dimensions alone. The initial slope comes from a table of Hayes' kappa (kappa.csv), how the force bends away
from
it from finite elements of a neo-Hookean gel (punch_fem.csv), both as smooth splines. Depth w and lengths in
mm, E in
MPa, force in N. Valid for a/h .35 to 1.5, nu .45 to .495, w/h up to .25.
"""

from __future__ import annotations

import csv
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from tactilevision.records.measured import Floats

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

HERE = Path(__file__).parent
FEM_THICKNESS_MM = 3.0
Contact = Literal["slides", "rough", "sticks", "yeoh", "gent"]
FIRST_MM = 0.1
# NGSolve 6.2 P2/P1, neo-Hooke, glued, a = 2.5, h = 3, R = 15 mm, nu = .4797 (reference figures of 2026-11-21),
# and the
# slope of full stick as w goes to 0
PRINTED_DEPTHS_MM = (0.15, 0.3, 0.4, 0.5, 0.6)
PRINTED_P_OVER_EW_MM = (19.43218, 20.18817, 20.72537, 21.27769, 21.85972)
PRINTED_START_MM = 18.83
PRINTED_BETA = 0.8698


def slope_N_per_mm(modulus_MPa: float, nu: float, radius_mm: Floats, thickness_mm: Floats) -> Floats:
    """dP/dw of a sharp frictionless punch as w goes to 0."""
    kappa = _kappa().ev(np.full(np.shape(radius_mm), nu), radius_mm / thickness_mm)
    return np.asarray(2 * radius_mm * modulus_MPa * kappa / (1 - nu**2))


def bend(strain: Floats, ratio: Floats, *, straight: bool) -> Floats:
    """P/(w dP/dw(0)) at w/h = `strain` and a/h = `ratio`, of a sharp punch on a neo-Hookean gel that sticks to it.

    `straight`: the printed row's own line, which is what the usual law knows; else the parabola through the row.
    How both grow with a/h is taken from punch_fem.csv.
    """
    strain = np.maximum(strain, 0) * _growth()(ratio)
    if straight:
        return np.asarray(1 + PRINTED_BETA * strain)
    line, curve = _printed_parabola()
    return np.asarray(1 + line * strain + curve * strain**2)


def times_frictionless(contact: Contact, strain: Floats, ratio: Floats) -> Floats:
    """Force over that of the same punch without friction, by finite elements; smoothed over strain and a/h."""
    line = _ratio(contact)
    return np.asarray(sum(line[k](ratio) * np.maximum(strain, 0) ** k for k in range(3)))


def rounded(edge: float, strain: Floats, ratio: float) -> Floats:
    """Force of a punch with a rounded edge over a sharp one's, at rho/h = `edge`, w/h = `strain`, a/h = `ratio`.

    By finite elements of a gel that slides (edge_fem.csv), as the slope of `slope_N_per_mm` does.
    """
    lost = _lost_to_the_edge()
    return np.asarray(1 - lost((np.minimum(ratio, lost.grid[0][-1]), edge, np.clip(strain, 0, lost.grid[2][-1]))))


def rows(name: str) -> list[dict[str, str]]:
    """A table of this folder."""
    with (HERE / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


@lru_cache(maxsize=1)
def _kappa() -> RectBivariateSpline:
    from scipy.interpolate import RectBivariateSpline

    table = {(float(r["nu"]), float(r["a_over_h"])): float(r["kappa"]) for r in rows("kappa.csv")}
    nu, ratio = (np.array(sorted({key[k] for key in table})) for k in (0, 1))
    return RectBivariateSpline(nu, ratio, [[table[n, q] for q in ratio] for n in nu])


def _ratios(contact: str, nu: str) -> dict[float, dict[float, float]]:
    """Radius -> depth -> P/w, for E = 1 MPa, from .1 mm on: above that the finite elements still round the
    edge.
    """
    found: dict[float, dict[float, float]] = {}
    for row in rows("punch_fem.csv"):
        if row["contact"] == contact and row["nu"] == nu and float(row["w_mm"]) >= FIRST_MM:
            found.setdefault(float(row["a_mm"]), {})[float(row["w_mm"])] = float(row["P_over_w_N_per_mm"])
    return dict(sorted(found.items()))


def _parabola(depth_mm: list[float], values: list[float]) -> Floats:
    strain = np.array(depth_mm) / FEM_THICKNESS_MM
    return np.asarray(np.polynomial.polynomial.polyfit(strain, values, 2))


def _over_ratio(fits: dict[float, Floats], k: int) -> np.poly1d:
    """Coefficient k of parabolas in the strain, itself a parabola in a/h."""
    ratio = np.array(list(fits)) / FEM_THICKNESS_MM
    return np.poly1d(np.polyfit(ratio, [fit[k] for fit in fits.values()], 2))


@lru_cache(maxsize=1)
def _growth() -> np.poly1d:
    """The bend at some a/h over that at a/h = 2.5/3: the chords' slopes of the finite elements."""
    slopes = {}
    for a, table in _ratios("sticks", "0.48").items():
        line, start = np.polyfit(np.array(list(table)) / FEM_THICKNESS_MM, list(table.values()), 1)
        slopes[a / FEM_THICKNESS_MM] = line / start
    fitted = np.poly1d(np.polyfit(list(slopes), list(slopes.values()), 2))
    return np.poly1d(fitted / fitted(2.5 / FEM_THICKNESS_MM))


@lru_cache(maxsize=1)
def _printed_parabola() -> tuple[float, float]:
    """Coefficients of strain and strain^2 over the slope at w -> 0."""
    strain = np.array(PRINTED_DEPTHS_MM) / FEM_THICKNESS_MM
    rise = np.array(PRINTED_P_OVER_EW_MM) / PRINTED_START_MM - 1
    line, curve = np.linalg.lstsq(np.column_stack([strain, strain**2]), rise, rcond=None)[0]
    return float(line), float(curve)


@lru_cache(maxsize=1)
def _lost_to_the_edge() -> RegularGridInterpolator:
    """Share of the sharp punch's force that is missing, over a/h, rho/h and w/h.

    The sharp punch is the limit of the three sharpest edges by Aitken's step: what is lost goes with rho while the
    contact grows, and with rho^1.5 once it is whole, as it is taken to be where an edge was not pressed so deep.
    """
    from scipy.interpolate import RegularGridInterpolator

    table = [[float(value) for value in row.values()] for row in rows("edge_fem.csv")]
    radius, edge, depth = (np.unique([row[k] for row in table]) for k in range(3))
    force = np.full((radius.size, edge.size, depth.size), np.nan)
    for a, rho, w, value in table:
        force[np.searchsorted(radius, a), np.searchsorted(edge, rho), np.searchsorted(depth, w)] = value
    for k in (1, 0):  # edges that double
        whole = force[:, k + 1] + (force[:, k + 1] - force[:, k + 2]) / 2**1.5
        force[:, k] = np.where(np.isfinite(force[:, k]), force[:, k], whole)
    steps = -np.diff(force[:, :3], axis=1)
    doubled = np.clip(steps[:, 1:] / steps[:, :1], 2.0, 2**1.5)
    limit = force[:, :1] + steps[:, :1] / (doubled - 1)
    lost = np.concatenate([np.zeros_like(limit), 1 - force / limit], axis=1)
    near, next_one = depth[:2] ** (2 / 3)  # the contact grows with this power at first
    start = lost[:, :, :1] + (lost[:, :, :1] - lost[:, :, 1:2]) * near / (next_one - near)
    lost = np.concatenate([start, lost], axis=2)
    axes = (radius, np.append(0.0, edge), np.append(0.0, depth))
    return RegularGridInterpolator([axis / FEM_THICKNESS_MM for axis in axes], lost, method="cubic")


@lru_cache(maxsize=8)
def _ratio(contact: Contact) -> tuple[np.poly1d, ...]:
    """Coefficients of strain^0 .. strain^2; over the frictionless punch, but over one that sticks for the laws."""
    law = contact in ("yeoh", "gent")
    top = _ratios(contact, "0.48" if law else "0.49")
    below = _ratios("sticks", "0.48") if law else _ratios("slides", "0.49")
    fits = {}
    for a, table in top.items():
        depths = [w for w in table if w in below[a]]
        fits[a] = _parabola(depths, [table[w] / below[a][w] for w in depths])
    return tuple(_over_ratio(fits, k) for k in range(3))
