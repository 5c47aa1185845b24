"""A colour law from contacts of unknown shape, where no ball was pressed.

A law that reads each contact as a surface is right but for its scale and its sign: with slopes read as W g of the
true ones g, no curl in all contacts leaves W = scale times 1, since gel never stays at its place untilted (the
untouched picture). Minimised over the coefficients c of a law is

    sum of w (equations c)^2 / s0^2 + PRIOR sum of (slopes(c) - slopes of the prior)^2 / mean square of these

w Cauchy weights, s0 the residual at the start; after each round the scale is the prior's again. The prior is a
network for such sensors or, without one, the constant law of the least curl, of a usual scale; contacts are dents.
How the law may vary over the picture goes with the number of contacts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg

from tactilevision.photometric.contacts.moments import TERMS, Contact
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS, Polynomial
from tactilevision.records import Bools, Floats

MIN_CONTACTS = 4  # contacts; with six of screws three real sensors were read better than by the network
MIN_SLOPE_SPREAD = (
    0.2  # least over most power of slope by direction, of fewer: 19 to 86 degrees off have .13 at most
)
MIN_CURVED = 8  # contacts for products of two colours
MIN_VARYING = 24  # contacts for a law that varies over the picture
MIN_SPREAD = 1.0  # half the picture: a law that varies runs away where nothing touched
PRIOR = 0.3  # weight of the prior; of 1 to .01 tried on four real sensors, all within a degree
RIDGE = 1e-4  # of a term's own power
MAX_ITERATIONS = 3  # of weighing equations anew; they settle in two
OUTLYING = 2.0  # deviations at which an equation counts half
USUAL_CHANGE = 2.2  # colour change over slope, of three colours together; real sensors 1.6 to 3.5
MIN_GAP = 4.0  # second least curl over the least: less, and contacts do not tell the law; real ones 14 to 60
STEEPEST = 99.5  # percentile of slopes read in the contacts that bounds later ones

Prior = Callable[[Floats, Floats], Floats]


def calibrate_on_contacts(contacts: Sequence[Contact], prior: Prior | None) -> Polynomial | None:
    """The law, or None where the contacts do not tell it.

    `prior` gives slopes (N, 2) of relative changes (N, 3) at places (N, 2) from -1 to 1. Fewer contacts than
    MIN_CONTACTS tell nothing better than a prior; without one they do where they slope to all sides.
    """
    few = len(contacts) < MIN_CONTACTS
    if not contacts or (few and prior is not None):
        return None
    equations, samples, change, place = (
        np.concatenate([getattr(one, name) for one in contacts])
        for name in ("equations", "samples", "change", "place")
    )
    if prior is None:
        constant = _least_curl(equations, samples, change, np.concatenate([one.outward for one in contacts]))
        if constant is None:
            return None
        target = change @ constant.T
        if few and _slope_spread(target) < MIN_SLOPE_SPREAD:
            return None
    else:
        target = prior(change, place)
    kept = _kept_terms(len(contacts), np.array([one.place.mean(axis=0) for one in contacts]))
    terms = samples[:, kept]
    both = np.concatenate([kept, kept])
    slopes, coefficients = _solve(equations[:, both], terms, target)
    full = np.zeros((2, len(PRODUCTS), len(POWERS)))
    at = np.array(TERMS)[kept]
    full[:, at[:, 0], at[:, 1]] = coefficients
    return Polynomial(full, float(np.percentile(np.hypot(*slopes.T), STEEPEST)))


def _kept_terms(contacts: int, middles: Floats) -> Bools:
    """Mask (K,) of the terms that so many contacts tell, with their middles (N, 2) from -1 to 1."""
    spread = np.ptp(middles, axis=0).min() > MIN_SPREAD
    order = (
        {1: 0, 2: -1}
        if contacts < MIN_CURVED
        else {1: 2, 2: 1}
        if contacts >= MIN_VARYING and spread
        else {1: 0, 2: 0}
    )
    return np.array([sum(POWERS[m]) <= order[len(PRODUCTS[k])] for k, m in TERMS])


def _solve(equations: Floats, terms: Floats, target: Floats) -> tuple[Floats, Floats]:
    """Slopes (N, 2) of the samples, and coefficients (2, K), with the scale of the `target` slopes (N, 2)."""
    power = float(np.sum(target**2))
    normal = terms.T @ terms / power
    normal[np.diag_indices_from(normal)] *= 1.0 + RIDGE
    held = scipy.linalg.block_diag(normal, normal)
    wanted = (terms.T @ target / power).T.ravel()
    found = np.linalg.solve(held, wanted)
    start = float(np.mean((equations @ found) ** 2))
    weights = np.ones(len(equations))
    for _ in range(MAX_ITERATIONS):
        curl = (equations * weights[:, None]).T @ equations / (len(equations) * start)
        found = np.linalg.solve(curl + PRIOR * held, PRIOR * wanted)
        slopes = terms @ found.reshape(2, -1).T
        found *= np.sqrt(power / float(np.sum(slopes**2)))
        weights = _cauchy(equations @ found)
    coefficients: Floats = np.asarray(found.reshape(2, -1), np.float64)
    return np.asarray(terms @ coefficients.T, np.float64), coefficients


def _least_curl(equations: Floats, samples: Floats, change: Floats, outward: Floats) -> Floats | None:
    """The constant law (2, 3) of the least curl for its power, of a usual scale, that makes contacts dents."""
    linear = np.array([len(PRODUCTS[k]) == 1 and sum(POWERS[m]) == 0 for k, m in TERMS])
    reduced, terms = equations[:, np.concatenate([linear, linear])], samples[:, linear]
    power = terms.T @ terms / len(terms)
    power[np.diag_indices(3)] *= 1.0 + RIDGE
    weights = np.ones(len(reduced))
    for _ in range(MAX_ITERATIONS + 1):
        curl = (reduced * weights[:, None]).T @ reduced / len(reduced)
        values, vectors = scipy.linalg.eigh(curl, scipy.linalg.block_diag(power, power))
        weights = _cauchy(reduced @ vectors[:, 0])
    if values[1] < MIN_GAP * values[0]:
        return None
    law = vectors[:, 0].reshape(2, 3)
    slopes = change @ law.T
    law = law * np.sqrt(np.sum(change**2) / np.sum(slopes**2)) / USUAL_CHANGE
    return np.asarray(-law if np.sum(slopes * outward) > 0 else law, np.float64)


def _slope_spread(slopes: Floats) -> float:
    """Power of slopes (N, 2) in the direction where it is least, over that where it is most: 1 for a ball."""
    least, most = np.linalg.eigvalsh(slopes.T @ slopes)
    return float(least / most)


def _cauchy(residual: Floats) -> Floats:
    scale = 1.4826 * float(np.median(np.abs(residual))) + 1e-300
    return np.asarray(1.0 / (1.0 + (residual / (OUTLYING * scale)) ** 2))
