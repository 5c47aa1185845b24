"""The steep wall around a flat punch: its law, the edge, and the depth that it hides."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from tactilevision.heightmap.circular_edges import CircularEdge, find_circular_edges
from tactilevision.photometric.colour_change import Window
from tactilevision.records.certified import USUAL_MM, TaughtWalls
from tactilevision.records.constants import ROUNDING, TINY
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Array, Bools, Floats, Pair

# The wall around one flat face: its position, the surface's fall along it, and the part of the step that it hides.
#
# Also the law by which the walls of one sensor's pictures are found.

LEAN = 2.1  # 1/tan of 25 degrees: lamps of these sensors stand at 15 to 35


@dataclass(frozen=True, slots=True)
class WallLaw:
    """Law by which walls are found; `limit`: steepest slope that is read reliably, infinite for no walls.

    `taught` is fitted to certified faces of the sensor.
    """

    limit: float
    taught: TaughtWalls | None = None


@dataclass(frozen=True, slots=True)
class PunchEdge:
    """The wall around one flat face.

    `centre_mm` from the middle of the picture's top left pixel; `radius_mm` of the edge; `reach_mm` from the edge
    within which slopes are replaced; `places_mm`, `fall_mm` (n,): distances from the edge, and the surface's fall
    below the face there; `depth_mm`: approximate depth of the face relative to the gel at the profile's end;
    `missing_mm`: part of the step that the slopes as read lack, `std_mm`: deviation of the step.
    """

    centre_mm: Pair
    radius_mm: float
    reach_mm: float
    places_mm: Floats
    fall_mm: Floats
    depth_mm: float
    missing_mm: float
    std_mm: float

    @property
    def fall_at_reach_mm(self) -> float:
        """Return the surface's fall below the face at the distance where slopes are read again, in mm."""
        return float(np.interp(self.reach_mm, self.places_mm, self.fall_mm))

    @property
    def teachable(self) -> bool:
        """Return whether the wall falls by more than the slopes as read; other walls are not corrected."""
        return self.fall_at_reach_mm > 0 and self.missing_mm > 0

    def carried(self, change_mm: float) -> Floats:
        """Return the part (n,) of a change of the face's depth at each of `places_mm`: 1 on it, 0 where slopes are
        read.

        The change is placed where the wall is steepest, above the threshold slope T that satisfies

            |change| = int max(u' - T, 0) ds

        so that no wall with a larger fall overhangs. The errors of faces lie there, less than .1 mm from the edge
        (docs/evidence/rendered.md); farther out, read slopes determine the law.
        """
        fall = np.interp(np.minimum(self.places_mm, self.reach_mm), self.places_mm, self.fall_mm)
        steps = np.maximum(np.diff(fall), 0.0)  # u' ds of even places
        sorted_steps = np.append(np.sort(steps)[::-1], 0.0)
        above = np.cumsum(sorted_steps) - sorted_steps * np.arange(1, sorted_steps.size + 1)
        over = np.maximum(steps - np.interp(max(abs(change_mm), TINY), above, sorted_steps), 0.0)
        return np.append(1.0, 1.0 - np.cumsum(over) / over.sum())

    def taught_by(self, walls: TaughtWalls) -> PunchEdge:
        """Return the wall with the hidden depth (mm) that certified faces determine, and the smaller deviation."""
        if not self.teachable:
            return self
        change, std_mm = walls.change_mm(self.missing_mm, self.depth_mm)
        return replace(
            self,
            fall_mm=self.fall_mm + change * (1.0 - self.carried(change)),
            depth_mm=self.depth_mm + change,
            missing_mm=self.missing_mm + change,
            std_mm=min(self.std_mm, std_mm),
        )


