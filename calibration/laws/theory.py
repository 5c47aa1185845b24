"""Theory of a contact law: stiffness, sticking, the admissible range of beta, plausible E and nu.

The largest slope beta is that of a sticking Hencky solid, by independent finite elements at a/h = .833, h = 3 mm,
depths .15 to .6 mm, and grows with a/h as in the tables of mechanics; the smallest that of a frictionless
neo-Hookean solid at a/h = .5, w/h .05 to .2. A free beta outside this range takes up something else: a depth zero,
another thickness, a rounded edge, a stiffening gel. The bend gamma comes from the same tables, widened by their
stated error; beyond the tabulated depth the parabola is extrapolated.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.model.dual import chained, moves, value_of
from tactilevision.errors import InputError
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.kappa import kappa_at
from tactilevision.mechanics.layer import layer_compliance
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.mechanics.tables.punch import force_ratio
from tactilevision.mechanics.tables.table import Table, shipped_table
from tactilevision.records.constants import MICRO, NU_MAX, NU_NOMINAL
from tactilevision.records.measured import Estimate, Floats, Material, Pair
from tactilevision.records.rig import Gel

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Range of beta and gamma in P/w = c (1 + beta eps + gamma eps^2), eps = w/h, of a sharp punch, by finite elements.
NU = (0.3, 0.4, 0.45, 0.48, 0.495)  # nu of HIGHEST and LOWEST
HIGHEST = (1.34, 1.23, 1.2, 1.13, 1.08)  # beta of a Hencky solid that sticks
LOWEST = (0.56, 0.08, -0.24, -0.46, -0.57)  # beta of a neo-Hookean solid without friction
WIDER = (0.5, 0.65, 0.83, 1.0, 1.1, 1.2)  # a/h of GROWTH; the figures hold between the ends
# largest beta over that at .833, of nu .45 to .49; extrapolated to 1.2
GROWTH = (0.66, 0.87, 1.0, 1.12, 1.3, 1.45)
THEORY_BETA = 0.85  # beta of a neo-Hookean solid that sticks, at THEORY_RATIO
THEORY_RATIO = 2.5 / 3  # a/h of THEORY_BETA
RUBBING = 0.1  # least beta of a punch with any friction
STRAINS = 20  # depths at which the bend is fitted
MIN_STRAIN = 1e-3  # range of w/h that determines a bend; half of it beyond the table is rounding


def beta_range(poisson_ratio: Pair, a_over_h: float) -> Pair | None:
    """Return the smallest and the largest beta for any nu in this range; None outside the figures' a/h."""
    if not WIDER[0] <= a_over_h <= WIDER[-1]:
        return None
    low, high = np.clip(poisson_ratio, NU[0], NU[-1])
    places = [low, *(nu for nu in NU if low < nu < high), high]  # the largest may lie between the ends
    grown = float(np.interp(a_over_h, WIDER, GROWTH))
    return float(np.min(np.interp(places, NU, LOWEST))), grown * float(np.max(np.interp(places, NU, HIGHEST)))


def beta_outside_theory(beta: Estimate, poisson_ratio: Estimate, *, a_over_h: float) -> str:
    """Return a sentence where all of beta's interval lies outside the range of contact laws; else empty."""
    allowed = beta_range(poisson_ratio.interval95 or (NU[0], NU[-1]), a_over_h)
    if allowed is None or beta.interval95 is None or beta.value is None:
        return ""
    low, high = beta.interval95
    if low <= allowed[1] and high >= allowed[0]:
        return ""
    return (
        f"beta = {beta.value:.2f} lies outside the range of contact laws here, {allowed[0]:.1f} to "
        f"{allowed[1]:.2f}: thickness, a rounded edge, the depth's zero or a stiffening gel are candidates"
    )


def deeper_than_elements(deepest: float) -> str:
    """Return a sentence where presses go deeper (w/h) than the tabulated finite elements; else empty."""
    table = float(shipped_table().axes.depths[-1])
    if deepest <= table + MIN_STRAIN / 2:
        return ""
    return (
        f"presses go to {deepest:.2f} of the gel's thickness, finite elements are tabulated to {table:g}: the "
        "range of contact laws is extrapolated from there"
    )


