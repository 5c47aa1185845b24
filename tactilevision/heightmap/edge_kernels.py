"""Compiled kernels of circles, edge profiles and walls."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.compiled import BYTES2, LINE, LINE32, LINES, PLANE, kernel
from tactilevision.compiled.parts import median, solved
from tactilevision.records.measured import Floats
from tactilevision.robust import MAD_TO_STD

# Circles through places, and through the flanks of a rim, of `circle.py` and `circular_edges.py`, compiled.

STIFFENING = 1e-9  # on the diagonal of normal equations, as circle.py has it


@kernel()
def _weighted(terms: Floats, values: Floats, weights: Floats) -> Floats:
    """Weighted least squares (3,) of values (n,) over terms (3, n)."""
    normal, right = STIFFENING * np.eye(3), np.zeros(3)
    for i in range(len(values)):
        for j in range(3):
            part = weights[i] * terms[j, i]
            right[j] += part * values[i]
            for k in range(3):
                normal[j, k] += part * terms[k, i]
    return solved(normal, right)


@kernel()
def _std(off: Floats) -> float:
    return MAD_TO_STD * median(np.abs(off)) + 1e-9


@kernel()
def _kept(off: Floats, width: float) -> Floats:
    """Geman and McClure's weights (n,), as robust.py has them."""
    return 1.0 / np.square(1.0 + np.square(off * (1.0 / width)))


@kernel(LINE, LINE, LINE)
def quick_circle(x: Floats, y: Floats, weight: Floats) -> tuple[float, float, float]:
    """Centre and radius of places (n,), in their unit, as `circle.quick_circle` has them."""
    terms, squares, keep = np.ones((3, len(x))), x * x + y * y, weight
    terms[0], terms[1] = x, y
    a, b, radius = 0.0, 0.0, 0.0
    for _ in range(2):
        a, b, c = _weighted(terms, squares, keep)
        radius = np.sqrt(max(c + 0.25 * (a * a + b * b), 1e-12))
        off = np.sqrt((x - 0.5 * a) ** 2 + (y - 0.5 * b) ** 2) - radius
        keep = weight * _kept(off, 2.0 * _std(off))
    return 0.5 * a, 0.5 * b, radius


@kernel(LINE, LINES, LINE)
def flanks(places: Floats, profiles: Floats, parts: Floats) -> Floats:
    """Places (K,) where profiles (K, J) fall to `parts` (K,) of their peak, inwards from it, in mm; or NaN."""
    out = np.full(len(profiles), np.nan)
    for k in range(len(profiles)):
        line, top = profiles[k], -1
        for i in range(len(line)):
            if not np.isnan(line[i]) and (top < 0 or line[i] > line[top]):
                top = i
        for i in range(top - 1, -1, -1):
            level = parts[k] * line[top]
            if line[i] < level:
                share = (level - line[i]) / (line[i + 1] - line[i])
                out[k] = places[i] + share * (places[1] - places[0])
                break
    return out


@kernel(LINE, LINES, "float64", "int64")
def harmonics(places: Floats, terms: Floats, tolerance: float, rounds: int) -> tuple[Floats, float, float]:
    """Mean, cos and sin part (3,) of places (n,) over terms (3, n), spread and rms of the rest, robust, in mm."""
    off, solution = places - median(places), np.zeros(3)
    scale = _std(off)
    for _ in range(rounds):
        before, solution = solution, _weighted(terms, places, _kept(off, 2.0 * scale))
        off = places - (solution[0] * terms[0] + solution[1] * terms[1] + solution[2] * terms[2])
        scale = _std(off)
        if np.abs(solution - before).max() < tolerance * scale:
            break
    return solution, scale, np.sqrt(np.mean(off * off))


# Slopes along the rays of a rim of `circular_edges.py`, compiled.

Picture = npt.NDArray[np.float32]


@kernel(LINE32, LINE32, LINE32, LINE32, "float32", "float32", "float32[:, ::1]", "float32[:, ::1]")
def rays(
    across: Picture, down: Picture, r: Picture, s: Picture, left: float, top: float, x: Picture, y: Picture
) -> None:
    """Places `x`, `y` (K, J) in px along directions (K,): `r`, `s` (J,) px along x and y from a centre."""
    for k in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[k, j] = across[k] * r[j] + left
            y[k, j] = down[k] * s[j] + top


