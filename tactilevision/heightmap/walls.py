"""The steep wall around a flat punch: its law, the edge, and the depth that it hides."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from tactilevision.heightmap.circular_edges import CircularEdge, find_circular_edges, solved, window_of
from tactilevision.photometric.colour_change import Planes
from tactilevision.photometric.windows import Window
from tactilevision.records.certified import USUAL_MM, TaughtWalls
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bools, Floats, Pair

# The wall round one flat face: where it stands, how the surface falls along it, and what it hides of the step.
#
# And what walls of one sensor's pictures are found by.

LEAN = 2.1  # 1/tan of 25 degrees: lamps of these sensors stand at 15 to 35
LEAST_MM = 1e-6  # mm: smaller changes of depth are carried as this one


@dataclass(frozen=True, slots=True)
class WallLaw:
    """How walls are found: `limit` is the steepest slope that is read reliably; infinite, and there are none.

    `taught` by certified faces of the sensor.
    """

    limit: float
    taught: TaughtWalls | None = None


@dataclass(frozen=True, slots=True)
class PunchEdge:
    """The wall round one flat face.

    `centre_mm` from the middle of the picture's top left pixel; `radius_mm` of the edge; `reach_mm` from the edge
    within which slopes are replaced; `places_mm`, `fall_mm` (n,): distances from the edge, and how far the
    surface lies below the face there; `depth_mm` of the face over the gel at the profile's end, about;
    `missing_mm` what the slopes as read lack of the step, `std_mm` how far the step may be off.
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
        """How far the surface lies below the face where slopes are read again."""
        return float(np.interp(self.reach_mm, self.places_mm, self.fall_mm))

    @property
    def teachable(self) -> bool:
        """Whether it falls, and by more than the slopes as read: others stay as they are."""
        return self.fall_at_reach_mm > 0 and self.missing_mm > 0

    def carried(self, change_mm: float) -> Floats:
        """Part (n,) of a change of the face's depth at each of `places_mm`: 1 on it, 0 where slopes are read.

        It lies where the wall is steepest, over the slope T that leaves as much above it,

            |change| = int max(u' - T, 0) ds

        so that no wall overhangs that falls by more. What faces are off by lies there, less than .1 mm from the
        edge (docs/evidence/rendered.md); from there on the law is held by slopes that are read.
        """
        fall = np.interp(np.minimum(self.places_mm, self.reach_mm), self.places_mm, self.fall_mm)
        steps = np.maximum(np.diff(fall), 0.0)  # u' ds of even places
        sorted_steps = np.append(np.sort(steps)[::-1], 0.0)
        above = np.cumsum(sorted_steps) - sorted_steps * np.arange(1, sorted_steps.size + 1)
        over = np.maximum(steps - np.interp(max(abs(change_mm), LEAST_MM), above, sorted_steps), 0.0)
        return np.append(1.0, 1.0 - np.cumsum(over) / over.sum())

    def taught_by(self, walls: TaughtWalls) -> PunchEdge:
        """The wall with the depth that certified faces have it hide, mm; their deviation, where it is smaller."""
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


# The law by which the gel's surface falls away beside a flat punch, and the light that such a wall shows.
#
# Beside the sharp edge of a rigid flat face of radius a (s: distance from the edge)
#
#     u(s) = w - sum_k c_k U_k(s)      U_k' = a s^k / (r sqrt(r^2 - a^2)),  r = a + s,  k = 0, 1, 2
#
# k = 0 is Boussinesq's punch on a half-space; a layer, friction and large depth leave the root at the edge and
# change the smooth factor, which k = 1, 2 follow. The slope has no bound at the edge. A picture shows
#
#   h(seen slope) = <S(t)> / <C(t)>   t = arctan(u'), u blurred by the edge's rounding, < > blurred by the camera
#
# Light is blurred, not slope. A lamp that leans by L (1/tan of its elevation) gives max(0, cos t - L sin t cos f)
# to a wall whose foot points f away from it; round the whole rim that is
#
#     C = (cos t (pi - f0) + L sin t sin f0)/pi
#     S = (2/pi) (cos t sin f0/L + sin t ((pi - f0)/2 - sin(2 f0)/4))      cos f0 = min(1, 1/(L tan t)),  h = S/C
#
# sin t and cos t as long as no lamp is turned away from, L tan t < 1, and half the slope of a steep wall beyond:
# attached shadows. Assumes small slopes but for the light; what large ones add at the edge is steep_edges.py's.
# Source: Johnson, Contact Mechanics (1985), eq. 3.38 (k = 0).

