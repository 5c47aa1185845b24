"""Align the clocks of camera and F/T sensor by depth and force of the presses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.records.measured import Bools, Estimate, Floats, ForceSeries

# The joint fit behind the clocks: the depth that the camera reads as one function of the force, at an offset.
#
#     w(t) = o + g [G(Q) + s min(Q/Qc, 1)]      Q = P(t + tau) - b1 e - b2 e² + sum_k M_k m_k(t + tau)
#
# o and g are a press' zero and gain; G(0) = 0 is a polynomial that presses of one punch share; s is the shift of
# the height map's zero plane once there is a contact; e is the force beyond that at the bevel's touch, of which
# the bevel carries a part; m_k is the force past a fading memory of T_k seconds, which a relaxing gel feels.
# Gains, shifts and parts are held near 1 and 0 by what such figures can be. Forces are over the largest, depths
# in mm, times in s.

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
        """Return the start (K,), and the prior std (K,) of each parameter, inf where there is none."""
        offset, shapes, _, gains, shift, parts, memories = self.blocks()
        start, std = np.zeros(memories.stop), np.full(memories.stop, np.inf)
        start[offset], start[gains] = start_s, 1.0
        start[shapes] = np.tile(np.r_[float(np.ptp(self.depth_mm)), np.zeros(POWERS - 1)], self.kinds)
        std[gains], std[shift] = GAIN_STD, SHIFT_STD * float(np.ptp(self.depth_mm))
        std[parts], std[memories] = BEVEL_STD, MEMORY_STD
        return start, std

    def model(self, parameters: Floats) -> Floats:
        """Return the depth (N,)."""
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
        """Return frames (N,) with force changes usual in a press: a jolt would bias the offset."""
        from scipy.ndimage import maximum_filter1d

        interval = float(np.median(np.diff(self.force_time_s)))
        rate = np.abs(np.gradient(self.series[0], interval))
        fastest = maximum_filter1d(rate, 2 * max(round(_JOLT_S / interval), 1) + 1)
        here = np.interp(self.time_s + offset_s, self.force_time_s, fastest)
        loaded = np.interp(self.time_s + offset_s, self.force_time_s, self.series[0]) > CONTACT.reading_share
        median_rate = float(np.median(here[loaded])) if loaded.any() else np.inf
        return np.asarray(here <= _JOLT * median_rate)

    def jacobian(self, parameters: Floats, value: Floats) -> Floats:
        """Return derivatives (N, parameters) by differences; the offset's over a few force readings."""
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
    """Fit by Gauss-Newton; presses and frames that do not fit have less weight."""
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
    # errors within one press are correlated: the presses' own offsets give the std
    scores = jacobian * (weights * residual)[:, None]
    pulls = np.array([scores[problem.press == k].sum(axis=0) for k in range(problem.presses)]) @ inverse[0]
    variance = max(float(inverse[0, 0]) * noise**2, float((pulls**2).sum()))
    by_frame = 9 * np.log1p((residual / (3 * noise)) ** 2) + 2 * np.log(noise)
    misfit = np.bincount(problem.press, weights=by_frame, minlength=problem.presses).astype(np.float64)
    return ClockFit(float(parameters[0]), float(np.sqrt(max(variance, 0.0))), misfit)


def _weights(problem: ClockProblem, residual: Floats) -> tuple[Floats, float]:
    """Return the weights of the frames, and the noise of a frame in a press that fits."""
    by_press = np.array([np.sqrt(np.mean(residual[problem.press == k] ** 2)) for k in range(problem.presses)])
    noise = max(float(np.median(by_press)), 1e-6)
    spread = np.maximum(by_press, noise)[problem.press]
    outlying = np.abs(residual) / (2.5 * spread)
    return (noise / spread) ** 2 / np.maximum(outlying, 1.0), noise


def memory(time_s: Floats, force: Floats, *, fade_s: float) -> Floats:
    """Return the integral (T,) of exp(-(t - s)/T) dP(s) at even times (T,) s, in the unit of `force` (T,).

    The recursion y_k = keep y_(k-1) + dP_k as a banded system: scipy.signal takes a second to import.
    """
    from scipy.linalg import solve_banded

    keep = float(np.exp(-np.median(np.diff(time_s)) / fade_s))
    bands = np.stack([np.ones(force.size), np.full(force.size, -keep)])
    return np.asarray(solve_banded((1, 0), bands, np.diff(force, prepend=force[0])), dtype=np.float64)


