"""First contacts of presses that follow one law of force: what each leaves open, the others know.

    P = g_i (B1 x + B2 x²),    x = travel since first contact,    g_i = 1 +- tau

A short ramp by itself hardly tells its zero from its slope. Presses of one punch on one gel share slope and bend
but for a gain of their own (place, rest, temperature), whose scatter tau is what their laws scatter by beyond
their errors. The joint estimate shrinks each law towards the common one by just that, and its zero goes along.
What the common law leaves open moves all zeros alike. Presses whose laws differ in shape keep their own.

Linear in the laws' errors; tau by moments (Paule and Mandel, J. Res. NBS 87 (1982) 377). Lengths in mm, N.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.certificate.force.contact_point import ContactPoint
from tactilevision.records import Floats

_MIN_COUNT = 3  # presses from which a law is called common; tests.certificate.test_shared_contact_law
_MAX_SCATTER = 0.05  # of gains: beyond it presses have little to tell each other; test_shared_contact_law
_MAX_SIGMA = 4.0  # of chi-square beyond which laws differ in more than gains; test_shared_contact_law


@dataclass(frozen=True, slots=True, eq=False)
class _SharedLaw:
    """B (2,) in N/mm and N/mm², its covariance, tau, and whether presses differ by no more than it says."""

    law: Floats
    covariance: Floats
    scatter: float
    fits: bool


def shared_contact_law(
    found: Mapping[str, ContactPoint], pace_mm_s: Mapping[str, float]
) -> dict[str, ContactPoint]:
    """The first contacts, each with what the others know of its law; as they are where they share none."""
    own = {name: _by_travel(one, pace_mm_s[name]) for name, one in found.items()}
    laws = np.array([law for law, _ in own.values()]).reshape(-1, 2)
    spreads = np.array([spread for _, spread in own.values()]).reshape(-1, 3, 3)
    common = _shared_law(laws, spreads[:, 1:, 1:]) if len(found) >= _MIN_COUNT else None
    if common is None or not common.fits:
        return dict(found)
    return {
        name: _shrink(found[name], law, spread, common, pace_mm_s[name]) for name, (law, spread) in own.items()
    }


def _by_travel(one: ContactPoint, pace: float) -> tuple[Floats, Floats]:
    """b1, b2 over travel, and the covariance (3, 3) of the zero (mm) and them."""
    scale = np.array([pace, 1 / pace, pace**-2])
    return one.law * scale[1:], one.covariance * np.outer(scale, scale)


def _shared_law(laws: Floats, spreads: Floats) -> _SharedLaw:
    from scipy.optimize import brentq

    dof = 2 * (len(laws) - 1)
    alike, square = _at_scatter(laws, spreads, 0.0)
    if square <= dof:
        return alike
    apart, square = _at_scatter(laws, spreads, _MAX_SCATTER)
    if square > dof:
        return replace(apart, fits=square <= dof + _MAX_SIGMA * np.sqrt(2 * dof))
    scatter = brentq(lambda tau: _at_scatter(laws, spreads, tau)[1] - dof, 0.0, _MAX_SCATTER, xtol=1e-5)
    return _at_scatter(laws, spreads, float(scatter))[0]


def _at_scatter(laws: Floats, spreads: Floats, scatter: float) -> tuple[_SharedLaw, float]:
    """The common law for a given tau, and chi-square of the presses about it."""
    law = np.median(laws, axis=0)
    for _ in range(3):
        weights = np.linalg.inv(spreads + scatter**2 * np.outer(law, law))
        covariance = np.linalg.inv(weights.sum(axis=0))
        law = covariance @ np.einsum("kij,kj->i", weights, laws)
    apart = laws - law
    return _SharedLaw(law, covariance, scatter, True), float(np.einsum("ki,kij,kj->", apart, weights, apart))


def _shrink(one: ContactPoint, law: Floats, spread: Floats, common: _SharedLaw, pace: float) -> ContactPoint:
    whole = spread[1:, 1:] + common.scatter**2 * np.outer(common.law, common.law)
    pull = np.linalg.solve(whole, spread[1:, 0])
    zero = one.time_s + float(pull @ (common.law - law)) / pace
    own = max(float(spread[0, 0] - pull @ spread[1:, 0]), 0.0)
    shared = float(np.sqrt(pull @ common.covariance @ pull))
    return replace(one, time_s=zero, std_s=float(np.sqrt(own)) / pace, shared_s=shared / pace)
