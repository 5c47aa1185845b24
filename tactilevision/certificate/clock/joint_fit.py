"""The joint fit behind the clocks: the depth that the camera reads as one function of the force, at an offset.

    w(t) = o + g [G(Q) + s min(Q/Qc, 1)]      Q = P(t + tau) - b1 e - b2 e² + sum_k M_k m_k(t + tau)

o and g are a press' zero and gain; G(0) = 0 is a polynomial that presses of one punch share; s is the shift of
the height map's zero plane once there is a contact; e is the force beyond that at the bevel's touch, of which
the bevel carries a part; m_k is the force past a fading memory of T_k seconds, which a relaxing gel feels.
Gains, shifts and parts are held near 1 and 0 by what such figures can be. Forces are over the largest, depths
in mm, times in s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactilevision.records import Bools, Floats
from tactilevision.records.contact_thresholds import CONTACT

POWERS = 4  # terms of the depth's polynomial in the force; benchmarks.certificate
GAIN_STD = 0.1  # of 1, one sigma of a press' gain; benchmarks.certificate
SHIFT_STD = 0.01  # of the largest depth, one sigma of the zero plane's shift at contact; benchmarks.certificate
BEVEL_STD = 0.3  # of the force beyond the contact event, one sigma of the bevel's part; benchmarks.certificate
MEMORY_STD = 0.5  # of the force, one sigma of each memory: gels that relax by a half; benchmarks.certificate
_JOLT = 12.0  # times the median rate: releases are several times faster than loading; benchmarks.certificate
_JOLT_S = 0.1  # s about a jolt in which frames do not count; tests.certificate.test_clock_alignment
Ints = npt.NDArray[np.int_]


@dataclass(frozen=True, slots=True, eq=False)
class ClockProblem:
    """All frames in one row: `press` and `kind` number them; `touch` (N,) is the force at their press' touch, inf
    where it has none; `series` (1 + memories, T) the normal force and its memories at `force_time_s` (T,).
    """

    time_s: Floats
    depth_mm: Floats
    press: Ints
    kind: Ints
    touch: Floats
    force_time_s: Floats
    series: Floats

    @property
    def presses(self) -> int:
        return int(self.press.max()) + 1

    @property
    def kinds(self) -> int:
        return int(self.kind.max()) + 1

    def blocks(self) -> tuple[slice, ...]:
        """Places of the offset, shapes, zeros, gains, shift, bevel's parts and memories among the parameters."""
        sizes = (1, self.kinds * POWERS, self.presses, self.presses, 1, 2, len(self.series) - 1)
        return tuple(slice(int(a), int(b)) for a, b in pairwise(np.cumsum((0, *sizes))))

    def prior(self, start_s: float) -> tuple[Floats, Floats]:
        """Start (K,), and the std (K,) that is known beforehand of each parameter, inf where nothing is."""
        offset, shapes, _, gains, shift, parts, memories = self.blocks()
        start, std = np.zeros(memories.stop), np.full(memories.stop, np.inf)
        start[offset], start[gains] = start_s, 1.0
        start[shapes] = np.tile(np.r_[float(np.ptp(self.depth_mm)), np.zeros(POWERS - 1)], self.kinds)
        std[gains], std[shift] = GAIN_STD, SHIFT_STD * float(np.ptp(self.depth_mm))
        std[parts], std[memories] = BEVEL_STD, MEMORY_STD
        return start, std

    def model(self, parameters: Floats) -> Floats:
        """Depth (N,)."""
        offset, shapes, zeros, gains, shift, parts, memories = (parameters[block] for block in self.blocks())
        now = np.array([np.interp(self.time_s + offset[0], self.force_time_s, row) for row in self.series])
        beyond = np.where(np.isfinite(self.touch), np.maximum(now[0] - self.touch, 0), 0.0)
        force = now[0] - parts[0] * beyond - parts[1] * beyond**2 + memories @ now[1:]
        powers = force[:, None] ** np.arange(1, POWERS + 1)
        curve = (powers * shapes.reshape(-1, POWERS)[self.kind]).sum(axis=1)
        contact = shift[0] * np.clip(force / CONTACT.reading_share, 0, 1)
        value = zeros[self.press] + gains[self.press] * (curve + contact)
        return np.asarray(value, dtype=np.float64)

    def steady(self, offset_s: float) -> Bools:
        """Frames (N,) about which the force changes as in a press: a jolt would pin the clocks to itself."""
        from scipy.ndimage import maximum_filter1d

        interval = float(np.median(np.diff(self.force_time_s)))
        rate = np.abs(np.gradient(self.series[0], interval))
        fastest = maximum_filter1d(rate, 2 * max(round(_JOLT_S / interval), 1) + 1)
        here = np.interp(self.time_s + offset_s, self.force_time_s, fastest)
        loaded = np.interp(self.time_s + offset_s, self.force_time_s, self.series[0]) > CONTACT.reading_share
        median_rate = float(np.median(here[loaded])) if loaded.any() else np.inf
        return np.asarray(here <= _JOLT * median_rate)

    def jacobian(self, parameters: Floats, value: Floats) -> Floats:
        """Derivatives (N, parameters) by differences; the offset's over a few force readings, past their noise."""
        columns = []
        for k in range(parameters.size):
            step = 0.02 if k == 0 else 1e-5
            moved = parameters.copy()
            moved[k] += step
            ahead = self.model(moved)
            moved[k] -= 2 * step
            columns.append((ahead - self.model(moved)) / (2 * step) if k == 0 else (ahead - value) / step)
        return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class ClockFit:
    """Offset and its std; `misfit` (presses,) is twice the negative logarithm of the likelihood of each press'
    frames, for comparing models.
    """

    offset_s: float
    std_s: float
    misfit: Floats