def number_of(names: Sequence[float], counts: Sequence[int]) -> Ints:
    """Return numbers (N,) of the names in order, each repeated for its frames."""
    order = sorted(set(names))
    return np.repeat([order.index(name) for name in names], counts)


# How far the F/T sensor's clock is ahead of the camera's, from what both saw: depth and force of the presses.
#
# Three steps: correlation finds the offset to a few frames whatever the clocks' origins; parabolas of depth over
# force, press by press, to some 10 ms; the joint fit below to about a millisecond. The offset is determined by
# the corners (first contact, end of the ramp) and the difference between loading and unloading. Times in s.

_MEMORIES_S = (0.2, 1.0, 5.0)  # s, time constants of a relaxing gel that are fitted along; benchmarks.certificate
_NEAR_S = 2.0  # s, offsets searched first: clocks that were set together; benchmarks.certificate
_STEP_S = 0.01  # s, step of the search: finer than a frame's interval; benchmarks.certificate
_MAX_OFFSETS = 20000  # offsets tried at most where the clocks have different origins
_AROUND_S = 0.6  # s about the correlation's offset in which parabolas are fitted; benchmarks.certificate
_MIN_JUMP_S = 0.15  # s, smaller jumps are no jumps of a clock; tests.certificate.test_clock_alignment
_MISFIT_RATIO = 9.0  # of mean squares, which no press of one clock reaches; tests.certificate.test_clock_alignment
_AT_ONCE = 64  # offsets compared in one step: more need more memory
_COVERED = 0.3  # share of the frames that must have force readings; benchmarks.certificate
_SMOOTH_S = 0.045  # s, mean of the force: rounds corners by less than a frame; benchmarks.certificate
_MIN_GAIN = 10.0  # of log likelihood, for a relaxing gel beyond the criterion of Schwarz; benchmarks.certificate
_AGREEMENT_SIGMA = 2.0  # stds of that gain by what presses say of it one by one; benchmarks.certificate
_CONTRADICTION_S = 0.02  # s off what is stated of the clocks, below which nothing is said; test_clock_alignment
_CONTRADICTION_SIGMA = 4.0  # and in stds of the presses' offset; test_clock_alignment
_INWARD = 2.0  # times the depth read out of the gel; of noise the two are alike; test_clock_alignment
_CLEAR = 0.75  # of the deepest: below it the bevel has hardly touched, where that is not known


@dataclass(frozen=True, slots=True, eq=False)
class PressDepths:
    """Depths (N,) of one press at times (N,) on the camera's clock.

    `kind` names presses that share their reading of depth: those of one punch radius. `touch_N` is the normal
    force at the bevel's touch, in the zero of the readings it goes with, inf where there is none, NaN where that
    is not known yet. `stiffness` is how much harder this punch presses than others at one depth, in any unit.
    """

    time_s: Floats
    depth_mm: Floats
    kind: float = 0.0
    touch_N: float = float("nan")
    stiffness: float = 1.0

    @property
    def goes_in(self) -> bool:
        """Return whether the depth is clearly positive into the gel: else noise was taken for a face."""
        return bool(np.nanmax(self.depth_mm) > _INWARD * max(-np.nanmin(self.depth_mm), 0.0))

    def clear(self) -> PressDepths:
        """Return, for an unknown touch, the frames that the bevel hardly affects."""
        keep = np.isfinite(self.depth_mm)
        if np.isnan(self.touch_N) and keep.any():
            keep &= self.depth_mm <= _CLEAR * float(np.nanmax(self.depth_mm))
        return replace(self, time_s=self.time_s[keep], depth_mm=self.depth_mm[keep])


