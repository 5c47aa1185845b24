"""A colour law from contacts of unknown shape, where no ball was pressed.

A law that reads each contact as a surface is right but for its scale and its sign: with slopes read as W g of the
true ones g, no curl in all contacts leaves W = scale times 1, since gel never stays at its place untilted (the
untouched picture). Minimised over the coefficients c of a law is

    mean of w (equations c)^2 / s0^2 + (ANCHOR / contacts) mean of (slopes(c) - anchor)^2 / mean of anchor^2

w Cauchy weights, s0 the residual of the anchor; after each round the scale is the anchor's again. The anchor is a
law that is taken to hold all over the picture, so that c may vary with place even where nothing touched: without a
prior the constant law of the least curl, of a usual scale, contacts being dents; with one (a network for such
sensors) the mean of it and of the constant law that these contacts make of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import partial

import numpy as np
import scipy.linalg

from tactilevision.photometric.contacts.moments import TERMS, Contact, design
from tactilevision.photometric.contacts.roundness import round_equations
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS, Polynomial
from tactilevision.records import Floats

MIN_CONTACTS = 4  # contacts; fewer are said to be few
MIN_VARYING = 3  # contacts for a law that varies over the picture; two turned one real sensor by 58 degrees
MIN_SLOPE_SPREAD = 0.2  # least over most power of slope by direction: 19 to 86 degrees off have .13 at most
ANCHOR = 10.0  # weight of the anchor over contacts; 3 to 20 tried on nine real sensors, all within a degree
PRIOR = 0.3  # weight of the prior in the constant law; of 1 to .01 tried on four real sensors, all within a degree
ROUND = 30.0  # weight of axes of round contacts; 100 within .5 degrees on three real sensors (median)
ROUND_ITERATIONS = 3  # of finding axes anew
RIDGE = 1e-4  # of a term's own power
MAX_ITERATIONS = 3  # of weighing equations anew; they settle in two
OUTLYING = 2.0  # deviations at which an equation counts half
USUAL_CHANGE = 2.2  # colour change over slope, of three colours together; real sensors .8 to 3.5
MIN_GAP = 4.0  # second least curl over the least: less, and contacts do not tell the law; real ones 14 to 60
STEEPEST = 99.5  # percentile of slopes read in the contacts that bounds later ones
CONTRADICTION_DEG = 45.0  # median angle; right networks 5 to 12, swapped colours or a mirrored picture 59 and more
SPREADING = (0.7548776662, 0.5698402910)  # steps of a sequence that fills a square evenly (Roberts' R2)
LINEAR = np.array([len(PRODUCTS[k]) == 1 and sum(POWERS[m]) == 0 for k, m in TERMS])  # terms of a constant law

Prior = Callable[[Floats, Floats], Floats]


def calibrate_on_contacts(contacts: Sequence[Contact], prior: Prior | None) -> Polynomial | None:
    """The law, or None where the contacts do not tell it.

    `prior` gives slopes (N, 2) of relative changes (N, 3) at places (N, 2) from -1 to 1.
    """
    if not contacts:
        return None
    seen = _joined(contacts)
    constant = _least_curl(seen) if prior is None else _corrected(seen, prior(seen.change, seen.place))
    if constant is None:
        return None
    if _slope_spread(seen.change @ constant.T) < MIN_SLOPE_SPREAD:
        return None
    elsewhere = _all_over(len(seen.change))
    change, place = np.concatenate([seen.change, seen.change]), np.concatenate([seen.place, elsewhere])
    anchor = change @ constant.T
    if prior is not None:
        anchor = 0.5 * (anchor + prior(change, place))
    terms = np.concatenate([seen.samples, design(seen.change, elsewhere)])
    solve = partial(_solve, seen.equations, terms, anchor, scaled=len(seen.change), weight=ANCHOR / len(contacts))
    varies = len(contacts) >= MIN_VARYING
    coefficients = solve(rounds=MAX_ITERATIONS if varies else 0)
    for _ in range(ROUND_ITERATIONS if varies else 0):
        rows = [rows for one in contacts if (rows := round_equations(one, coefficients)) is not None]
        if rows:
            coefficients = solve(rounds=MAX_ITERATIONS, axes=rows)
    full = np.zeros((2, len(PRODUCTS), len(POWERS)))
    at = np.array(TERMS)
    full[:, at[:, 0], at[:, 1]] = coefficients
    slopes = seen.samples @ coefficients.T
    return Polynomial(full, float(np.percentile(np.hypot(*slopes.T), STEEPEST)))


def contradict(contacts: Sequence[Contact], prior: Prior) -> bool:
    """Whether contacts that tell the light, without the prior, turn its slopes by more than CONTRADICTION_DEG."""
    if not contacts:
        return False
    seen = _joined(contacts)
    constant = _least_curl(seen)
    if constant is None:
        return False
    own, told = seen.change @ constant.T, prior(seen.change, seen.place)
    if _slope_spread(own) < MIN_SLOPE_SPREAD:
        return False
    turned = np.angle((own @ [1, 1j]) * np.conj(told @ [1, 1j]))
    return bool(np.degrees(np.median(np.abs(turned))) > CONTRADICTION_DEG)


def _joined(contacts: Sequence[Contact]) -> Contact:
    """All contacts as one."""
    names = (one.name for one in fields(Contact))
    return Contact(**{name: np.concatenate([getattr(one, name) for one in contacts]) for name in names})


def _all_over(count: int) -> Floats:
    """Places (count, 2) that fill the picture evenly, from -1 to 1."""
    return np.asarray(2.0 * (np.arange(count)[:, None] * np.array(SPREADING) % 1.0) - 1.0, np.float64)


def _solve(
    equations: Floats,
    terms: Floats,
    anchor: Floats,
    *,
    scaled: int,
    weight: float,
    rounds: int,
    axes: Sequence[Floats] = (),
) -> Floats:
    """Coefficients (2, K) of `terms` (N, K) near slopes `anchor` (N, 2), whose first `scaled` keep their power.

    `axes` are the equations of each round contact.
    """
    power, own = float(np.sum(anchor**2)), float(np.sum(anchor[:scaled] ** 2))
    normal = terms.T @ terms / power
    normal[np.diag_indices_from(normal)] *= 1.0 + RIDGE
    held = scipy.linalg.block_diag(normal, normal)
    wanted = (terms.T @ anchor / power).T.ravel()
    found = np.linalg.solve(held, wanted)
    start = float(np.mean((equations @ found) ** 2))
    weights = np.ones(len(equations))
    across = np.concatenate(axes) if axes else np.zeros((1, len(found)))
    share = ROUND * scaled / (max(1, len(axes)) * own)
    about = np.ones(len(across))
    for _ in range(rounds):
        curl = (equations * weights[:, None]).T @ equations / (len(equations) * start)
        curl += share * (across * about[:, None]).T @ across
        found = np.linalg.solve(curl + weight * held, weight * wanted)
        slopes = terms[:scaled] @ found.reshape(2, -1).T
        found *= np.sqrt(own / float(np.sum(slopes**2)))
        weights, about = _cauchy(equations @ found), _cauchy(across @ found)
    return np.asarray(found.reshape(2, -1), np.float64)


def _corrected(seen: Contact, told: Floats) -> Floats:
    """The constant law (2, 3) near slopes `told` (N, 2) of the samples, of little curl."""
    both = np.concatenate([LINEAR, LINEAR])
    return _solve(
        seen.equations[:, both],
        seen.samples[:, LINEAR],
        told,
        scaled=len(told),
        weight=PRIOR,
        rounds=MAX_ITERATIONS,
    )


def _least_curl(seen: Contact) -> Floats | None:
    """The constant law (2, 3) of the least curl for its power, of a usual scale, that makes contacts dents."""
    reduced, terms = seen.equations[:, np.concatenate([LINEAR, LINEAR])], seen.samples[:, LINEAR]
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
    slopes = seen.change @ law.T
    law = law * np.sqrt(np.sum(seen.change**2) / np.sum(slopes**2)) / USUAL_CHANGE
    return np.asarray(-law if np.sum(slopes * seen.outward) > 0 else law, np.float64)


def _slope_spread(slopes: Floats) -> float:
    """Power of slopes (N, 2) in the direction where it is least, over that where it is most: 1 for a ball."""
    least, most = np.linalg.eigvalsh(slopes.T @ slopes)
    return float(least / most)


def _cauchy(residual: Floats) -> Floats:
    scale = 1.4826 * float(np.median(np.abs(residual))) + 1e-300
    return np.asarray(1.0 / (1.0 + (residual / (OUTLYING * scale)) ** 2))