# The law by which the gel's surface falls outside a flat punch, and the light that such a wall shows.
#
# Outside the sharp edge of a rigid flat face of radius a (s: distance from the edge)
#
#     u(s) = w - sum_k c_k U_k(s)      U_k' = a s^k / (r sqrt(r^2 - a^2)),  r = a + s,  k = 0, 1, 2
#
# k = 0 is Boussinesq's punch on a half-space; a layer, friction and large depth keep the square root at the edge
# and change the smooth factor, which k = 1, 2 represent. The slope is unbounded at the edge. A picture shows
#
#   h(seen slope) = <S(t)> / <C(t)>   t = arctan(u'), u blurred by the edge's rounding, < > blurred by the camera
#
# The camera blurs light, not slope. A lamp with L = 1/tan of its elevation gives max(0, cos t - L sin t cos f)
# to a wall whose foot points f away from it; averaged around the rim
#
#     C = (cos t (pi - f0) + L sin t sin f0)/pi
#     S = (2/pi) (cos t sin f0/L + sin t ((pi - f0)/2 - sin(2 f0)/4))      cos f0 = min(1, 1/(L tan t)),  h = S/C
#
# These equal cos t and sin t while the wall faces every lamp, L tan t < 1; beyond, S tends to sin t /2: attached
# shadows. Assumes small slopes except for the light; steep_edges.py gives the effect of large ones at the edge.
# Source: Johnson, Contact Mechanics (1985), eq. 3.38 (k = 0).

CAMERA_PX = (0.8, 0.5)  # px: usual blur of the camera, and the spread of its logarithm
EDGE_PX = (0.5, 0.8)  # px: usual blur by the edge's rounding, and the spread of its logarithm
FINE = 0.25  # px: grid of the law
MAX_ITERATIONS = 8  # steps of the fit, limited by the time per frame
DAMPING = 1e-3  # of the normal equations' diagonal: minimum damping
EACH = np.arange(6)  # indices of the unknowns on a diagonal
# squares of deviations by which a last step would still lessen what is left: a seventh of one deviation
CONVERGENCE_TOL = 0.02
STEEPEST = 8  # largest tabulated slope: steeper walls differ by less than a hundredth
MIN_RATE = 0.02  # of h: steeper walls are indistinguishable
TABLED = 801  # slopes in the table: a finer one changes no depth by .1 um


@dataclass(frozen=True, eq=False)
class WallLight:
    """S, C and their rates dS/du, dC/du (n,) at `slopes` u (n,), and h = S/C with its rate; dimensionless."""

    slopes: Floats
    sine: Floats
    cosine: Floats
    sine_rate: Floats
    cosine_rate: Floats
    seen: Floats
    seen_rate: Floats


@lru_cache
def wall_light(lean: float) -> WallLight:
    """Return the light around a wall for lamps of this `lean` (1/tan of elevation), tabulated over slope (n,)."""
    u = np.linspace(0.0, STEEPEST, TABLED)
    t = np.arctan(u)
    away = np.arccos(np.minimum(1.0, 1.0 / np.maximum(lean * u, TINY)))
    cosine = (np.cos(t) * (np.pi - away) + lean * np.sin(t) * np.sin(away)) / np.pi
    part = 0.5 * (np.pi - away) - 0.25 * np.sin(2.0 * away)
    sine = 2.0 / np.pi * (np.cos(t) * np.sin(away) / lean + np.sin(t) * part)
    seen = np.maximum.accumulate(sine / cosine) + ROUNDING * np.arange(u.size)
    return WallLight(u, sine, cosine, np.gradient(sine, u), np.gradient(cosine, u), seen, np.gradient(seen, u))


def _solved(normal: Floats, right: Floats) -> Floats:
    """Return the solution (k,) of positive definite normal equations (k, k) x = right (k,), in their unit."""
    return np.asarray(cv2.solve(normal, right[:, None], flags=cv2.DECOMP_CHOLESKY)[1][:, 0])