def correlation_offset(presses: Sequence[PressDepths], forces: ForceSeries) -> tuple[float, float]:
    """Return the offset of best correlation of depth times stiffness and normal force, and that correlation.

    Looks within two seconds first, then over all offsets at which the forces cover the frames.
    """
    time = np.concatenate([seen.time_s for seen in presses])
    depth = np.concatenate([seen.stiffness * seen.depth_mm for seen in presses])
    good = np.isfinite(depth)
    time, depth = time[good], depth[good]
    smooth = smooth_force(forces)
    near = np.arange(-_NEAR_S, _NEAR_S + 1e-9, _STEP_S)
    best, score = _best_correlation(near, time, depth, forces.time_s, smooth)
    if score > 0.9 and abs(best) < 0.95 * _NEAR_S:
        return best, score
    first, last = forces.time_s[0] - time.max(), forces.time_s[-1] - time.min()
    step = max(2 * _STEP_S, (last - first) / _MAX_OFFSETS)
    thin = slice(None, None, max(1, time.size // 400))
    wide, _ = _best_correlation(np.arange(first, last, step), time[thin], depth[thin], forces.time_s, smooth)
    around = wide + np.arange(-3 * step, 3 * step + 1e-9, _STEP_S)
    found, sure = _best_correlation(around, time, depth, forces.time_s, smooth)
    return (found, sure) if sure > score else (best, score)


def _best_correlation(
    offsets: Floats, time: Floats, depth: Floats, force_time: Floats, force: Floats
) -> tuple[float, float]:
    best, top, sure = float(offsets[0]), -np.inf, 0.0
    for some in np.array_split(offsets, -(-offsets.size // _AT_ONCE)):
        moved = time + some[:, None]
        seen = (moved >= force_time[0]) & (moved <= force_time[-1])
        count, covered = np.maximum(seen.sum(axis=1, keepdims=True), 1), seen.mean(axis=1)
        there, here = (np.where(seen, part, 0.0) for part in (np.interp(moved, force_time, force), depth))
        there, here = (part - seen * (part.sum(axis=1, keepdims=True) / count) for part in (there, here))
        size = np.sqrt((there**2).sum(axis=1) * (here**2).sum(axis=1))
        score = np.where(size > 0, (there * here).sum(axis=1) / np.where(size > 0, size, 1.0), -1.0)
        rank = np.where(covered < _COVERED, -np.inf, score * np.sqrt(covered))
        k = int(rank.argmax())
        if rank[k] > top:  # the better covered of two that fit alike
            best, top, sure = float(some[k]), float(rank[k]), float(score[k])
    return best, sure


def parabola_offset(presses: Sequence[PressDepths], forces: ForceSeries, *, start_s: float) -> float:
    """Return the offset at which each press' depth is best a parabola of the force, to some 10 ms."""
    grid = start_s + np.arange(-_AROUND_S, _AROUND_S + 1e-9, _STEP_S)
    force, total = smooth_force(forces), np.zeros(grid.size)
    for clear in (seen.clear() for seen in presses):
        if _ramps(clear):
            total += clear.time_s.size * np.log(_parabola_misfit(clear, grid, forces.time_s, force) + 1e-8)
    return float(grid[int(total.argmin())])


def clock_jumps(presses: Mapping[str, PressDepths], forces: ForceSeries, *, offset_s: float) -> dict[str, float]:
    """Return the clock offsets of single presses from `offset_s` (s), where they fit far better.

    A clock was reset between them and the others, or readings were lost.
    """
    grid = np.r_[offset_s, offset_s + np.arange(-_NEAR_S, _NEAR_S + 1e-9, _STEP_S)]
    force, found = smooth_force(forces), {}
    for name, clear in ((name, seen.clear()) for name, seen in presses.items()):
        if not _ramps(clear):
            continue
        square = _parabola_misfit(clear, grid, forces.time_s, force)
        away = float(grid[int(square.argmin())]) - offset_s
        if abs(away) > _MIN_JUMP_S and square[0] > _MISFIT_RATIO * square.min() + 1e-8:
            found[name] = away
    return found


def clock_jump_warnings(clock_outliers: Mapping[str, float]) -> Iterator[str]:
    """Return a warning that names the presses whose force comes too late or too early."""
    if clock_outliers:
        named = ", ".join(f"{name} ({away:+.2f} s)" for name, away in clock_outliers.items())
        yield (
            "forces.csv: depth and force of some presses go together only at another offset of the clocks than "
            f"those of the others: {named}. Was a clock set anew, or were readings lost? Give these a recording "
            "of their own."
        )


def _ramps(clear: PressDepths) -> bool:
    return clear.time_s.size >= 6 and bool(np.ptp(clear.depth_mm) > 0)


def _parabola_misfit(seen: PressDepths, offsets: Floats, force_time: Floats, force: Floats) -> Floats:
    """Return the mean square (offsets,) mm² of the depth about the best parabola of the force."""
    moved = np.interp(seen.time_s[None, :] + offsets[:, None], force_time, force)
    basis = np.stack([np.ones_like(moved), moved, moved**2], axis=-1)
    normal = basis.transpose(0, 2, 1) @ basis + 1e-9 * np.eye(3)
    right = basis.transpose(0, 2, 1) @ seen.depth_mm
    fitted = (np.linalg.solve(normal, right[..., None])[..., 0] * right).sum(axis=1)
    return np.asarray(np.maximum((seen.depth_mm**2).sum() - fitted, 0) / seen.time_s.size)


def estimate_offset(presses: Sequence[PressDepths], forces: ForceSeries, *, start_s: float) -> Estimate:
    """Return the offset near `start_s` with its standard deviation.

    A gel that relaxes within a few frames looks like a clock that is late: it is believed where the presses agree
    on it, for the frames of one press err together.
    """
    clear = [seen.clear() for seen in presses]
    clear = [seen for seen in clear if seen.time_s.size >= 4 and np.ptp(seen.depth_mm) > 0]
    if sum(seen.time_s.size for seen in clear) < 12:
        return Estimate(None, None, None, "s", why="too few frames show the ramps of the presses")
    plain = fit_clock(_problem(clear, forces, ()), start_s)
    fading = fit_clock(_problem(clear, forces, _MEMORIES_S), plain.offset_s)
    needed = len(_MEMORIES_S) * np.log(sum(seen.time_s.size for seen in clear)) + _MIN_GAIN
    gain = plain.misfit - fading.misfit
    scatter = float(np.std(gain, ddof=1)) * np.sqrt(gain.size) if gain.size > 1 else 0.0
    best = fading if gain.sum() - _AGREEMENT_SIGMA * scatter > needed else plain
    std = max(best.std_s, 1e-4)
    return Estimate.normal(best.offset_s, std, "s")


def stated_offset_warnings(
    stated_s: float, presses: Sequence[PressDepths], forces: ForceSeries
) -> tuple[str, ...]:
    """Return a warning where depth and force fit at another offset than the stated one (s)."""
    if not presses:
        return ()
    found = estimate_offset(presses, forces, start_s=parabola_offset(presses, forces, start_s=stated_s))
    if found.value is None or found.std is None:
        return ()
    if abs(found.value - stated_s) < max(_CONTRADICTION_S, _CONTRADICTION_SIGMA * found.std):
        return ()
    return (
        f"recording.toml: [clock] offset_s = {stated_s:.10g} is taken as stated, but depth and force of the "
        f"presses go together at {found.value:.3f} s (std {found.std:.3f} s). Correct it, or leave it out: then "
        "it is estimated.",
    )


def _problem(presses: Sequence[PressDepths], forces: ForceSeries, memories: Sequence[float]) -> ClockProblem:
    smooth, slow = smooth_force(forces), smooth_force(forces, min(_MEMORIES_S))
    zero = float(np.median(smooth[smooth <= np.quantile(smooth, 0.3)]))
    time = np.concatenate([seen.time_s for seen in presses])
    scale = max(float(np.ptp(smooth)), 1e-9)
    normal = (smooth - zero) / scale
    counts = [seen.time_s.size for seen in presses]
    touch = [(seen.touch_N - zero) / scale if np.isfinite(seen.touch_N) else np.inf for seen in presses]
    return ClockProblem(
        time_s=time,
        depth_mm=np.concatenate([seen.depth_mm for seen in presses]),
        press=np.repeat(np.arange(len(presses)), counts),
        kind=number_of([seen.kind for seen in presses], counts),
        touch=np.repeat(touch, counts),
        force_time_s=forces.time_s,
        # a memory of the readings' own noise would smooth it, which fits better whatever the gel does
        series=np.array([normal, *(memory(forces.time_s, slow / scale, fade_s=fade) for fade in memories)]),
    )


def smooth_force(forces: ForceSeries, width_s: float = _SMOOTH_S) -> Floats:
    """Return the normal force (T,) N, a running mean over `width_s`, which rounds corners by less than a frame."""
    force = forces.force_N[:, 2]
    interval = max(float(np.median(np.diff(forces.time_s))), 1e-9)
    half = min(int(0.5 * width_s / interval), max(force.size // 20, 0))
    padded = np.pad(force, half, mode="edge")
    return np.asarray(np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid"))
