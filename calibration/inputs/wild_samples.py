"""Find samples that no neighbour in time supports: a logger's codes for "no reading", and spikes.

A force is compared with its own depth, r = F - k max(w, 0) with the press's secant k, so that ramps, their corners
and the touch leave r nearly level. A sample is wild if r lies outside the two samples before and the two after it
by more than these differ plus

    t_4(ALARM / 2N) s,    s = 1.4826 median |r - interpolation of its neighbours| / sqrt(1 + weights^2)

with Student's t of four degrees of freedom for the N samples of a recording (an identifier of Hampel's kind,
J. Am. Stat. Assoc. 69 (1974) 383). A jump to another level, as in pull-off or stick-slip, has neighbours at its
own level. The first and the last sample, and those at the touch, where adhesion pulls, must also lie outside the
forces of all presses, or below twice their largest tension. Values beyond a gap as wide as the range of the
others, or repeated below all others, and farther off than noise reaches, are no neighbours, and N is their number
for them; those beyond a hundred ranges are wild.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import TYPICAL_FORCE_N, TYPICAL_ZERO_MM, Ints
from tactilevision.errors import InputError
from tactilevision.records.constants import NONZERO
from tactilevision.records.measured import Bools, Curve, Floats
from tactilevision.robust import mad_std, second_difference_std

NEAR = 2  # samples on either side that a sample is compared with
ALARM = 0.005  # false alarm rate of a recording
TAIL = 4  # degrees of freedom of Student's t, for noise with heavy tails
CORE = 0.05  # largest share of the samples at either end that may be wild
MANY = 0.3  # the same of values that are wild whatever their neighbours
ABSURD = 100  # ranges of the other values beyond which a value is wild whatever its neighbours
LOW = 0.1  # of the others' range: repeated values farther below are no neighbours
FINEST = 1e-3  # of the range of forces, least noise: smaller errors of one sample hardly move a fit
FEW = 8  # samples of a press that determine its own noise
NAMED = 3  # samples that a warning names
WHAT = "samples lie far from those before and after them, as spikes or a logger's codes for no reading"


def without_wild(curves: tuple[Curve, ...], *, where: str) -> tuple[tuple[Curve, ...], str]:
    """Return the curves of one recording without wild samples, and a warning that names these, "" for none.

    `where`: their file. Raises InputError if more than a few in a hundred samples are wild.
    """
    if not curves:
        return curves, ""
    size = [curve.time_s.size for curve in curves]
    press = np.repeat(np.arange(len(curves)), size)
    names = ("time_s", "depth_mm", "force_N")
    time_s, depth_mm, force_N = (np.concatenate([getattr(curve, name) for curve in curves]) for name in names)
    wild = wild_samples(press, time_s, depth_mm, np.nan_to_num(force_N))
    rows = zip(press[wild], time_s[wild], depth_mm[wild], force_N[wild, 2], strict=True)
    named = [f"press {curves[k].press} at {t:.6g} s, depth_mm = {w:g}, fz_N = {F:g}" for k, t, w, F in rows]
    if not named:
        return curves, ""
    said, remedy = f"{len(named)} of {wild.size} {WHAT}", "Remove these rows, or correct what wrote them."
    if len(named) > max(1, CORE * wild.size):
        raise InputError(said, where=where, value=named[0], remedy=remedy)
    more = f"; and {len(named) - NAMED} more" if len(named) > NAMED else ""
    parts = np.split(~wild, np.cumsum(size)[:-1])
    kept = tuple(curve.samples(part) for curve, part in zip(curves, parts, strict=True) if part.any())
    return kept, f"{where}: {said}, and are excluded ({'; '.join(named[:NAMED])}{more})"


def wild_samples(press: Ints, time_s: Floats, depth_mm: Floats, force_N: Floats) -> Bools:
    """Return which samples (N,) of one recording are wild; none of fewer than ten.

    `force_N` (N, 3); the presses' indices rise, and the samples of a press are in the order of time.
    """
    from scipy.special import stdtrit

    wild = np.zeros(press.size, dtype=bool)
    if press.size <= 1 / CORE / 2:
        return wild
    columns = ((depth_mm, TYPICAL_ZERO_MM), *((force, TYPICAL_FORCE_N) for force in force_N.T))
    for values, least in columns:
        wild |= _beyond(values, ABSURD, least, MANY)
    odd = wild.copy()
    std = -float(stdtrit(TAIL, ALARM / 2 / press.size))
    for values, least in (columns[0], columns[-1]):
        noise = max(least, second_difference_std(values))
        odd |= _beyond(values, 1, std * noise, CORE) | _repeated_below(values, std * least)
    limit = np.where(odd, -stdtrit(TAIL, ALARM / 2 / max(1, np.sum(odd))), std)
    while True:
        trusted = np.flatnonzero(~(wild | odd))
        off, beyond = _excess(press, time_s, depth_mm, force_N[:, 2], trusted)
        new = ~wild & (off > limit) & (odd | (beyond > limit))
        if not new.any():
            return wild
        wild |= new


def _beyond(values: Floats, ranges: float, least: float, share: float) -> Bools:
    """Return which values (N,), this share at most, lie beyond a gap of so many ranges of those before it."""
    off, few = np.zeros(values.size, dtype=bool), max(1, int(share * values.size))
    for sign in (1, -1):
        ordered = np.sort(sign * values)
        reach = np.maximum(ordered - ordered[few], least)[:-1]
        gaps = np.flatnonzero(np.diff(ordered) > ranges * reach)
        gaps = gaps[gaps >= values.size - 1 - few]
        if gaps.size:
            off |= sign * values > ordered[gaps[0]]
    return off


def _repeated_below(values: Floats, least: float) -> Bools:
    """Return which values (N,) occur more than once, far below all but a few of the others."""
    low, high = np.quantile(values, [CORE, 1 - CORE])
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((counts[which] > 1) & (values < low - max(LOW * (high - low), least)))


def _excess(
    press: Ints, time_s: Floats, depth_mm: Floats, force_N: Floats, trusted: Ints
) -> tuple[Floats, Floats]:
    """Return how far r (N,) lies outside its trusted neighbours beyond their own range, and the force outside all
    forces where these neighbours are no proof (else infinite), in std.
    """
    inside, own = np.maximum(depth_mm, 0.0), press[trusted]
    secant, low_N, high_N = np.zeros(int(press[-1]) + 1), 0.0, 0.0
    for one in np.unique(own):
        rows = trusted[own == one]
        deep = rows[inside[rows] >= inside[rows].max() / 2]
        secant[one] = np.median(force_N[deep] / np.maximum(inside[deep], TYPICAL_ZERO_MM))
        ordered = np.sort(force_N[rows])
        low_N, high_N = min(low_N, *ordered[1:2]), max(high_N, *ordered[-2:-1])
    r, all_rows = force_N - secant[press] * inside, np.arange(press.size)
    before = np.searchsorted(trusted, all_rows)[:, None] - np.arange(1, NEAR + 1)
    after = np.searchsorted(trusted, all_rows, side="right")[:, None] + np.arange(NEAR)
    places = np.hstack([before, after])
    rows = trusted[np.clip(places, 0, trusted.size - 1)]
    known = (places >= 0) & (places < trusted.size) & (press[rows] == press[:, None])
    low = np.min(r[rows], axis=1, where=known, initial=np.inf)
    high = np.max(r[rows], axis=1, where=known, initial=-np.inf)
    alone = ~known.any(axis=1)
    low[alone] = high[alone] = r[alone]
    inner = known[:, :NEAR].any(axis=1) & known[:, NEAR:].any(axis=1)
    touch = (np.max(depth_mm[rows], axis=1) > 0) & (np.min(depth_mm[rows], axis=1) < 0)
    outside = np.maximum(2 * low_N - force_N, force_N - high_N)
    off = np.maximum(low - r, r - high) - (high - low)
    noise = _noise_N(press, time_s, r, inside > 0, trusted)
    least = FINEST * float(np.ptp(np.quantile(force_N[trusted], [CORE, 1 - CORE])))
    std = np.maximum(noise, least)
    return off / std, np.where(inner & ~touch, np.inf, outside / std)


def _noise_N(press: Ints, time_s: Floats, r: Floats, inside: Bools, trusted: Ints) -> Floats:
    """Return the std of r (N,), in the gel and in air: that of all presses, or a press's own if it is larger."""
    left, rows, right = (trusted[k : trusted.size - 2 + k] for k in range(3))
    one = press[left] == press[right]
    left, rows, right = left[one], rows[one], right[one]
    span = time_s[right] - time_s[left]
    share = np.where(span > 0, (time_s[rows] - time_s[left]) / np.where(span > 0, span, 1.0), 0.5)
    weights = (share, np.full(share.size, 0.5))  # by time, and by number where times are coarse
    ways = [(r[rows] - (1 - w) * r[left] - w * r[right]) / np.sqrt(1 + w**2 + (1 - w) ** 2) for w in weights]
    noise = np.full(press.size, NONZERO)
    for where in (inside, ~inside):
        mine = where[left] & where[rows] & where[right]
        if mine.sum() < FEW:
            mine = np.ones(rows.size, dtype=bool)
        steps = min((way[mine] for way in ways), key=lambda way: mad_std(way, centre=0.0))
        noise[where] = np.maximum(noise[where], mad_std(steps, centre=0.0))
        for k in np.flatnonzero(np.bincount(press[rows][mine]) >= FEW):
            its = where & (press == k)
            noise[its] = np.maximum(noise[its], mad_std(steps[press[rows][mine] == k], centre=0.0))
    return noise
