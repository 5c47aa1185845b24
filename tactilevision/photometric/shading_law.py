"""Fit the shading law of the light to ball samples, and the camera's gamma."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from tactilevision.photometric.ball_samples import TYPICAL, Samples
from tactilevision.photometric.drift import LINEAR_TERMS, SOFTENING_GREY, Response
from tactilevision.records.measured import Bools, Floats

# Shading law of one light: response of the colours to slope, fitted to samples of balls.
#
#     (1 + u_c) sqrt(1 + p^2 + q^2) - 1 = sum_ij L_cij(X, Y) p^i q^j        1 <= i + j <= 4
#
# u_c is the change of colour, p and q the slopes, X and Y the place from -1 to 1. L is a polynomial in place whose
# order depends on i + j (PLACE_ORDER). Valid for slopes within those of the balls.

PLACE_ORDER = {1: 3, 2: 1, 3: 1, 4: 0}  # order in place of the terms of i + j; near lamps need the third
PLACE_PENALTIES = (1e-4, 1e-3)  # of the change of L over the picture; held-out balls choose
ORDER_PENALTY = 1e-2  # of terms beyond the first order in slope; keeps L near a plane
TYPICAL_SLOPE = 0.3  # slope at which the terms of all orders weigh alike
RIDGE = 1e-7  # keeps the fit solvable


def terms_of(place_order: Mapping[int, int]) -> npt.NDArray[np.int64]:
    """Return the powers (terms, 4), dimensionless, of p, q, X, Y, for orders in place by i + j."""
    return np.array(
        [
            (i, order - i, k, n - k)
            for order, most in place_order.items()
            for i in range(order + 1)
            for n in range(most + 1)
            for k in range(n + 1)
        ]
    )


TERMS = terms_of(PLACE_ORDER)
SLOPE_POWERS = tuple(dict.fromkeys((int(i), int(j)) for i, j in TERMS[:, :2]))  # powers of p and q, each once


def fit_light(
    contact: Samples, uneven: float = PLACE_PENALTIES[0], *, terms: npt.NDArray[np.int64] = TERMS
) -> Floats:
    """Fit L (terms, 3), dimensionless, to samples; `terms`: powers (terms, 4), `uneven`: penalty on place."""
    square = np.sum(contact.slopes**2, axis=1)
    scale = TYPICAL_SLOPE ** -terms[:, :2].sum(axis=1).astype(float)
    design = _design(contact.slopes, contact.place, terms) * scale
    target = (1.0 + contact.change) * np.sqrt(1.0 + square)[:, None] - 1.0
    weights = 1.0 / (square + TYPICAL**2)
    weighted = design * (weights / weights.sum())[:, None]
    normal = weighted.T @ design
    normal[np.diag_indices_from(normal)] += (
        RIDGE + uneven * terms[:, 2:].sum(axis=1) + ORDER_PENALTY * (terms[:, :2].sum(axis=1) - 1)
    )
    return np.asarray(np.linalg.solve(normal, weighted.T @ target) * scale[:, None])


def colours_of(law: Floats, slopes: Floats, *, place: Floats) -> Floats:
    """Return the changes of colour (N, 3) of `slopes` (N, 2) at `place` (N, 2) by `law`."""
    square = np.sum(slopes**2, axis=1)
    return np.asarray((1.0 + _design(slopes, place, TERMS) @ law) / np.sqrt(1.0 + square)[:, None] - 1.0)


def answers_at(law: Floats, place: Floats) -> Floats:
    """Return the coefficients (N, 14, 3) of the products of slopes in SLOPE_POWERS at places (N, 2)."""
    orders = [tuple(one) for one in TERMS[:, :2].tolist()]
    parts = _design(np.ones_like(place), place, TERMS)[:, :, None] * law
    return np.stack([parts[:, [n == at for n in orders]].sum(axis=1) for at in SLOPE_POWERS], axis=1)


def colours_by(answers: Floats, slopes: Floats) -> Floats:
    """Return the changes of colour (N, 3) of `slopes` (N, 2) by `answers` (N, 14, 3), faster than `colours_of`."""
    powers, (i, j) = _powers(slopes.T), np.array(SLOPE_POWERS).T
    light = 1.0 + np.matmul((powers[i, 0] * powers[j, 1]).T[:, None], answers)[:, 0]
    return np.asarray(light / np.sqrt(1.0 + powers[2].sum(axis=0))[:, None] - 1.0)


def _design(slopes: Floats, place: Floats, terms: npt.NDArray[np.int64]) -> Floats:
    powers, (i, j, k, n) = _powers(np.concatenate([slopes, place], axis=1).T), terms.T
    return np.asarray((powers[i, 0] * powers[j, 1] * (powers[k, 2] * powers[n, 3])).T)


def _powers(values: Floats) -> Floats:
    """Return powers 0 to 4 (5, ...) of `values` (...): products are many times faster than powers."""
    square = values * values
    return np.stack([np.ones_like(values), values, square, square * values, square * square])


# Power of the grey level that is proportional to light: light is linear in the slopes, which are known for balls.
#
#     (I / I_0)^power - 1 = (1 - c) ((1 + a p + b q) / sqrt(1 + p^2 + q^2) - 1)
#
# holds for a matt surface under far lamps with a share c of stray light, with a and b polynomials of second order
# in place. As c and the power have similar effects, c is limited to STRAY_PARTS. Most cameras store about the root
# of light: power 1 is chosen only if its misfit is clearly less. On simulated lights the ratio of misfits is .19
# to .36 for cameras that store light, and .84 to 4.8 for those that store its 1.8th root.

STRAY_PARTS = (0.0, 0.1, 0.2)  # shares c of stray light
MAX_RATIO = 2 / 3  # of the misfits of power 1 and 2
DARK_GREY = 30  # below, stray light and the black level dominate
SHADOW = 0.1  # least I / I_0
GAMMA_TERMS = terms_of({**PLACE_ORDER, 1: 2})  # over the picture, as LINEAR_TERMS


def response_of(contact: Samples, level: Floats) -> Response:
    """Return the camera's response by samples of balls; `level` (N, 3) is the untouched picture at them."""
    ratio = np.maximum(1.0 + contact.change * (level + SOFTENING_GREY) / np.maximum(level, 1.0), SHADOW)
    straight, root = (_nonlinearity(power, ratio, contact, level > DARK_GREY) for power in (1, 2))
    return Response(
        1 if straight < MAX_RATIO * root else 2, fit_light(contact, terms=GAMMA_TERMS)[: len(LINEAR_TERMS)]
    )


def _nonlinearity(power: int, ratio: Floats, contact: Samples, bright: Bools) -> float:
    """Return the sum of squared residuals, relative to I_0, of I^`power` linear in slope."""
    p, q = contact.slopes.T
    x, y = contact.place.T
    square, total = p * p + q * q, np.zeros(len(STRAY_PARTS))
    upright = 1.0 / np.sqrt(1.0 + square)
    design = np.stack([upright * p**a * q**b * x**i * y**j for a, b, i, j in LINEAR_TERMS], axis=1)
    for channel, lit in zip(ratio.T, bright.T, strict=True):
        weight = (channel ** (1 - power) / (power * np.sqrt(square + TYPICAL**2)))[lit]
        light = [weight * (channel**power - 1.0 - (1.0 - stray) * (upright - 1.0))[lit] for stray in STRAY_PARTS]
        straight, wanted = design[lit] * weight[:, None], np.stack(light, axis=1)
        residual = wanted - straight @ np.linalg.lstsq(straight, wanted, rcond=None)[0]
        total += np.sum(residual**2, axis=0)
    return float(total.min())
