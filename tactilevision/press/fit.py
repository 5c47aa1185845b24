"""Fit the forward model to a recording: one robust least-squares objective, one covariance.

    sum over measurements of rho((y - model)/std) + sum over unknowns of ((x - prior)/prior std)^2

rho is Huber's function. Each press has unknowns of its own, which are eliminated from the normal equations (Schur
complement); they are solved by Levenberg and Marquardt's method. The noise of a stream in a press is that of its
residuals; the scatter of gains, touches and dents between presses follows by expectation and maximisation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter1d

from tactilevision.press.model import STREAMS, Own, PressModel, Whole
from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.records.measured import Bools, Floats
from tactilevision.robust import MAD_TO_STD

OWN = len(Own)
HUBER = 2.5  # stds beyond which a measurement counts less
JOLT = 12.0  # times the median rate of the force: releases, several times faster than loading, move a clock
JOLT_S = 0.1  # s about a jolt that are excluded
SCATTER = {Own.GAIN: (5e-4, 0.05), Own.TOUCH: (1e-4, 0.03), Own.DENT: (0.03, 0.15)}  # least and most
STEP = 1e-3  # step of a derivative, of the prior std of an unknown
MAX_STD = 0.1  # of an unknown with a weak prior, for that step
OFFSET_STEP_S = 0.01  # s: step of the derivative by the offset, a few force readings
MAX_OFFSET_STEP_S = 0.05  # s: limit on one step of the fit


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Mean and std of the shared unknowns (S,) and of each press's (presses, OWN); inf: none."""

    shared: Floats
    shared_std: Floats
    own: Floats
    own_std: Floats


@dataclass(frozen=True, eq=False)
class ModelFit:
    """The unknowns, and the normal equations at the solution: `reduced` (S, S) of the shared ones, by press
    `inverse` (OWN, OWN) and `coupling` (OWN, S); `std` of each measurement, `pulls` (presses, S).
    """

    model: PressModel
    shared: Floats
    own: Floats
    prior: Prior
    std: Floats
    reduced: Floats
    inverse: Floats
    coupling: Floats
    pulls: Floats

    @cached_property
    def covariance(self) -> Floats:
        """Covariance (S, S) of the shared unknowns."""
        scale = 1 / np.sqrt(np.maximum(np.diag(self.reduced), np.finfo(float).tiny))
        outer = np.outer(scale, scale)
        return np.asarray(np.linalg.pinv(self.reduced * outer, rcond=1e-13) * outer)

    @cached_property
    def offset_std_s(self) -> float:
        """Std of the clocks' offset: errors within one press are correlated, so the presses' pulls count, too."""
        pulls = self.pulls @ self.covariance[Whole.OFFSET]
        freedom = max(len(pulls) - 1, 1) / max(len(pulls), 1)
        return float(np.sqrt(max(self.covariance[Whole.OFFSET, Whole.OFFSET], float(pulls @ pulls) / freedom)))

    def spread(self, shared_slope: Floats, own_slope: Floats, k: int) -> tuple[float, Floats]:
        """Return the own std of a function of press k, and its slope (S,) by the shared unknowns."""
        slope = shared_slope - own_slope @ self.inverse[k] @ self.coupling[k]
        return float(np.sqrt(own_slope @ self.inverse[k] @ own_slope)), np.asarray(slope)