@kernel(PLANE, PLANE, BYTES2, LINE32, LINE32, "int64")
def inward(
    p: Picture, q: Picture, known: npt.NDArray[np.uint8], across: Picture, down: Picture, each: int
) -> Floats:
    """Slopes (K, J), mm/mm, towards the centre, means of `each` directions (K each, J); NaN: unknown."""
    out = np.empty((p.shape[0] // each, p.shape[1]))
    for k in range(out.shape[0]):
        for j in range(out.shape[1]):
            total = np.float32(0.0)
            for i in range(each * k, each * k + each):
                slope = -across[i] * p[i, j] - down[i] * q[i, j]
                total += slope if known[i, j] else np.float32(np.nan)
            out[k, j] = total / each
    return out


@kernel(LINES, "Array(float64, 1, 'C', True)")
def quantiles(values: Floats, shares: Floats) -> Floats:
    """What a share (n,) of the known values in each column of (K, J) do not exceed, (n, J), or NaN."""
    out, column = np.full((len(shares), values.shape[1]), np.nan), np.empty(values.shape[0])
    for j in range(values.shape[1]):
        count = 0
        for k in range(values.shape[0]):
            value = values[k, j]
            if not np.isnan(value):
                i = count
                while i and column[i - 1] > value:
                    column[i] = column[i - 1]
                    i -= 1
                column[i] = value
                count += 1
        for n in range(len(shares) if count else 0):
            out[n, j] = column[int(shares[n] * (count - 1))]
    return out


# What `steep_edges.py` does of each wall, compiled: the fit of its law, and its slopes put in place.

REACHED = 9.0  # deviations of the camera's blur beyond which a place adds nothing: e^-40
SAME = 1e-9  # of a step: bins lie whole steps apart, and are weighed alike, but for rounding


@kernel()
def _tabled(value: float, step: float, line: Floats) -> float:
    """What a `line` tabled from 0 on, at every `step`, says at a `value` of 0 or more."""
    at = value / step
    if not at < len(line) - 1:
        return line[-1]
    i = int(at)
    return line[i] + (at - i) * (line[i + 1] - line[i])


@kernel()
def _sought(value: float, line: Floats, step: float) -> float:
    """Where, from 0 on in steps, a rising `line` reaches a `value`."""
    if not value < line[-1]:
        return (len(line) - 1) * step
    i = max(int(np.searchsorted(line, value, side="right")) - 1, 0)
    return (i + max(value - line[i], 0.0) / (line[i + 1] - line[i])) * step


@kernel()
def _blurred(lines: Floats, sigma: float) -> Floats:
    """Lines (K, n) blurred by `sigma` of their steps, as OpenCV does with its ends repeated."""
    count = lines.shape[1]
    sigma = min(max(sigma, 0.3), 0.25 * count)
    half = (int(np.rint(8.0 * sigma + 1.0)) | 1) // 2
    weights = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    weights /= weights.sum()
    out, padded = np.zeros(lines.shape), np.empty(count + 2 * half)
    for k in range(lines.shape[0]):
        padded[:half], padded[half : half + count], padded[half + count :] = lines[k, 0], lines[k], lines[k, -1]
        for j in range(len(weights)):
            for i in range(count):
                out[k, i] += weights[j] * padded[i + j]
    return out


@kernel()
def _light(unknown: Floats, edge: float, rates: Floats, table_step: float, table: Floats) -> Floats:
    """S and C at the law's places, and both by blur of the edge and the three c: (n, 10), S first."""
    lines, count = _blurred(rates, edge), rates.shape[1]
    slope, light = np.zeros(count), np.zeros((count, 10))
    for k in range(3):
        slope += unknown[3 + k] * lines[k]
    for i in range(count):
        size, sign = abs(slope[i]), np.sign(slope[i])
        of_sine, of_cosine = _tabled(size, table_step, table[2]), sign * _tabled(size, table_step, table[3])
        light[i, 0], light[i, 5] = sign * _tabled(size, table_step, table[0]), _tabled(size, table_step, table[1])
        bend = edge * edge * (slope[i + 1] + slope[i - 1] - 2.0 * slope[i]) if 0 < i < count - 1 else 0.0
        light[i, 1], light[i, 6] = of_sine * bend, of_cosine * bend
        for k in range(3):
            light[i, 2 + k], light[i, 7 + k] = of_sine * lines[k, i], of_cosine * lines[k, i]
    return light


@kernel()
def _shown(
    unknown: Floats,
    s: Floats,
    first: float,
    step: float,
    rates: Floats,
    table_step: float,
    table: Floats,
    min_rate: float,
) -> tuple[Floats, Floats]:
    """Slopes (n,) that the picture shows at bins `s`, and their rates (6, n) by unknown."""
    edge, camera = np.exp(unknown[1]) / step, np.exp(unknown[2]) / step
    light = _light(unknown, edge, rates, table_step, table)
    slopes, out, sums, last = np.empty(len(s)), np.empty((6, len(s))), np.empty(10), light.shape[0] - 1
    sigma = max(camera, 1.0)
    reach = int(REACHED * sigma) + 1
    weights, part = np.empty(2 * reach + 1), -1.0
    for j in range(len(s)):
        at = (s[j] - unknown[0] - first) / step
        near = int(np.floor(min(max(at, 0.0), float(last))))
        if abs(at - near - part) > SAME:
            part = at - near
            for i in range(len(weights)):
                weights[i] = np.exp(-0.5 * ((part + reach - i) / sigma) ** 2)
        sums[:], by_shift, by_shift_too, by_blur, by_blur_too = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(max(near - reach, 0), min(near + reach, last) + 1):
            weight, off = weights[i - near + reach], (at - i) / sigma
            for k in range(10):
                sums[k] += weight * light[i, k]
            sine, cosine = weight * off * light[i, 0], weight * off * light[i, 5]
            by_shift, by_shift_too, by_blur, by_blur_too = (
                by_shift + sine,
                by_shift_too + cosine,
                by_blur + off * sine,
                by_blur_too + off * cosine,
            )
        ratio = sums[0] / sums[5]
        size = _sought(abs(ratio), table[4], table_step)
        slopes[j] = np.sign(ratio) * size
        gain = sums[5] * max(_tabled(size, table_step, table[5]), min_rate)
        out[0, j] = (by_shift - ratio * by_shift_too) / (sigma * step) / gain
        out[2, j] = (by_blur - ratio * by_blur_too) / gain
        out[1, j] = (sums[1] - ratio * sums[6]) / gain
        for k in range(3):
            out[3 + k, j] = (sums[2 + k] - ratio * sums[7 + k]) / gain
    return slopes, out


@kernel(*[LINE] * 5, "float64", "float64", LINES, "float64", LINES, *["float64"] * 3, "int64")
def fitted(
    start: Floats,
    prior: Floats,
    s: Floats,
    seen: Floats,
    std: Floats,
    first: float,
    step: float,
    rates: Floats,
    table_step: float,
    table: Floats,
    min_rate: float,
    damping: float,
    tolerance: float,
    rounds: int,
) -> tuple[Floats, Floats, Floats]:
    """The unknowns (6,), their normal equations (6, 6), and how many deviations (n,) the law lies off.

    As `Law.fitted` of wall_law.py from `start` under a `prior`. The law's places begin at `first`;
    `table` (6, m): S, C, dS, dC, h and dh.
    """
    least, unknown, trial = damping, start.copy(), start.copy()
    uphill, normal, off, squares = np.zeros(6), np.zeros((6, 6)), np.zeros(len(s)), np.inf
    for turn in range(rounds + 1):
        if turn and np.sum(uphill * solved(normal, uphill)) < tolerance:
            break
        better = False
        for _ in range(5 if turn else 1):
            if turn:
                trial = unknown - solved(normal * (1.0 + damping * np.eye(6)), uphill)
            slopes, by = _shown(trial, s, first, step, rates, table_step, table, min_rate)
            misfit, aside = (slopes - seen) / std, trial - start
            after = np.sum(misfit * misfit) + np.sum(prior * aside * aside)
            better = bool(turn == 0 or after < squares)
            if better:
                by /= std
                unknown, off, squares = trial.copy(), misfit, after
                uphill, normal = prior * aside, np.diag(prior)
                for i in range(6):
                    uphill[i] += np.sum(by[i] * misfit)
                    for j in range(6):
                        normal[i, j] += np.sum(by[i] * by[j])
                break
            damping *= 30.0
        if not better:
            break
        damping = max(0.1 * damping, least) if turn else least
    return unknown, normal, off


@kernel(
    *["float32[:, ::1]"] * 2, "int64", "int64", LINE, LINE, *["float64"] * 3, "int64", *["float64"] * 2, LINE, LINE
)
def put(
    p: Picture,
    q: Picture,
    top: int,
    left: int,
    x: Floats,
    y: Floats,
    face_mm: float,
    inner: float,
    outer: float,
    least: int,
    step: float,
    depth_mm: float,
    steep: Floats,
    remaining: Floats,
) -> None:
    """Set slopes (H, W) from a window's corner on between `inner` and `outer` mm of an axis, as `restore` does.

    `x` (w,), `y` (h,) from it; the tilt is that of a face of radius `face_mm` with `least` pixels. `steep`,
    `remaining` (n,): u' and 1 - u/w, `step` mm apart from `inner` on.
    """
    tilt_x, tilt_y, count = 0.0, 0.0, 0
    for row in range(len(y)):
        for i in range(len(x)):
            if np.float32(x[i] * x[i]) + np.float32(y[row] * y[row]) < face_mm * face_mm:
                tilt_x, tilt_y, count = tilt_x + p[top + row, left + i], tilt_y + q[top + row, left + i], count + 1
    tilt_x, tilt_y = (tilt_x / count, tilt_y / count) if count >= least else (0.0, 0.0)
    for row in range(len(y)):
        for i in range(len(x)):
            square = np.float32(x[i] * x[i]) + np.float32(y[row] * y[row])
            if inner * inner <= square < outer * outer:
                r = np.sqrt(square)
                at = (r - inner) / step
                k = min(int(at), len(steep) - 2)
                part = at - int(at)
                slope = steep[k] + part * (steep[k + 1] - steep[k])
                left_over = remaining[k] + part * (remaining[k + 1] - remaining[k])
                slope *= (1.0 + (tilt_x * x[i] + tilt_y * y[row]) / depth_mm) / r
                p[top + row, left + i] = slope * x[i] + tilt_x * left_over
                q[top + row, left + i] = slope * y[row] + tilt_y * left_over