@lru_cache(maxsize=64)
def bend_range(poisson_ratio: float, a_over_h: float, deepest: float) -> Pair:
    """Return the smallest and the largest gamma of any tabulated law and friction, over w/h up to `deepest`.

    nu and a/h are clipped to the tables, whose sharpest edge is taken.
    """
    table = shipped_table()
    nu, ratio, depth = table.axes.poisson_ratios, table.axes.a_over_h, table.axes.depths
    place = (float(np.clip(poisson_ratio, nu[0], nu[-1])), float(np.clip(a_over_h, ratio[0], ratio[-1])))
    strain = np.linspace(1 / STRAINS, 1, STRAINS) * np.clip(deepest, MIN_STRAIN, float(depth[-1]))
    bends = [bend for block in table.blocks for bend in _bend(table, (block.law, block.friction), place, strain)]
    stated = table.card["errors"]
    off = stated["interpolation_force"] + stated["sharp_limit_at_first_touch"]
    error = 4 * float(off) / strain[-1] ** 2  # an error largest half way is a parabola of this gamma
    return min([0.0, *bends]) - error, max([0.0, *bends]) + error


def _bend(table: Table, kind: tuple[str, float], place: Pair, strain: Floats) -> tuple[float, ...]:
    """Return gamma of one law and friction, weighted by force; nothing where the table holds too few depths."""
    law, friction = kind
    edges = [block.edge_over_h for block in table.blocks if block.law == law]
    contact = FlatContact(place[1], 0.0 if len(set(edges)) > 1 else edges[0], 1.0, friction, law)
    try:
        secant, known = force_ratio(strain, contact, material=Material(1.0, place[0]), table=table)
    except InputError:
        return ()
    if np.count_nonzero(known) < 4 or np.ptp(strain[known]) < MIN_STRAIN:
        return ()
    eps, weight = strain[known], strain[known]
    start, _, bend = np.polynomial.polynomial.polyfit(eps, secant[known], 2, w=weight)
    return (float(bend / start),)


# Plausible E and nu of a gel pad: from the softest casting gels (Shore 000, some 5 kPa) to silicone of Shore A 80,
# 9.4 MPa by Gent's relation E = .0981 (56 + 7.62336 S) / (.137505 (254 - 2.54 S)) MPa (A. N. Gent, Rubber Chem.
# Technol. 31, 1958, 896). Rubber has nu .45 to .5; below the tables' .3 are foam and cork.
GEL_MODULUS_MPA: Pair = (0.005, 10)
FLAG = "modulus_outside_gels"
NU_FLAG = "poisson_ratio_outside_gels"
LEAST_POISSON_RATIO = NU[0]  # of the tabulated ones


def nominal_nu(gel: Gel) -> float:
    """Return the gel's stated Poisson's ratio, or NU_NOMINAL where none is stated."""
    return NU_NOMINAL if gel.poisson_ratio is None else gel.poisson_ratio


def outside_gels(modulus: Estimate) -> str:
    """Return a sentence where E, or all of its interval where it has no value, is no gel's; else empty."""
    low, high = modulus.interval95 or (modulus.value, modulus.value)
    if modulus.value is not None:
        low = high = modulus.value
    if low is None or high is None or (low <= GEL_MODULUS_MPA[1] and high >= GEL_MODULUS_MPA[0]):
        return ""
    found = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    return (
        f"E = {found} MPa lies outside the range of gels ({GEL_MODULUS_MPA[0]:g} to {GEL_MODULUS_MPA[1]:g} MPa): "
        "are forces in N, and depths, radii and thickness in mm?"
    )


def stated_outside_gels(gel: Gel) -> str:
    """Return a sentence where the stated nu, with twice its std, is no gel's; else empty."""
    nu = gel.poisson_ratio
    if nu is None or nu + 2 * (gel.poisson_ratio_std or 0.0) >= LEAST_POISSON_RATIO:
        return ""
    return (
        f"E rests on nu = {nu:g} as stated in [sensor.gel]; rubbers and gels have 0.45 to 0.5, and at such nu the "
        "same forces give a far smaller E. State the gel's own nu, or remove poisson_ratio"
    )


def apart_from_stated(modulus: Estimate, gel: Gel) -> str:
    """Return a sentence where the stated E, with twice its std, lies outside the fitted interval; else empty."""
    stated, half = gel.youngs_modulus_MPa, 2 * (gel.youngs_modulus_std_MPa or 0.0)
    if stated is None or modulus.interval95 is None:
        return ""
    low, high = modulus.interval95
    if stated + half >= low and stated - half <= high:
        return ""
    return (
        f"E lies in {low:.3g} to {high:.3g} MPa, but [sensor.gel] states {stated:.3g} MPa, which is not used in "
        "the fit: check its unit, the thickness and the radii"
    )


# Stiffness of a punch that sticks over one that slides freely, on a linear bonded layer.

SHAPES = 12  # of pressure and of shear: the ratio is good to .1 %
XI_END = 600  # largest wave number, 1/a
XI_STEP = 0.05  # between wave numbers, 1/a: a twentieth of what a layer of thickness a needs