CAMERA_PX = (0.8, 0.5)  # px: usual blur of the camera, and the spread of its logarithm
EDGE_PX = (0.5, 0.8)  # px: usual blur by the edge's rounding, and the spread of its logarithm
FINE = 0.25  # px: grid of the law
MAX_ITERATIONS = 8  # steps of the fit, at most: a frame has little time
DAMPING = 1e-3  # of the normal equations' diagonal, the least that a step is damped by
EACH = np.arange(6)  # the unknowns' places on a diagonal
# squares of deviations by which a last step would still lessen what is left: a seventh of one deviation
CONVERGENCE_TOL = 0.02
STEEPEST = 8.0  # slope to which light is tabled: steeper walls differ by less than a hundredth
MIN_RATE = 0.02  # of h: walls so steep look alike
TABLED = 801  # slopes in the table: finer ones change no depth by .1 um


@dataclass(frozen=True, eq=False)
class WallLight:
    """S, C and their rates dS/du, dC/du (n,) at `slopes` u (n,), and h = S/C with its rate; all without unit."""

    slopes: Floats
    sine: Floats
    cosine: Floats
    sine_rate: Floats
    cosine_rate: Floats
    seen: Floats
    seen_rate: Floats


@lru_cache
def wall_light(lean: float) -> WallLight:
    """The light round a wall under lamps of this lean, tabled over its slope."""
    u = np.linspace(0.0, STEEPEST, TABLED)
    t = np.arctan(u)
    away = np.arccos(np.minimum(1.0, 1.0 / np.maximum(lean * u, 1e-9)))
    cosine = (np.cos(t) * (np.pi - away) + lean * np.sin(t) * np.sin(away)) / np.pi
    part = 0.5 * (np.pi - away) - 0.25 * np.sin(2.0 * away)
    sine = 2.0 / np.pi * (np.cos(t) * np.sin(away) / lean + np.sin(t) * part)
    seen = np.maximum.accumulate(sine / cosine) + 1e-9 * np.arange(u.size)
    return WallLight(u, sine, cosine, np.gradient(sine, u), np.gradient(cosine, u), seen, np.gradient(seen, u))


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
        """The unknowns (6,) that `slopes` (n,) seen with deviations `std` make likeliest; their covariance.

        And how many deviations (n,) the law lies off the slopes. Damped Gauss-Newton from the usual blur and the
        half-space's law through what lies outside.
        """
        rate = np.interp(self.s, self.places, self.rates[0]) * (self.s > 3 * self.px)
        start = np.array([0.0, np.log(EDGE_PX[0] * self.px), np.log(CAMERA_PX[0] * self.px),
                          float(rate @ slopes / (rate @ rate)), 0.0, 0.0])  # fmt: skip
        bend = 3 * start[3] / self.radius_mm
        prior = np.array([2 * self.px, EDGE_PX[1], CAMERA_PX[1], 10 * start[3], bend, bend / self.radius_mm]) ** -2

        def misfit(unknown: Floats) -> tuple[float, Floats, Floats, Floats]:
            """Squares that are left, half their gradient (6,), normal equations (6, 6), and deviations (n,)."""
            predicted, rates = self._shown(unknown)
            off, aside = (predicted - slopes) / std, unknown - start
            rates /= std
            uphill, normal = rates @ off + prior * aside, rates @ rates.T
            normal[EACH, EACH] += prior
            return float(off @ off + prior @ aside**2), uphill, normal, off

        unknown, damping = start, DAMPING
        squares, uphill, normal, off = misfit(unknown)
        for _ in range(MAX_ITERATIONS):
            if uphill @ solved(normal, uphill) < CONVERGENCE_TOL:
                break
            for _ in range(5):
                trial = unknown - solved(normal * (1.0 + damping * np.eye(6)), uphill)
                after = misfit(trial)
                if after[0] < squares:
                    break
                damping *= 30.0
            else:
                break
            unknown, (squares, uphill, normal, off), damping = trial, after, max(0.1 * damping, DAMPING)
        return unknown, np.asarray(cv2.invert(normal)[1]), off

    def falls(self, unknown: Floats, s: float) -> tuple[Floats, float, Floats]:
        """Falls at the grid's edges from the shifted edge on, the one at `s`, and its rates (6,) by unknown."""
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
        """A step of 1 at the edge, blurred as the edge is, at the grid's edges (n,)."""
        return np.asarray(_blur((self.edges > 0)[None].astype(float), np.exp(unknown[1]) / self.step)[0])

    def _shown(self, unknown: Floats) -> tuple[Floats, Floats]:
        """Slopes (n,) that the picture shows at the bins, and their rates (6, n) by unknown.

        A Gaussian's blur diffuses: what the log of its sigma adds is sigma^2 times the second derivative.
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
    """Lines (K, n) blurred by `sigma` of their steps."""
    sigma = min(max(sigma, 0.3), 0.25 * rows.shape[1])  # a step of the fit may stray
    size = round(8.0 * sigma + 1.0) | 1
    return np.asarray(cv2.GaussianBlur(rows, (size, 1), sigma, borderType=cv2.BORDER_REPLICATE))


# Walls too steep to read: what a flat punch's edge hides of the depth, out of the gel beside it.
#
# Beside the edge of a rigid flat face the gel's surface falls away by the wall's law. For two or three pixels it
# is steeper than any ball showed, colours saturate, and a quarter of a deep face's height hides there. Slopes
# farther out, and those at the foot of the blurred wall inside, are gentle and well read. They fix the law's
# unknowns, and the law carries the depth through. On a path tracer's faces of .3 to .6 mm (light passing through
# the punch) this brought depths from .77-.98 of the truth to .86-1.04.
#
# What no slope farther out tells is the edge itself: finite strain makes the wall steeper there than the law of
# small slopes. By finite elements, shown in the same light, the law carries less than the face's depth w by
#
#     D = EDGE_FALL (w^2/a) sqrt(px/a)        px: mm of a pixel
#
# which is added at the edge: 1.4 for EDGE_FALL where the surface follows the punch's edge, .3 where ink rounds it
# over .03 mm. The value here lies between; the deviation holds both (benchmarks/steep_edges.py: neo-Hooke, nu .40
# to .499, a/h .5 to 1, w/h to .2, friction .15 to .6, edges of h/60 to h/30, pixels of .045 to .095 mm). A camera
# blurs even a steep wall where it is narrow: faces of 3 to 8 % of the thickness may lose 3 to 9 % of their depth.
#
# A cast shadow beside the wall looks like slope, and a law through it may double a face's depth. It bends
# otherwise than the law, so walls that the slopes outside do not keep to are left as they are: faces of .3 to .55
# mm beside shadows then read .96 to 1.00 of their depth, where the law made 1.3 to 2.5 of it. Since walls are read
# too gentle, a law that makes less of a wall than was read is raised to what was read.
#
# Only round rims with a sharp inner flank are treated so: the slopes of balls, cones and ridges grow gently and
# are left alone. Assumes a flat face, at least a third of whose rim is in the picture.

FOOT_PX = 6.0  # px inside the edge from which slopes are read
FAR = (
    0.4  # of the radius outside the edge, to which slopes are read; farther where a wall hides more than its half
)
HIDDEN_SHARE = 0.5  # of that, which a wall may hide: what lies behind more is no longer told by the rest
SLOPE_ERROR = 0.03  # of the mean slope round the edge: its relative deviation
SLOPE_FLOOR = 0.01  # mm/mm: deviation of the mean slope round the edge where it is gentle
# mean square, in stated deviations, that slopes outside may lie off the law, and where the wall hides more than
# half of FAR: punches' own .0 to .2, a path tracer's .35 without shadows; next to shadows .4 to 2
MAX_MISFIT = (0.45, 0.3)
EDGE_FALL = 0.8  # of what the edge adds: benchmarks/steep_edges.py
EDGE_FALL_STD = 1.0  # of it: what ink, frictions and edges differ by
MIN_READ = 8  # bins outside the edge that can be read; with fewer it is not fitted
MIN_FACE = 50  # pixels of a face; with fewer it counts as not known


def find_punch_edges(slopes: SlopeMap, mm_per_px: Pair, *, law: WallLaw) -> list[PunchEdge]:
    """The walls round flat faces in `slopes` (H, W)."""
    edges = [
        fit_edge(circle, law, px=min(mm_per_px))
        for circle in find_circular_edges(slopes, mm_per_px, limit=law.limit)
    ]
    return [edge if law.taught is None else edge.taught_by(law.taught) for edge in edges if edge is not None]


def restore(slopes: SlopeMap, edges: list[PunchEdge], *, mm_per_px: Pair) -> None:
    """Put the law's slopes in place of those (H, W) that the walls hide, in place.

    Along the rim nothing slopes but what the face's own tilt t, gentle and well read, makes of a rigid face:
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
    """Mean slope u' within `half` of the wall's places (n,), and 1 - u/w there."""
    below, above = (np.interp(edge.places_mm + d, edge.places_mm, edge.fall_mm) for d in (half, -half))
    return (above - below) / (2 * half), 1.0 - 0.5 * (above + below) / edge.depth_mm


