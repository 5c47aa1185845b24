"""Hayes' factor kappa(nu, a/h): stiffness of a bonded layer under a flat punch over that of a half-space.

    P = 2 a E w kappa(nu, a/h) / (1 - nu^2)

P force (N), a punch radius, w depth (mm), E Young's modulus (MPa), h layer thickness. Assumes small strain, a
frictionless punch with a sharp edge, and a layer that reaches far beyond the punch. kappa -> 1 as a/h -> 0.

`kappa` solves the integral equation of punch_equation.py (relative error below 1e-10, half a millisecond each);
`fast_kappa` reads a quintic spline through such solutions (relative error below 1e-7, millions a second).
Both take nu in [0, .5], a/h in [.05, 10], numbers or arrays that broadcast, and raise InputError outside: nothing
is extrapolated. The table printed by Hayes et al. (1972) is low, by more than 1 % at nu = .5 and a/h = 3.

Source: Hayes, Keer, Herrmann, Mockros, J. Biomech. 5 (1972) 541.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, overload

import numpy as np
import numpy.typing as npt

from tactilevision.files.arrays import load_table, save_table
from tactilevision.mechanics.punch_equation import (
    A_OVER_H_RANGE,
    POISSON_RANGE,
    check_range,
    solve_punch,
)
from tactilevision.records.measured import Floats

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, RectBivariateSpline

TABLE = Path(__file__).with_name("kappa_table.npz")
DEGREE = 5  # of the splines through the table
TABLE_SHAPE = (49, 61)  # nodes over nu and a/h
OFFSET = 0.002  # tables run over -ln(.5 + OFFSET - nu): kappa is steepest at nu = .5


@overload
def kappa(poisson_ratio: float, a_over_h: float) -> float: ...
@overload
def kappa(poisson_ratio: npt.ArrayLike, a_over_h: npt.ArrayLike) -> float | Floats: ...
def kappa(poisson_ratio: npt.ArrayLike, a_over_h: npt.ArrayLike) -> float | Floats:
    """Return Hayes' stiffness factor kappa(nu, a/h), dimensionless, from the integral equation.

    Numbers give a float, arrays an array of their broadcast shape.
    """
    check_range(poisson_ratio, a_over_h, where="kappa")
    nu, alpha = np.broadcast_arrays(np.asarray(poisson_ratio, float), np.asarray(a_over_h, float))
    values = [solve_punch(float(n), float(a)).kappa for n, a in zip(nu.flat, alpha.flat, strict=True)]
    return values[0] if nu.ndim == 0 else np.array(values).reshape(nu.shape)


def fast_kappa(poisson_ratio: npt.ArrayLike, a_over_h: npt.ArrayLike) -> Floats:
    """Return kappa from the shipped table, of the arguments' broadcast shape; relative error below 1e-7."""
    check_range(poisson_ratio, a_over_h, where="fast_kappa")
    nu, alpha = np.broadcast_arrays(np.asarray(poisson_ratio, float), np.asarray(a_over_h, float))
    return np.asarray(np.exp(_spline().ev(_stretched(nu), np.log(alpha))))


def kappa_at(poisson_ratio: float, a_over_h: Floats, *, slopes: bool = False) -> Floats:
    """Return `fast_kappa` (N,) of one nu in a tenth of the time; or its slopes (2, N) over nu and over a/h."""
    (curve, of_nu), place = _at_nu(poisson_ratio), np.log(a_over_h)
    kappa = np.exp(curve(place))
    return np.asarray(kappa * np.array([of_nu(place), curve(place, 1) / a_over_h])) if slopes else kappa


@lru_cache(maxsize=64)  # a fit asks for many a/h at each nu
def _at_nu(poisson_ratio: float) -> tuple[BSpline, BSpline]:
    """Return ln kappa, and its derivative with respect to nu, as splines over ln(a/h)."""
    from scipy.interpolate import BSpline

    across, whole = _over_nu()
    place, per_nu = _stretched(np.array(poisson_ratio)), 1 / (0.5 + OFFSET - poisson_ratio)
    table, of_nu = whole(place), whole(place, 1) * per_nu
    return BSpline.construct_fast(across, table, DEGREE), BSpline.construct_fast(across, of_nu, DEGREE)


@lru_cache(maxsize=1)
def _over_nu() -> tuple[Floats, BSpline]:
    """Return the knots over ln(a/h), and the coefficients there as one spline over nu."""
    from scipy.interpolate import BSpline

    along, across, table = cast(Any, _spline()).tck
    return across, BSpline(along, table.reshape(along.size - DEGREE - 1, -1), DEGREE)


def make_table(path: Path = TABLE) -> None:
    """Compute the table of ln kappa and write it with its card; two seconds."""
    s, t = _axes()
    nu = np.clip(0.5 + OFFSET - np.exp(-s), *POISSON_RANGE)
    alpha = np.clip(np.exp(t), *A_OVER_H_RANGE)
    log_kappa = np.log(kappa(nu[:, None], alpha[None, :]))
    card = {
        "what": "ln kappa on a grid of -ln(.502 - nu) by ln(a/h), both evenly spaced over the range",
        "range": {"poisson_ratio": POISSON_RANGE, "a_over_h": A_OVER_H_RANGE},
        "source": "integral equation of mechanics/punch_equation.py; Hayes et al., J. Biomech. 5 (1972) 541",
        "made_by": "tactilevision.mechanics.kappa.make_table",
        "relative_error": 1e-7,
        "licence": "MIT",
    }
    save_table(path, card, log_kappa=log_kappa)


def _axes() -> tuple[Floats, Floats]:
    low, high = _stretched(np.array(POISSON_RANGE))
    s = np.linspace(low, high, TABLE_SHAPE[0])
    return s, np.linspace(np.log(A_OVER_H_RANGE[0]), np.log(A_OVER_H_RANGE[1]), TABLE_SHAPE[1])


def _stretched(nu: Floats) -> Floats:
    return np.asarray(-np.log(0.5 + OFFSET - nu))


@lru_cache(maxsize=1)
def _spline() -> RectBivariateSpline:
    from scipy.interpolate import RectBivariateSpline

    return RectBivariateSpline(*_axes(), load_table(TABLE)[0]["log_kappa"], kx=DEGREE, ky=DEGREE)