class Law:
    """The law on a fine grid, and as the picture shows it at bins `s` (n,).

    Unknowns: shift of the edge, log of its blur and the camera's (mm), c_0 to c_2.
    """

    def __init__(self, radius_mm: float, px: float, far: float, light: WallLight, s: Floats) -> None:
        self.radius_mm, self.px, self.step, self.light, self.s = radius_mm, px, FINE * px, light, s
        self.edges = np.arange(-14 * px, far + 8 * px, self.step)
        self.places = self.edges[:-1] + 0.5 * self.step
        s = np.maximum(self.edges, 0.0)
        log, root = np.arccosh(1.0 + s / radius_mm), np.sqrt(s * (s + 2.0 * radius_mm))  # of r = a + s
        angle = np.arctan(root / radius_mm)
        self.lines = np.stack(
            [angle, radius_mm * (log - angle), radius_mm * (root - radius_mm * (2 * log - angle))]
        )
        self.rates = np.diff(self.lines, axis=1) / self.step

    def fitted(self, slopes: Floats, std: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the most likely unknowns (6,) for `slopes` (n,) with deviations `std`, and their covariance.

        Also return the law's misfit in deviations (n,). Damped Gauss-Newton from the usual blur and the half-space
        law
        fitted to the outer slopes.
        """
        rate = np.interp(self.s, self.places, self.rates[0]) * (self.s > 3 * self.px)
        start = np.array([0.0, np.log(EDGE_PX[0] * self.px), np.log(CAMERA_PX[0] * self.px),
                          float(rate @ slopes / (rate @ rate)), 0.0, 0.0])  # fmt: skip
        bend = 3 * start[3] / self.radius_mm
        prior = np.array([2 * self.px, EDGE_PX[1], CAMERA_PX[1], 10 * start[3], bend, bend / self.radius_mm]) ** -2

        def misfit(unknown: Floats) -> tuple[float, Floats, Floats, Floats]:
            """Return the sum of squares, half its gradient (6,), normal equations (6, 6), and deviations (n,)."""
            predicted, rates = self._shown(unknown)
            off, aside = (predicted - slopes) / std, unknown - start
            rates /= std
            uphill, normal = rates @ off + prior * aside, rates @ rates.T
            normal[EACH, EACH] += prior
            return float(off @ off + prior @ aside**2), uphill, normal, off

        unknown, damping = start, DAMPING
        squares, uphill, normal, off = misfit(unknown)
        for _ in range(MAX_ITERATIONS):
            if uphill @ _solved(normal, uphill) < CONVERGENCE_TOL:
                break
            for _ in range(5):
                trial = unknown - _solved(normal * (1.0 + damping * np.eye(6)), uphill)
                after = misfit(trial)
                if after[0] < squares:
                    break
                damping *= 30
            else:
                break
            unknown, (squares, uphill, normal, off), damping = trial, after, max(0.1 * damping, DAMPING)
        return unknown, np.asarray(cv2.invert(normal)[1]), off

    def falls(self, unknown: Floats, s: float) -> tuple[Floats, float, Floats]:
        """Return falls at the grid's edges from the shifted edge on, the one at `s`, and its rates (6,)."""
        sigma = np.exp(unknown[1]) / self.step
        lines = _blur(self.lines, sigma)
        falls = unknown[3:] @ lines
        i = min(max(int((s - self.edges[0]) / self.step), 1), len(falls) - 3)
        share = (s - self.edges[i]) / self.step
        before, low, high, after = falls[i - 1 : i + 3]
        line = (1.0 - share) * lines[:, i] + share * lines[:, i + 1]
        bend = (1.0 - share) * (before + high - 2.0 * low) + share * (low + after - 2.0 * high)
        rates = np.array([-(high - low) / self.step, sigma * sigma * bend, 0.0, *line])
        return falls, float(unknown[3:] @ line), rates

    def step_at_edge(self, unknown: Floats) -> Floats:
        """Return a unit step at the edge, blurred as the edge is, at the grid's edges (n,)."""
        return np.asarray(_blur((self.edges > 0)[None].astype(float), np.exp(unknown[1]) / self.step)[0])

    def _shown(self, unknown: Floats) -> tuple[Floats, Floats]:
        """Return the slopes (n,) that the picture shows at the bins, and their rates (6, n) by unknown.

        Gaussian blur is diffusion: the rate by the log of its sigma is sigma^2 times the second derivative.
        """
        edge, camera = np.exp(unknown[1:3]) / self.step
        rates = _blur(self.rates, edge)
        slope, table = unknown[3:] @ rates, self.light
        size, sign = np.abs(slope), np.sign(slope)
        light = np.zeros((2, 5, len(slope)))  # S and C; both, and by blur of the edge and the three c
        light[0, 0] = sign * np.interp(size, table.slopes, table.sine)
        light[1, 0] = np.interp(size, table.slopes, table.cosine)
        light[0, 1, 1:-1] = edge**2 * (slope[2:] + slope[:-2] - 2.0 * slope[1:-1])
        light[0, 2:] = rates
        np.multiply(light[0, 1:], sign * np.interp(size, table.slopes, table.cosine_rate), out=light[1, 1:])
        light[0, 1:] *= np.interp(size, table.slopes, table.sine_rate)
        sigma = max(camera, 1.0) * self.step
        distance = ((self.s - unknown[0])[:, None] - self.places) / sigma
        kernel = np.exp(-0.5 * distance * distance)
        blurred = np.matmul(light, kernel.T)
        ratio = blurred[0, 0] / blurred[1, 0]
        slopes = np.sign(ratio) * np.interp(np.abs(ratio), table.seen, table.slopes)
        light_rates = np.empty((2, 6, len(self.s)))
        light_rates[:, 1], light_rates[:, 3:] = blurred[:, 1], blurred[:, 2:]
        kernel *= distance
        light_rates[:, 0] = light[:, 0] @ kernel.T / sigma
        kernel *= distance
        light_rates[:, 2] = light[:, 0] @ kernel.T
        gain = blurred[1, 0] * np.maximum(np.interp(np.abs(slopes), table.slopes, table.seen_rate), MIN_RATE)
        return slopes, (light_rates[0] - ratio * light_rates[1]) / gain


def _blur(rows: Floats, sigma: float) -> Floats:
    """Return lines (K, n) blurred by `sigma` of their steps."""
    sigma = min(max(sigma, 0.3), 0.25 * rows.shape[1])  # the fit may overshoot
    size = round(8 * sigma + 1) | 1
    return np.asarray(cv2.GaussianBlur(rows, (size, 1), sigma, borderType=cv2.BORDER_REPLICATE))


# Walls too steep to read: the depth hidden at a flat punch's edge, determined from the gel outside it.
#
# Outside the edge of a rigid flat face the gel's surface follows the wall's law. For two or three pixels it is
# steeper than any calibrated slope, colours saturate, and a quarter of a deep face's height is hidden. Slopes
# farther out, and those at the foot of the blurred wall inside, are gentle and well read. They determine the law's
# unknowns, and the law gives the hidden depth.
#
# Slopes farther out do not determine the edge itself: finite strain makes the wall steeper there than the law of
# small slopes. By finite elements, rendered in the same light, the law gives less than the face's depth w by
#
#     D = EDGE_FALL (w^2/a) sqrt(px/a)        px: mm of a pixel
#
# which is added at the edge: 1.4 for EDGE_FALL where the surface follows the punch's edge, .3 where ink rounds it
# over .03 mm. The value here lies between; the deviation covers both (benchmarks/steep_edges.py: neo-Hooke, nu .40
# to .499, a/h .5 to 1, w/h to .2, friction .15 to .6, edges of h/60 to h/30, pixels of .045 to .095 mm). A camera
# blurs even a steep wall where it is narrow: faces of 3 to 8 % of the thickness may lose 3 to 9 % of their depth.
#
# A cast shadow next to the wall reads as slope, and a law fitted to it may double a face's depth. Its profile
# differs from the law, so walls whose outer slopes do not fit are not corrected: faces of .3 to .55 mm next to
# shadows then read .96 to 1.00 of their depth, compared with 1.3 to 2.5 by the law. Since walls are read too
# gentle, a law that gives a smaller step than was read is raised to the step read.
#
# Only round rims with a sharp inner flank are corrected: the slopes of balls, cones and ridges grow gently.
# Assumes a flat face, at least a third of whose rim is in the picture.

FOOT_PX = 6  # px inside the edge from which slopes are read
FAR = 0.4  # of the radius outside the edge, to which slopes are read; farther by a wall that hides half of it
HIDDEN_SHARE = 0.5  # of that range, which a wall may hide: with more, the rest no longer determines the law
SLOPE_ERROR = 0.03  # of the mean slope round the edge: its relative deviation
SLOPE_FLOOR = 0.01  # mm/mm: deviation of the mean slope round the edge where it is gentle
# mean square, in stated deviations, that slopes outside may lie off the law, and where the wall hides more than
# half of FAR: punches' own .0 to .2, a path tracer's .35 without shadows; next to shadows .4 to 2
MAX_MISFIT = (0.45, 0.3)
EDGE_FALL = 0.8  # of what the edge adds: benchmarks/steep_edges.py
EDGE_FALL_STD = 1.0  # of it: variation with ink, friction and edge radius
MIN_READ = 8  # readable bins outside the edge; with fewer it is not fitted
MIN_FACE = 50  # pixels of a face; with fewer it counts as unknown


def fit_edges(circles: Sequence[CircularEdge], law: WallLaw, *, px: float) -> list[PunchEdge]:
    """Return the walls at `circles` that the law fits, for pixels of `px` mm."""
    edges = [edge for circle in circles if (edge := fit_edge(circle, law, px=px)) is not None]
    return edges if law.taught is None else [edge.taught_by(law.taught) for edge in edges]


def window_of(
    shape: tuple[int, ...], centre_mm: Pair, *, mm_per_px: Pair, outer_mm: float
) -> tuple[tuple[slice, slice], Floats, Floats]:
    """Return rows and columns within `outer_mm` of a centre, and places x (1, w), y (h, 1) from it in mm."""
    (x0, x1), (y0, y1) = (
        (max(0, int((c - outer_mm) / step)), max(0, min(n, int((c + outer_mm) / step) + 2)))
        for c, step, n in zip(centre_mm, mm_per_px, shape[::-1], strict=True)
    )
    x = (np.arange(x0, x1) * mm_per_px[0] - centre_mm[0])[None, :]
    y = (np.arange(y0, y1) * mm_per_px[1] - centre_mm[1])[:, None]
    return (slice(y0, y1), slice(x0, x1)), np.asarray(x, np.float64), np.asarray(y, np.float64)


def restore(slopes: SlopeMap, edges: list[PunchEdge], *, mm_per_px: Pair) -> None:
    """Replace the slopes (H, W), mm/mm, that the walls hide by the law's, in place.

    Along the rim the only slope is the face's own tilt t, gentle and well read, of a rigid face:
    slope = -u'(s) (1 + t.x/w) r/|r| + t (1 - u/w).
    """
    half = 0.5 * min(mm_per_px)
    for edge in edges:
        outer, inner = edge.radius_mm + edge.reach_mm, edge.radius_mm + edge.places_mm[0]
        window, x, y = window_of(slopes.dz_dx.shape, edge.centre_mm, mm_per_px=mm_per_px, outer_mm=outer)
        step, lines = edge.places_mm[1] - edge.places_mm[0], _lines(edge, half)
        square = (x * x).astype(np.float32) + (y * y).astype(np.float32)
        p, q = slopes.dz_dx[window], slopes.dz_dy[window]
        face = (square < max(inner - 2 * half, 0.0) ** 2).view(np.uint8)
        known = cv2.countNonZero(face) >= MIN_FACE
        tilt = (cv2.mean(p, face)[0], cv2.mean(q, face)[0]) if known else (0.0, 0.0)
        band = (square >= inner * inner) & (square < outer * outer)
        rows, columns = np.divmod(np.flatnonzero(band).astype(np.int32), np.int32(band.shape[1]))
        x, y, r = x.ravel().take(columns), y.ravel().take(rows), np.sqrt(square[band])
        steep, remaining = _interpolated(lines, (r - inner) / step)
        steep *= (1.0 + (tilt[0] * x + tilt[1] * y) / edge.depth_mm) / r
        p[band] = steep * x + tilt[0] * remaining
        q[band] = steep * y + tilt[1] * remaining


def _lines(edge: PunchEdge, half: float) -> tuple[Floats, Floats]:
    """Return the mean slope u' within `half` of the wall's places (n,), and 1 - u/w there."""
    below, above = (np.interp(edge.places_mm + d, edge.places_mm, edge.fall_mm) for d in (half, -half))
    return (above - below) / (2 * half), 1.0 - 0.5 * (above + below) / edge.depth_mm


def _interpolated(lines: tuple[Floats, Floats], at: Floats) -> tuple[Floats, Floats]:
    """Return two lines (n,) interpolated at `at` (m,), counted in their steps."""
    i = at.astype(np.int32)
    at -= i
    np.minimum(i, len(lines[0]) - 2, out=i)
    steep, remaining = (line.take(i) + at * np.diff(line).take(i) for line in lines)
    return steep, remaining


def restore_windows(
    fine: Sequence[Iterable[Array]],
    windows: Sequence[Window],
    *,
    valid: Bools,
    mm_per_px: Pair,
    law: WallLaw,
) -> list[PunchEdge]:
    """Return the walls, restored in place in slopes (2, rows, columns), mm/mm, for each window of a picture."""
    maps = [SlopeMap(p, q, valid[window]) for window, (p, q) in zip(windows, fine, strict=True)]
    circles = [find_circular_edges(slopes, mm_per_px, limit=law.limit) for slopes in maps]
    edges = []
    for window, slopes, found in zip(windows, maps, circles, strict=True):
        restored = fit_edges(found, law, px=min(mm_per_px))
        restore(slopes, restored, mm_per_px=mm_per_px)
        top, left = (side.start * step for side, step in zip(window, mm_per_px[::-1], strict=True))
        edges += [
            replace(edge, centre_mm=(edge.centre_mm[0] + left, edge.centre_mm[1] + top)) for edge in restored
        ]
    return edges


def fit_edge(edge: CircularEdge, walls: WallLaw, *, px: float) -> PunchEdge | None:
    """Return the law fitted to the gentle slopes around a wall; None where too few are readable."""
    mean, s = edge.slopes, edge.places_mm - edge.radius_mm
    known = np.isfinite(mean)
    steep = known & ~(edge.highest < walls.limit)
    if not steep.any():
        return None
    hidden, usual = float(s[steep].max()), max(FAR * edge.radius_mm, 8 * px)
    far = max(usual, min(hidden / HIDDEN_SHARE, float(s[-1])))
    use = known & ~steep & (s > -FOOT_PX * px) & (s < far)
    if hidden > HIDDEN_SHARE * far or np.count_nonzero(use & (s > 0)) < MIN_READ:
        return None
    std = np.sqrt(SLOPE_FLOOR**2 + (SLOPE_ERROR * mean) ** 2 + edge.std**2)[use]
    law = Law(edge.radius_mm, px, far, wall_light(LEAN), s[use])
    unknown, covariance, off = law.fitted(mean[use], std)
    if float(np.mean(np.square(off[s[use] > 0]))) > MAX_MISFIT[int(far > usual)]:
        return None
    shift, reach = float(unknown[0]), hidden + px
    falls, fall, rate = law.falls(unknown, reach - shift)
    with_edge = rate @ covariance[:, 0] / covariance[0, 0]  # all else following the edge
    inner = -3 * float(np.hypot(*np.exp(unknown[1:3])))
    steps = np.where(known & (s > inner + shift), mean, 0.0) * (s[1] - s[0])  # mm
    within = np.clip((reach - s) / (s[1] - s[0]) + 0.5, 0.0, 1.0)  # a bin across the reach counts in part
    read, beyond = float(steps @ within), float(steps @ (1.0 - within))
    added = EDGE_FALL * max(fall + beyond, 0.0) ** 2 * px**0.5 / edge.radius_mm**1.5
    falls, fall = falls + added * law.step_at_edge(unknown), fall + added
    if 0.0 < fall < read:  # slopes of walls are read too gentle: a law with less depth has fitted a shadow
        falls, fall = falls * (read / fall), read
    elif fall <= 0.0 < read:
        return None
    table = slice(*np.searchsorted(law.edges, (inner, reach - shift + 2 * px)))
    if len(law.edges[table]) < 2 or not edge.radius_mm + shift > 0:  # the edge lies outside the wall: no valid law
        return None
    own = float(np.sqrt(rate @ covariance @ rate + (with_edge * edge.uneven_mm) ** 2))
    return PunchEdge(edge.centre_mm, edge.radius_mm + shift, reach - shift, law.edges[table], falls[table],
                fall + beyond, fall - read, float(np.hypot(own, EDGE_FALL_STD * added)))  # fmt: skip


# The wall's law fitted to certified faces of the same sensor.
#
# The relative error of the hidden depth by the law of steep walls grows with the depth and differs from sensor to
# sensor. Its two parameters come from certified faces, by ridge regression towards no change:
#
#     certified - read = hidden (share + growth (w/w0 - 1)) + noise     records/certified.py
#
# noise: PLACE_STD of the depth, the scatter of faces of one sensor over the picture. Presses of one indenter
# to one depth mostly share their place, so together they count as one, wherever they were.

PLACE_STD = 0.03  # of the depth: faces of one sensor about their law, six of the path tracer; benchmarks.rendered
PRIOR_STD = (0.2, 0.4)  # of share and growth, about the uncorrected law: those six sensors
MAX_CHI2 = 9  # of the two parameters by that prior: beyond it, walls do not explain the error
MIN_COUNT = 3  # faces with a wall; fewer determine nothing
ALIKE_MM = 0.05  # mm: depths of one group within this of its shallowest count as one


@dataclass(frozen=True, slots=True)
class WallFace:
    """A certified face: `read_mm` in its map, and `hidden_mm` and `depth_mm` of its wall there (PunchEdge).

    Faces of one `group`, an indenter's, to one depth count as one.
    """

    group: str
    read_mm: float
    hidden_mm: float
    depth_mm: float
    certified_mm: float


def teach(faces: Sequence[WallFace]) -> TaughtWalls | None:
    """Return the wall's law by `faces`; None for fewer than MIN_COUNT walls, or for too large errors."""
    faces = [one for one in faces if all(0 < mm < np.inf for mm in _lengths_mm(one))]
    if len(faces) < MIN_COUNT:
        return None
    read, hidden, depth, certified = np.array([_lengths_mm(one) for one in faces]).T
    std = PLACE_STD * np.sqrt(_alike(faces))
    terms = np.stack([hidden, hidden * (depth / USUAL_MM - 1.0)]) / (read * std)
    covariance = np.linalg.inv(terms @ terms.T + np.diag(np.array(PRIOR_STD) ** -2.0))
    share, growth = covariance @ terms @ ((certified - read) / (read * std))
    if float(np.sum(np.square(np.array([share, growth]) / PRIOR_STD))) > MAX_CHI2:
        return None
    stated = (float(covariance[0, 0]), float(covariance[1, 1]), float(covariance[0, 1]))
    return TaughtWalls(float(share), float(growth), stated, (float(depth.min()), float(depth.max())), PLACE_STD)


def _lengths_mm(face: WallFace) -> tuple[float, float, float, float]:
    return face.read_mm, face.hidden_mm, face.depth_mm, face.certified_mm


def _alike(faces: Sequence[WallFace]) -> list[int]:
    """Return how many faces of the same group and a similar depth count as one with each face; (N,)."""
    begins: dict[int, tuple[str, float]] = {}
    last = ("", -np.inf)  # group and depth of the shallowest that counts as one with the face
    for k in sorted(range(len(faces)), key=lambda k: (faces[k].group, faces[k].certified_mm)):
        group, depth_mm = faces[k].group, faces[k].certified_mm
        last = last if group == last[0] and depth_mm - last[1] <= ALIKE_MM else (group, depth_mm)
        begins[k] = last
    count = Counter(begins.values())
    return [count[begins[k]] for k in range(len(faces))]