def _interpolated(lines: tuple[Floats, Floats], at: Floats) -> tuple[Floats, Floats]:
    """What two lines (n,) say at `at` (m,), counted in their steps."""
    i = at.astype(np.int32)
    at -= i
    np.minimum(i, len(lines[0]) - 2, out=i)
    steep, remaining = (line.take(i) + at * np.diff(line).take(i) for line in lines)
    return steep, remaining


def restore_windows(
    fine: Sequence[Planes],
    windows: Sequence[Window],
    *,
    valid: Bools,
    mm_per_px: Pair,
    law: WallLaw,
) -> list[PunchEdge]:
    """The walls found and restored, in place, in slopes (2, rows, columns) for each window of a picture."""
    edges = []
    for window, (p, q) in zip(windows, fine, strict=True):
        slopes = SlopeMap(p, q, valid[window])
        restored = find_punch_edges(slopes, mm_per_px, law=law)
        restore(slopes, restored, mm_per_px=mm_per_px)
        top, left = (side.start * step for side, step in zip(window, mm_per_px[::-1], strict=True))
        edges += [
            replace(edge, centre_mm=(edge.centre_mm[0] + left, edge.centre_mm[1] + top)) for edge in restored
        ]
    return edges


def fit_edge(edge: CircularEdge, walls: WallLaw, *, px: float) -> PunchEdge | None:
    """The law through the gentle slopes beside a wall; None where too few of them are seen."""
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
    inner = -3.0 * float(np.hypot(*np.exp(unknown[1:3])))
    steps = np.where(known & (s > inner + shift), mean, 0.0) * (s[1] - s[0])  # mm
    within = np.clip((reach - s) / (s[1] - s[0]) + 0.5, 0.0, 1.0)  # a bin across the reach counts by its part
    read, beyond = float(steps @ within), float(steps @ (1.0 - within))
    added = EDGE_FALL * max(fall + beyond, 0.0) ** 2 * px**0.5 / edge.radius_mm**1.5
    falls, fall = falls + added * law.step_at_edge(unknown), fall + added
    if 0.0 < fall < read:  # slopes of walls are read too gentle: a law that takes depth away saw a shadow as gel
        falls, fall = falls * (read / fall), read
    elif fall <= 0.0 < read:
        return None
    table = slice(*np.searchsorted(law.edges, (inner, reach - shift + 2 * px)))
    if len(law.edges[table]) < 2 or not edge.radius_mm + shift > 0:  # the edge ran off the wall: no law of it
        return None
    own = float(np.sqrt(rate @ covariance @ rate + (with_edge * edge.uneven_mm) ** 2))
    return PunchEdge(edge.centre_mm, edge.radius_mm + shift, reach - shift, law.edges[table], falls[table],
                fall + beyond, fall - read, float(np.hypot(own, EDGE_FALL_STD * added)))  # fmt: skip


