"""How far the F/T sensor's clock is ahead of the camera's, from what both saw: depth and force of the presses.

At the right offset tau the depth that the camera reads is one function of the force, in all presses of a punch:

    w(t) = o + g G(P(t + tau)) + sum_k M_k m_k(t + tau)      G(0) = 0, a polynomial shared by the presses

with a zero o and a gain g near 1 for each press. m_k is the force past a fading memory of T_k seconds: a gel
that relaxes lags behind its force, which must not be taken for a late clock; the memories come in only where
they are needed (by the information criterion of Schwarz). A wrong tau opens a gap between the zero of the
free gel and the ramp, and between loading and unloading. Frames beyond the bevel's touch are left out, since
the bevel adds force. Times in s. F/T clock minus camera clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactilevision.records import Estimate, Floats, ForceSeries

Ints = npt.NDArray[np.int_]

_MEMORIES_S = (0.3, 3.0)
_POWERS = (2, 3, 4, 5)
_GAIN_STD = 0.1
_NEAR_S, _STEP_S = 2.0, 0.01
_WIDE = 20000  # offsets tried at most where the clocks have different origins
_AROUND_S = 0.6
_CLEAR = 0.75  # of the deepest: below it the bevel has hardly touched, where that is not known yet


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Depths (N,) of one press at times (N,) on the camera's clock; `touch_s` when the bevel touches, if known.

    `kind` names presses that share G: those of one punch radius.
    """

    time_s: Floats
    depth_mm: Floats
    kind: float = 0.0
    touch_mm: float = float("nan")

    def clear(self) -> Seen:
        """The frames without the bevel's force."""
        limit = self.touch_mm if np.isfinite(self.touch_mm) else _CLEAR * float(np.nanmax(self.depth_mm))
        keep = np.isfinite(self.depth_mm) & (self.depth_mm <= limit)
        return Seen(self.time_s[keep], self.depth_mm[keep], self.kind, self.touch_mm)