def fit_model(
    model: PressModel, shared: Floats, own: Floats, prior: Prior, *, rounds: int, frozen: bool = False
) -> ModelFit:
    """Return the fit from a start, shared unknowns (S,) and presses' (K, OWN) in units of N, mm, s.

    With `frozen` shared unknowns only those of the presses are fitted.
    """
    damping, normal = 1e-3, None
    for turn in range(rounds):
        good = model.usable(shared, own) & steady(model, shared)
        residual = _residual(model, shared, own, good)
        std = _noise(model, residual, good)
        weights = np.where(good, std**-2.0 / np.maximum(np.abs(residual) / std / HUBER, 1.0), 0.0)
        if normal is not None and turn > 1:
            prior = _scatter(model, own, prior, np.asarray(np.linalg.inv(normal.press), np.float64))
        for _ in range(4):
            before = _objective(residual, weights, shared, own, prior)
            normal = _normal(model, shared, own, prior, residual, weights)
            while True:
                shared_step, own_step = normal.step(damping, frozen)
                new = shared + shared_step, own + own_step
                trial = _residual(model, *new, good)
                after = _objective(trial, weights, *new, prior)
                if after <= before * (1 + 1e-9) or damping > 1e6:
                    break
                damping *= 10
            damping = max(damping / 10, 1e-8)
            shared, own, residual = *new, trial
            if before - after < 1e-4 * (1 + 1e-3 * before):
                break
    normal = _normal(model, shared, own, prior, residual, weights)
    inverse = np.asarray(np.linalg.inv(normal.press), np.float64)
    reduced = normal.shared - np.einsum("kpi,kpq,kqj->ij", normal.coupling, inverse, normal.coupling)
    pulls = normal.pulls - np.einsum("kpi,kpq,kq->ki", normal.coupling, inverse, normal.press_right)
    return ModelFit(model, shared, own, prior, std, reduced, inverse, normal.coupling, pulls)


@dataclass(frozen=True, slots=True, eq=False)
class _Normal:
    """Normal equations: shared (S, S), presses (K, OWN, OWN), coupling (K, OWN, S), right-hand sides, pulls."""

    shared: Floats
    shared_right: Floats
    press: Floats
    press_right: Floats
    coupling: Floats
    pulls: Floats

    def step(self, damping: float, frozen: bool) -> tuple[Floats, Floats]:
        """Return the damped steps of the shared unknowns and of the presses'."""
        diagonal = np.arange(OWN)
        press = self.press.copy()
        press[:, diagonal, diagonal] *= 1 + damping
        inverse = np.linalg.inv(press)
        if frozen:
            return np.zeros(len(self.shared)), np.einsum("kpq,kq->kp", inverse, self.press_right)
        whole = self.shared + damping * np.diag(np.diag(self.shared))
        reduced = whole - np.einsum("kpi,kpq,kqj->ij", self.coupling, inverse, self.coupling)
        right = self.shared_right - np.einsum("kpi,kpq,kq->i", self.coupling, inverse, self.press_right)
        scale = 1 / np.sqrt(np.maximum(np.diag(reduced), np.finfo(float).tiny))
        step = scale * np.linalg.lstsq(reduced * np.outer(scale, scale), right * scale, rcond=1e-12)[0]
        step[Whole.OFFSET] = np.clip(step[Whole.OFFSET], -MAX_OFFSET_STEP_S, MAX_OFFSET_STEP_S)
        return step, np.einsum("kpq,kq->kp", inverse, self.press_right - self.coupling @ step)


def _normal(
    model: PressModel,
    shared: Floats,
    own: Floats,
    prior: Prior,
    residual: Floats,
    weights: Floats,
) -> _Normal:
    """Return the normal equations, by central differences: one unknown of all presses at a time."""

    def slope(k: int, size: float, of_press: bool) -> Floats:
        ends = []
        for sign in (1, -1):
            moved, mine = shared.copy(), own.copy()
            if of_press:
                mine[:, k] += sign * size
            else:
                moved[k] += sign * size
            ends.append(model.predict(moved, mine))
        return np.asarray((ends[0] - ends[1]) / (2 * size))

    sizes = STEP * np.minimum(prior.shared_std, MAX_STD)
    sizes[Whole.OFFSET] = OFFSET_STEP_S
    own_sizes = STEP * np.minimum(prior.own_std.max(axis=0), MAX_STD)
    by_shared = np.stack([slope(k, float(size), False) for k, size in enumerate(sizes)], axis=1)
    by_own = np.stack([slope(k, float(size), True) for k, size in enumerate(own_sizes)], axis=1)
    press, _ = model.rows
    held, held_own = prior.shared_std**-2.0, prior.own_std**-2.0
    weighted = by_shared * weights[:, None]
    count = len(model.presses)
    blocks, coupling = np.empty((count, OWN, OWN)), np.empty((count, OWN, shared.size))
    right, pulls = np.empty((count, OWN)), np.empty((count, shared.size))
    for k in range(count):
        here = press == k
        mine = by_own[here] * weights[here, None]
        blocks[k] = mine.T @ by_own[here] + np.diag(held_own[k] + 1e-12)
        coupling[k] = mine.T @ by_shared[here]
        right[k] = mine.T @ residual[here]
        pulls[k] = weighted[here].T @ residual[here]
    right -= np.where(held_own > 0, held_own * (own - prior.own), 0.0)
    whole_right = pulls.sum(axis=0) - np.where(held > 0, held * (shared - prior.shared), 0.0)
    whole = weighted.T @ by_shared + np.diag(held + 1e-12)
    return _Normal(whole, whole_right, blocks, right, coupling, pulls)


