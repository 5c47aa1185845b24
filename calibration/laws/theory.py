"""Theory of a contact law: stiffness, sticking, the admissible range of beta, plausible E and nu."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.layer import layer_compliance
from tactilevision.mechanics.tables.punch import force_ratio
from tactilevision.mechanics.tables.table import Table, shipped_table
from tactilevision.records.measured import Estimate, Floats, Material, Pair
from tactilevision.records.rig import Gel

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


# What slope and bend P/w against w/h can have, by finite elements, for a sharp punch on a gel of known h.
#
# The slope beta: the largest is a Hencky solid's that sticks, by independent finite elements at a/h = .833, h = 3,
# depths .15 to .6 mm, and grows with a/h as the tables of mechanics have it; the smallest a neo-Hookean one's that
# slides freely, by the tables at a/h .5, where it is smallest, w/h .05 to .2. A free beta outside of this is
# fitting something else: a depth zero, another thickness, a rounded edge, a gel that stiffens. A punch that rubs
# at all has more than RUBBING.
#
# The bend gamma, of P/w = c (1 + beta w/h + gamma (w/h)^2), from the tables of mechanics: neo-Hooke and Hencky,
# from no friction to no slip, at this nu, a/h and edge, widened by what an error of the table as stated on its
# card can make of it. Where presses go deeper than the table its parabola is carried on.

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


# Is it a gel? What Young's modulus and Poisson's ratio the pads of such sensors can have at all.

# From the softest casting gels (Shore 000, some 5 kPa) to silicone of Shore A 80, 9.4 MPa by Gent's relation
# E = .0981 (56 + 7.62336 S) / (.137505 (254 - 2.54 S)) MPa (A. N. Gent, Rubber Chem. Technol. 31, 1958, 896)
GEL_MODULUS_MPA: Pair = (0.005, 10.0)
FLAG = "modulus_outside_gels"
# Rubber lies at .45 to .5; from .3 on the tables of finite elements know a gel; below it are foam and cork
LEAST_POISSON_RATIO = 0.3
NU_FLAG = "poisson_ratio_outside_gels"


def outside_gels(modulus: Estimate) -> str:
    """A sentence where E, or all of its interval where it has no value, is that of no gel; else empty."""
    low, high = modulus.interval95 or (modulus.value, modulus.value)
    if modulus.value is not None:
        low = high = modulus.value
    if low is None or high is None or (low <= GEL_MODULUS_MPA[1] and high >= GEL_MODULUS_MPA[0]):
        return ""
    found = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    return (
        f"E = {found} MPa is that of no gel ({GEL_MODULUS_MPA[0]:g} to {GEL_MODULUS_MPA[1]:g} MPa): are forces "
        "in N, and depths, radii and thickness in mm?"
    )


def stated_outside_gels(gel: Gel) -> str:
    """A sentence where the nu that is stated, with twice its std, is that of no gel; else empty."""
    nu = gel.poisson_ratio
    if nu is None or nu + 2 * (gel.poisson_ratio_std or 0.0) >= LEAST_POISSON_RATIO:
        return ""
    return (
        f"E rests on nu = {nu:g}, which [sensor.gel] states; rubbers and gels have 0.45 to 0.5: at rubber's nu "
        "the same forces give a far smaller E. State the gel's own, or leave poisson_ratio out"
    )


def apart_from_stated(modulus: Estimate, gel: Gel) -> str:
    """A sentence where the E of recording.toml, with twice its std, lies outside of the interval found."""
    stated, half = gel.youngs_modulus_MPa, 2 * (gel.youngs_modulus_std_MPa or 0.0)
    if stated is None or modulus.interval95 is None:
        return ""
    low, high = modulus.interval95
    if stated + half >= low and stated - half <= high:
        return ""
    return (
        f"E lies in {low:.3g} to {high:.3g} MPa, apart from the {stated:.3g} MPa that [sensor.gel] states, which "
        "takes no part in the fit: check its unit, the thickness and the radii"
    )


# How much stiffer a punch is that sticks than one that slides freely, for a linear bonded layer.
#
# Complementary energy over shapes of pressure P_2n(s)/s and of shear that end like 1/s at the punch's edge, where
# s^2 = 1 - r^2. Their Hankel transforms are spherical Bessel functions, which are orthogonal:
#
#     A a + B b = w f,    B^T a + D b = 0,    P_stick/P_free = f^T (A - B D^-1 B^T)^-1 f / (f^T A^-1 f)
#
# with A, B, D the Hankel integrals of the layer's compliances C_zz, C_zr, C_rr. Both numerator and denominator
# come from below; their ratio is good to .1 %. On a half-space it tends to Spence's (1 - nu) ln(3 - 4 nu)/(1 - 2
# nu). Sources: Spence, Proc. R. Soc. A 305 (1968) 55; Sneddon, Fourier Transforms (1951), sec. 52.

SHAPES = 12  # of pressure and of shear: the ratio is good to .1 %
XI_END = 600.0  # largest wave number, 1/a
XI_STEP = 0.05  # between wave numbers, 1/a: a twentieth of what a layer of thickness a asks for


def sticking_surplus(poisson_ratio: float, a_over_h: float) -> float:
    """P_stick/P_free - 1: 0 for a half-space at nu = .5, some per cent at a/h near 1, smooth in nu.

    nu in [0, .4999] and a/h in [.05, 5]; beyond, the nearest of these.
    """
    nu = min(max(poisson_ratio, 0.0), 0.4999)
    return max(float(_spline(round(min(max(a_over_h, 0.05), 5.0), 3))(nu)), 0.0)


@lru_cache(maxsize=128)
def _spline(a_over_h: float) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    nodes = 0.4999 * np.sin(np.linspace(0, np.pi / 2, 14))  # crowded towards nu = .5
    return CubicSpline(nodes, [exact_surplus(float(nu), a_over_h) for nu in nodes])


def exact_surplus(poisson_ratio: float, a_over_h: float) -> float:
    """The same without interpolation; a few milliseconds."""
    xi, weight = _waves()
    pressure, shear = _transforms()
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
def _waves() -> tuple[Floats, Floats]:
    xi = np.arange(1e-6, XI_END, XI_STEP)
    weight = np.full(xi.size, XI_STEP)
    weight[0] /= 2
    return xi, weight


@lru_cache(maxsize=1)
def _transforms() -> tuple[Floats, Floats]:
    """Of the pressures with J0, j_0 j_2 j_4 ..., and of the shears with J1, j_1 j_3 ...: (SHAPES, waves) each."""
    from scipy.special import spherical_jn

    xi, _ = _waves()
    order = 2 * np.arange(SHAPES)[:, None]
    return spherical_jn(order, xi), spherical_jn(order + 1, xi)


# Stiffness of a punch on a bonded layer, for every sample of a fit.
#
# P = 2 a E kappa(nu, a/h) / (1 - nu^2) * w

NU_RANGE: Pair = (0.0, 0.4999)  # of kappa's table; beyond it as at its ends
RATIO_RANGE: Pair = (0.05, 10.0)  # a/h of kappa's table; beyond it as at its ends


def punch_stiffness(
    modulus_MPa: float, poisson_ratio: float, *, radius_mm: Floats, thickness_mm: Floats
) -> Floats:
    """Force over depth of a frictionless flat punch, N/mm; radius and thickness of one shape (N,).

    nu and a/h are held inside their ranges, so that an optimiser that strays meets a wall and not an error.
    """
    nu = float(np.clip(poisson_ratio, *NU_RANGE))
    ratio = np.clip(radius_mm / thickness_mm, *RATIO_RANGE)
    kappa = _kappa(nu, ratio.tobytes())
    return np.asarray(2 * radius_mm * modulus_MPa * kappa / (1 - nu**2))


@lru_cache(maxsize=128)
def _kappa(poisson_ratio: float, ratios: bytes) -> Floats:
    """kappa of packed a/h: a derivative with respect to anything but nu, a and h asks for the same again."""
    few, where = np.unique(np.frombuffer(ratios), return_inverse=True)
    kappa = fast_kappa(poisson_ratio, few)[where]
    kappa.setflags(write=False)
    return kappa