def coarse_offset(presses: Sequence[Seen], forces: ForceSeries) -> tuple[float, float]:
    """Offset at which depth and normal force correlate best, to about a frame, and that correlation.

    Looks within two seconds first, then over all offsets at which the forces cover the frames.
    """
    time = np.concatenate([seen.time_s for seen in presses])
    depth = np.concatenate([seen.depth_mm for seen in presses])
    good = np.isfinite(depth)
    time, depth = time[good], depth[good]
    smooth = _smooth(forces)
    near = np.arange(-_NEAR_S, _NEAR_S + 1e-9, _STEP_S)
    best, score = _best_correlation(near, time, depth, forces.time_s, smooth)
    if score > 0.9 and abs(best) < 0.95 * _NEAR_S:
        return best, score
    first, last = forces.time_s[0] - time.max(), forces.time_s[-1] - time.min()
    step = max(2 * _STEP_S, (last - first) / _WIDE)
    thin = slice(None, None, max(1, time.size // 400))
    wide, _ = _best_correlation(np.arange(first, last, step), time[thin], depth[thin], forces.time_s, smooth)
    around = wide + np.arange(-3 * step, 3 * step + 1e-9, _STEP_S)
    found, sure = _best_correlation(around, time, depth, forces.time_s, smooth)
    return (found, sure) if sure > score else (best, score)


def _best_correlation(offsets: Floats, time: Floats, depth: Floats, force_time: Floats,
                      force: Floats) -> tuple[float, float]:  # fmt: skip
    depth = depth - depth.mean()
    best, top = float(offsets[0]), -np.inf
    for offset in offsets:
        moved = time + offset
        seen = (moved >= force_time[0]) & (moved <= force_time[-1])
        if seen.mean() < 0.7:
            continue
        there = np.interp(moved, force_time, force)
        there = there - there.mean()
        size = float(np.sqrt((there**2).sum() * (depth**2).sum()))
        score = float((there * depth).sum()) / size if size > 0 else -1.0
        if score > top:
            best, top = float(offset), score
    return best, top


def near_offset(presses: Sequence[Seen], forces: ForceSeries, *, start_s: float) -> float:
    """A better start: the offset at which each press' depth is best a parabola of the force, to some 10 ms."""
    grid = start_s + np.arange(-_AROUND_S, _AROUND_S + 1e-9, _STEP_S)
    force, total = _smooth(forces), np.zeros(grid.size)
    for seen in presses:
        clear = seen.clear()
        if clear.time_s.size < 6 or np.ptp(clear.depth_mm) <= 0:
            continue
        moved = np.interp(clear.time_s[None, :] + grid[:, None], forces.time_s, force)
        basis = np.stack([np.ones_like(moved), moved, moved**2], axis=-1)
        normal = basis.transpose(0, 2, 1) @ basis + 1e-9 * np.eye(3)
        right = basis.transpose(0, 2, 1) @ clear.depth_mm
        fitted = (np.linalg.solve(normal, right[..., None])[..., 0] * right).sum(axis=1)
        square = np.maximum((clear.depth_mm**2).sum() - fitted, 0)
        total += clear.time_s.size * np.log(square / clear.time_s.size + 1e-8)
    return float(grid[int(total.argmin())])


def estimate_offset(presses: Sequence[Seen], forces: ForceSeries, *, start_s: float) -> Estimate:
    """Offset near `start_s` with its standard deviation."""
    clear = [seen.clear() for seen in presses]
    clear = [seen for seen in clear if seen.time_s.size >= 4 and np.ptp(seen.depth_mm) > 0]
    if sum(seen.time_s.size for seen in clear) < 12:
        return Estimate(None, None, None, "s", why="too few frames show the ramps of the presses")
    plain = [_solve(_Problem.build(clear, forces, powers=powers), start_s) for powers in _POWERS]
    best = min(plain, key=lambda solution: solution.criterion)
    powers = _POWERS[plain.index(best)]
    fading = _solve(_Problem.build(clear, forces, powers=powers, memories=_MEMORIES_S), best.offset_s)
    best = min(best, fading, key=lambda solution: solution.criterion)
    std = max(best.std_s, 1e-4)
    return Estimate(best.offset_s, std, (best.offset_s - 1.96 * std, best.offset_s + 1.96 * std), "s")


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    offset_s: float
    std_s: float
    criterion: float


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """All frames in one row: depth, time, number of their press and kind; force series with its memories."""

    time_s: Floats
    depth_mm: Floats
    press: Ints
    kind: Ints
    force_time_s: Floats
    force: Floats  # (1 + memories, T), the first the normal force over its largest
    gains: int
    kinds: int
    powers: int

    @classmethod
    def build(
        cls, presses: Sequence[Seen], forces: ForceSeries, *, powers: int, memories: Sequence[float] = ()
    ) -> _Problem:
        normal = _smooth(forces)
        normal = (normal - np.median(normal)) / max(float(np.ptp(normal)), 1e-9)
        names = sorted({seen.kind for seen in presses})
        series = [normal, *(_memory(forces.time_s, normal, fade) for fade in memories)]
        return cls(
            time_s=np.concatenate([seen.time_s for seen in presses]),
            depth_mm=np.concatenate([seen.depth_mm for seen in presses]),
            press=np.repeat(np.arange(len(presses)), [seen.time_s.size for seen in presses]),
            kind=np.repeat([names.index(seen.kind) for seen in presses], [seen.time_s.size for seen in
            presses]), force_time_s=forces.time_s, force=np.array(series), gains=len(presses),
            kinds=len(names), powers=powers,
        )  # fmt: skip

    def at(self, offset_s: float) -> Floats:
        """Force and memories (1 + memories, N) at the frames."""
        return np.array([np.interp(self.time_s + offset_s, self.force_time_s, row) for row in self.force])

    def model(self, parameters: Floats) -> tuple[Floats, Floats]:
        """Depth (N,) and its derivatives (N, parameters): offset, G by kind, zeros, gains, memories."""
        offset, shape, zero, gain, fading = self.split(parameters)
        now, step = self.at(offset), 2e-3
        change = (self.at(offset + step) - self.at(offset - step)) / (2 * step)
        powers = now[0][:, None] ** np.arange(1, self.powers + 1)
        slopes = np.arange(1, self.powers + 1) * now[0][:, None] ** np.arange(self.powers)
        curve = (powers * shape[self.kind]).sum(axis=1)
        rate = gain[self.press] * (slopes * shape[self.kind]).sum(axis=1) * change[0] + fading @ change[1:]
        by_kind = (self.kind[:, None] == np.arange(self.kinds))[..., None] * powers[:, None, :]
        by_press = (self.press[:, None] == np.arange(self.gains)).astype(np.float64)
        jacobian = np.hstack([
            rate[:, None], (gain[self.press][:, None, None] * by_kind).reshape(rate.size, -1),
            by_press, by_press * curve[:, None], now[1:].T,
        ])  # fmt: skip
        return zero[self.press] + gain[self.press] * curve + fading @ now[1:], jacobian

    def split(self, parameters: Floats) -> tuple[float, Floats, Floats, Floats, Floats]:
        ends = np.cumsum([1, self.kinds * self.powers, self.gains, self.gains])
        first, shape, zero, gain, fading = np.split(parameters, ends)
        return float(first[0]), shape.reshape(self.kinds, self.powers), zero, gain, fading


def _solve(problem: _Problem, start_s: float) -> _Solution:
    """Gauss-Newton with the gains held near 1; presses and frames that do not fit count less."""
    count = 1 + problem.kinds * problem.powers + 2 * problem.gains + len(problem.force) - 1
    parameters = np.zeros(count)
    parameters[0] = start_s
    before = 1 + problem.kinds * problem.powers + problem.gains
    gains = slice(before, before + problem.gains)
    parameters[gains] = 1.0
    prior = np.zeros(count)
    noise, weights = 0.1 * float(np.ptp(problem.depth_mm)), np.ones(problem.time_s.size)
    normal = np.eye(count)
    for turn in range(25):
        value, jacobian = problem.model(parameters)
        residual = problem.depth_mm - value
        if turn > 3:
            weights, noise = _weights(problem, residual)
        prior[gains] = (noise / _GAIN_STD) ** 2
        normal = (jacobian * weights[:, None]).T @ jacobian + np.diag(prior + 1e-9 * noise**2)
        right = (jacobian * weights[:, None]).T @ residual + prior * (1.0 - parameters) * (prior > 0)
        step = np.linalg.lstsq(normal, right, rcond=None)[0]
        step[0] = float(np.clip(step[0], -0.05, 0.05))
        parameters = parameters + step
        if turn > 6 and abs(step[0]) < 1e-6:
            break
    inverse = np.linalg.pinv(normal)
    value, jacobian = problem.model(parameters)
    scores = jacobian * (weights * (problem.depth_mm - value))[:, None]
    moved = np.array([scores[problem.press == k].sum(axis=0) for k in range(problem.gains)]) @ inverse[0]
    # frames of one press err together: the presses' own pulls on the offset tell what that is worth
    variance = max(
        float(inverse[0, 0]) * noise**2, float((moved**2).sum()) * problem.gains / (problem.gains - 0.99)
    )
    freedom = float(weights.sum())
    criterion = freedom * 2 * np.log(noise) + count * np.log(max(freedom, 2.0))
    return _Solution(float(parameters[0]), float(np.sqrt(max(variance, 0.0))), criterion)


def _weights(problem: _Problem, residual: Floats) -> tuple[Floats, float]:
    """Weights of the frames, and the noise of a frame in a press that fits."""
    by_press = np.array([np.sqrt(np.mean(residual[problem.press == k] ** 2)) for k in range(problem.gains)])
    noise = max(float(np.median(by_press)), 1e-6)
    spread = np.maximum(by_press, noise)[problem.press]
    outlying = np.abs(residual) / (2.5 * spread)
    return (noise / spread) ** 2 / np.maximum(outlying, 1.0), noise


def _memory(time: Floats, force: Floats, fade_s: float) -> Floats:
    """Integral of exp(-(t - s)/T) dP(s) at evenly spaced times."""
    from scipy.signal import lfilter

    keep = float(np.exp(-np.median(np.diff(time)) / fade_s))
    return np.asarray(lfilter([1.0, -1.0], [1.0, -keep], force - force[0]), dtype=np.float64)


def _smooth(forces: ForceSeries) -> Floats:
    """Normal force, mean of five readings where they come fast enough for that not to round the ramps."""
    force = forces.force_N[:, 2]
    rate = (force.size - 1) / max(float(np.ptp(forces.time_s)), 1e-9)
    if rate < 100 or force.size < 5:
        return force
    padded = np.pad(force, 2, mode="edge")
    return np.asarray(np.convolve(padded, np.full(5, 0.2), mode="valid"))