def _residual(model: PressModel, shared: Floats, own: Floats, good: Bools) -> Floats:
    return np.where(good, model.measured - model.predict(shared, own), 0.0)


def _objective(residual: Floats, weights: Floats, shared: Floats, own: Floats, prior: Prior) -> float:
    off = (shared - prior.shared) / prior.shared_std
    own_off = (own - prior.own) / prior.own_std
    return float(weights @ residual**2 + off @ off + (own_off**2).sum())


def steady(model: PressModel, shared: Floats) -> Bools:
    """Return the rows (N,) without frames within JOLT_S s of a jolt of the force, which would bias the offset."""
    interval = float(np.median(np.diff(model.force_time_s)))
    rate = np.abs(np.gradient(model.force_N, interval))
    fastest = maximum_filter1d(rate, 2 * max(round(JOLT_S / interval), 1) + 1)
    time = np.concatenate([one.track.time_s for one in model.presses]) + shared[Whole.OFFSET]
    here = np.interp(time, model.force_time_s, fastest)
    loaded = np.interp(time, model.force_time_s, model.force_N) > CONTACT.reading_share * model.top_N
    usual = float(np.median(here[loaded])) if loaded.any() else np.inf
    rows = np.ones(model.measured.size, dtype=bool)
    rows[: here.size] = here <= JOLT * usual
    return rows


def _noise(model: PressModel, residual: Floats, good: Bools) -> Floats:
    """Return the std of each measurement, by stream; a press worse than the best quarter counts less."""
    press, stream = model.rows
    std = np.ones(residual.size)
    count = len(model.presses)
    for which in range(STREAMS - 1):
        own = np.full(count, np.nan)
        for k in range(count):
            here = residual[(press == k) & (stream == which) & good]
            if here.size > 5:
                size = np.abs(here)
                own[k] = np.minimum(np.sqrt(np.mean(size**2)), 3 * MAD_TO_STD * np.median(size))
        usual = max(float(np.nanquantile(own, 0.25)), 1e-6) if np.isfinite(own).any() else 1.0
        worse = np.fmax(np.nan_to_num(own, nan=usual), usual)
        std[stream == which] = (worse**2 / usual)[press[stream == which]]
    ramp = np.concatenate([one.ramp_std_N for one in model.presses])
    rows = np.flatnonzero(stream == STREAMS - 1)
    for k in range(count):
        here = press[rows] == k
        if here.any():
            used = good[rows[here]]
            misfit = np.sqrt(np.mean((residual[rows[here]] / ramp[here])[used] ** 2)) if used.any() else 1.0
            std[rows[here]] = ramp[here] * max(float(misfit), 1.0)
    return std


def _scatter(model: PressModel, own: Floats, prior: Prior, inverse: Floats) -> Prior:
    """Return the prior with the scatter of gains, touches and dents that the presses show."""
    std = prior.own_std.copy()
    bevel = np.array([np.isfinite(one.nominal_mm) for one in model.presses])
    for unknown, (least, most) in SCATTER.items():
        known = np.ones_like(bevel) if unknown == Own.GAIN else bevel
        if np.count_nonzero(known) < 3:
            continue
        square = (own[known, unknown] - prior.own[known, unknown]) ** 2 + inverse[known, unknown, unknown]
        usual = float(np.mean(np.minimum(square, 9 * np.median(square))))
        std[:, unknown] = np.clip(np.sqrt(usual), least, most)
    return replace(prior, own_std=std)