# The wall's law as certified faces of the same sensor teach it.
#
# The depth that the law of steep walls finds hidden is off by a part of itself, which grows with
# the depth and differs from sensor to sensor. Its two numbers come from certified faces, by ridge towards no
# change:
#
#     certified - read = hidden (share + growth (w/w0 - 1)) + noise     records/certified.py
#
# noise: PLACE_STD of the depth, by which faces of one sensor differ from place to place. Presses of one indenter
# to one depth mostly share their place, so together they count as one, wherever they were.

PLACE_STD = 0.03  # of the depth: faces of one sensor about their law, six of the path tracer; benchmarks.rendered
PRIOR_STD = (0.2, 0.4)  # of share and growth, about today's law: those six sensors
MAX_CHI2 = 9.0  # of the two numbers by that prior: beyond, it is not walls that are off
MIN_COUNT = 3  # faces with a wall; fewer teach nothing
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
    """What `faces` say of the wall's law; None for fewer than MIN_COUNT with a wall, or for more than walls do."""
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
    """How many of the faces count as one with each: of its group, and about as deep; (N,)."""
    begins: dict[int, tuple[str, float]] = {}
    last = ("", -np.inf)  # group and depth of the shallowest that counts as one with the face
    for k in sorted(range(len(faces)), key=lambda k: (faces[k].group, faces[k].certified_mm)):
        group, depth_mm = faces[k].group, faces[k].certified_mm
        last = last if group == last[0] and depth_mm - last[1] <= ALIKE_MM else (group, depth_mm)
        begins[k] = last
    count = Counter(begins.values())
    return [count[begins[k]] for k in range(len(faces))]