def sticking_surplus(poisson_ratio: Any, a_over_h: float) -> Any:
    """Return P_stick/P_free - 1: 0 for a half-space at nu = .5, some per cent at a/h near 1, smooth in nu.

    nu is clipped to [0, .4999] and a/h to [.05, 5].
    """
    nu = min(max(poisson_ratio, 0.0), NU_MAX)
    spline, at = _spline(round(min(max(a_over_h, A_OVER_H_RANGE[0]), 5), 3)), float(value_of(nu))
    surplus = max(float(spline(at)), 0.0)
    return chained(surplus, [(float(spline(at, 1)) * (surplus > 0), nu)]) if moves(nu) else surplus


@lru_cache(maxsize=128)
def _spline(a_over_h: float) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    nodes = NU_MAX * np.sin(np.linspace(0, np.pi / 2, 14))  # denser towards nu = .5
    return CubicSpline(nodes, [exact_surplus(float(nu), a_over_h) for nu in nodes])


def exact_surplus(poisson_ratio: float, a_over_h: float) -> float:
    """Return P_stick/P_free - 1 without interpolation (a few milliseconds).

    Minimises the complementary energy over shapes of pressure P_2n(s)/s and of shear that end like 1/s at the
    edge, s^2 = 1 - r^2. Their Hankel transforms are spherical Bessel functions, which are orthogonal:

        A a + B b = w f,    B^T a + D b = 0,    P_stick/P_free = f^T (A - B D^-1 B^T)^-1 f / (f^T A^-1 f)

    with A, B, D the Hankel integrals of the layer's compliances C_zz, C_zr, C_rr. Both forces converge from below.
    On a half-space the ratio tends to Spence's (1 - nu) ln(3 - 4 nu)/(1 - 2 nu). Sources: Spence, Proc. R. Soc. A
    305 (1968) 55; Sneddon, Fourier Transforms (1951), sec. 52.
    """
    xi, weight, pressure, shear = _transforms()
    part = layer_compliance(xi / a_over_h, poisson_ratio)
    along = weight * xi
    A = (pressure * (along * part.normal)) @ pressure.T
    B = (pressure * (along * part.coupling)) @ shear.T
    D = (shear * (along * part.along)) @ shear.T
    force = pressure[:, 0]  # the transform at xi = 0 is the total over 2 pi
    free = force @ np.linalg.solve(A, force)
    stick = force @ np.linalg.solve(A - B @ np.linalg.solve(D, B.T), force)
    return max(float(stick / free) - 1, 0.0)


@lru_cache(maxsize=1)
def _transforms() -> tuple[Floats, Floats, Floats, Floats]:
    """Return wave numbers with weights, (waves,), and the transforms there, (SHAPES, waves): of the pressures (J0:
    j_0, j_2 ...) and of the shears (J1: j_1, j_3 ...).
    """
    from scipy.special import spherical_jn

    xi = np.arange(MICRO, XI_END, XI_STEP)
    weight = np.full(xi.size, XI_STEP)
    weight[0] /= 2
    order = 2 * np.arange(SHAPES)[:, None]
    return xi, weight, spherical_jn(order, xi), spherical_jn(order + 1, xi)


def punch_stiffness(
    modulus_MPa: float, poisson_ratio: float, *, radius_mm: Floats, thickness_mm: Floats | float
) -> Floats:
    """Return the force over depth (N,) of a frictionless flat punch, N/mm; radius (N,), thickness (N,) or one.

        P = 2 a E kappa(nu, a/h) / (1 - nu^2) w

    nu and a/h are clipped to the range of kappa's table, so that an optimiser outside it gets a value, not an
    error.
    """
    nu = np.clip(poisson_ratio, 0, NU_MAX)
    ratio = np.clip(radius_mm / thickness_mm, *A_OVER_H_RANGE)
    asked = float(value_of(nu)), value_of(ratio).tobytes()
    kappa: Any = _kappa(*asked)
    if moves(nu, ratio):
        of_nu, of_ratio = _kappa(*asked, slopes=True)
        kappa = chained(kappa, [(of_nu, nu), (of_ratio, ratio)])
    stiffness: Floats = 2 * radius_mm * modulus_MPa * kappa / (1 - nu**2)
    return stiffness


@lru_cache(maxsize=128)
def _kappa(poisson_ratio: float, ratios: bytes, *, slopes: bool = False) -> Floats:
    """Return kappa of packed a/h, or its slopes (2, N) over nu and a/h.

    Cached: derivatives with respect to other parameters ask for the same again.
    """
    every = np.frombuffer(ratios)
    runs = np.flatnonzero(np.append(True, every[1:] != every[:-1]))  # samples of a press follow one another
    kappa = kappa_at(poisson_ratio, every[runs], slopes=slopes)
    kappa = np.repeat(kappa, np.diff(np.append(runs, every.size)), axis=-1)
    kappa.setflags(write=False)
    return kappa