def fit_clock(problem: ClockProblem, start_s: float) -> ClockFit:
    """Gauss-Newton; presses and frames that do not fit count less."""
    parameters, std = problem.prior(start_s)
    centre = parameters.copy()
    noise, weights = 0.1 * float(np.ptp(problem.depth_mm)), np.ones(problem.time_s.size)
    for turn in range(15):
        value = problem.model(parameters)
        residual = problem.depth_mm - value
        if turn > 2:
            weights, noise = _weights(problem, residual)
            weights = weights * problem.steady(float(parameters[0]))
        jacobian = problem.jacobian(parameters, value)
        held = (noise / std) ** 2
        normal = (jacobian * weights[:, None]).T @ jacobian + np.diag(held + 1e-12)
        right = (jacobian * weights[:, None]).T @ residual + held * (centre - parameters)
        step = np.linalg.lstsq(normal, right, rcond=None)[0]
        step[0] = float(np.clip(step[0], -0.05, 0.05))
        parameters = parameters + step
        if turn > 5 and abs(step[0]) < 1e-5:
            break
    residual = problem.depth_mm - problem.model(parameters)
    inverse = np.linalg.pinv(normal)
    # frames of one press err together: the presses' own pulls on the offset tell what that is worth
    scores = jacobian * (weights * residual)[:, None]
    pulls = np.array([scores[problem.press == k].sum(axis=0) for k in range(problem.presses)]) @ inverse[0]
    variance = max(float(inverse[0, 0]) * noise**2, float((pulls**2).sum()))
    by_frame = 9 * np.log1p((residual / (3 * noise)) ** 2) + 2 * np.log(noise)
    misfit = np.bincount(problem.press, weights=by_frame, minlength=problem.presses).astype(np.float64)
    return ClockFit(float(parameters[0]), float(np.sqrt(max(variance, 0.0))), misfit)


def _weights(problem: ClockProblem, residual: Floats) -> tuple[Floats, float]:
    """Weights of the frames, and the noise of a frame in a press that fits."""
    by_press = np.array([np.sqrt(np.mean(residual[problem.press == k] ** 2)) for k in range(problem.presses)])
    noise = max(float(np.median(by_press)), 1e-6)
    spread = np.maximum(by_press, noise)[problem.press]
    outlying = np.abs(residual) / (2.5 * spread)
    return (noise / spread) ** 2 / np.maximum(outlying, 1.0), noise


def memory(time_s: Floats, force: Floats, *, fade_s: float) -> Floats:
    """Integral (T,) of exp(-(t - s)/T) dP(s) at evenly spaced times (T,) s, in the unit of `force` (T,)."""
    from scipy.signal import lfilter

    keep = float(np.exp(-np.median(np.diff(time_s)) / fade_s))
    return np.asarray(lfilter([1.0, -1.0], [1.0, -keep], force - force[0]), dtype=np.float64)


def number_of(names: Sequence[float], counts: Sequence[int]) -> Ints:
    """Numbers (N,) of the names in order, each repeated for its frames."""
    order = sorted(set(names))
    return np.repeat([order.index(name) for name in names], counts)
