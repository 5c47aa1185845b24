"""The law by which the gel's surface falls away beside a flat punch, and the light that such a wall shows.

Beside the sharp edge of a rigid flat face of radius a (s: distance from the edge)

    u(s) = w - sum_k c_k U_k(s)      U_k' = a s^k / (r sqrt(r^2 - a^2)),  r = a + s,  k = 0, 1, 2

k = 0 is Boussinesq's punch on a half-space; a layer, friction and large depth leave the root at the edge and
change the smooth factor, which k = 1, 2 follow. The slope has no bound at the edge. A picture shows

    h(seen slope) = <S(t)> / <C(t)>     t = arctan(u'), u blurred by the edge's rounding, < > blurred by the camera

Light is blurred, not slope. A lamp that leans by L (1/tan of its elevation) gives max(0, cos t - L sin t cos f) to
a wall whose foot points f away from it; round the whole rim that is

    C = (cos t (pi - f0) + L sin t sin f0)/pi
    S = (2/pi) (cos t sin f0/L + sin t ((pi - f0)/2 - sin(2 f0)/4))      cos f0 = min(1, 1/(L tan t)),  h = S/C

sin t and cos t as long as no lamp is turned away from, L tan t < 1, and half the slope of a steep wall beyond:
attached shadows. Assumes small slopes but for the light; what large ones add at the edge is steep_edges.py's.
Source: Johnson, Contact Mechanics (1985), eq. 3.38 (k = 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np

from tactilevision.compiled import compiled
from tactilevision.integration.circle import solved
from tactilevision.records import Floats

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

    @cached_property
    def lines(self) -> Floats:
        """S, C, their rates, h and its rate, (6, n), as kernels take them."""
        return np.stack([self.sine, self.cosine, self.sine_rate, self.cosine_rate, self.seen, self.seen_rate])


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
        if compiled():
            from tactilevision.integration.wall_kernels import fitted

            law = self.places[0], self.step, self.rates, STEEPEST / (TABLED - 1), self.light.lines, MIN_RATE
            limits = DAMPING, CONVERGENCE_TOL, MAX_ITERATIONS
            unknown, normal, off = fitted(start, prior, self.s, slopes, std, *law, *limits)
            return unknown, np.asarray(cv2.invert(normal)[1]), off

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
