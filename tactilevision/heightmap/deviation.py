"""The standard deviation of a depth, pixel by pixel, as a sum of independent variance terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from tactilevision.heightmap.ball_validation import scale_is_assumed
from tactilevision.heightmap.poisson import integrate
from tactilevision.heightmap.walls import PunchEdge, window_of
from tactilevision.heightmap.zero_plane import USUAL_THICKNESS_MM, ZeroPlane, plane_terms
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.colour_change import Patch
from tactilevision.photometric.drift import SOFTENING_GREY, block_means, shares
from tactilevision.photometric.method import CalibratedMethod, SlopeReading
from tactilevision.records.maps import HeightMap, SlopeMap
from tactilevision.records.measured import Array, Bools, Floats, Pair, Picture
from tactilevision.records.rig import SHADOW_ZONE

# The uncertainty of a depth, pixel by pixel: `HeightMap.std_mm`.
#
#   std^2 = scale + missing colour + free gel + zero plane + illumination + steep edges + cast shadow
#           + steep slope + inconsistent light
#
# The sum is computed on a grid, as all but edges is smooth.

GRID_MM = 0.18  # mm, approximate step of the grid: finer than the deviation varies, except at edges
# of the greatest depth: what too steep slopes may hide before a map says so; calibrated balls stay below .1
MAX_HIDDEN_SHARE = 0.2
MAX_EXTRAPOLATED = 0.05  # of the depth, by lying beyond the balls; real sets' own balls have .01 (real_frames.md)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The surface of one picture before its deviation is known: `depth_mm` (H, W), from its `zero` plane.

    `walls` were restored in the slopes of its `reading`.
    """

    depth_mm: Array
    zero: ZeroPlane
    walls: Sequence[PunchEdge]
    reading: SlopeReading

    @property
    def residuals(self) -> Pair:
        """Return misfit of the picture's light (no unit), and deviation of the zero plane in mm."""
        frame = self.reading.frame
        return (frame.drift.misfit if frame else 0.0), self.zero.std_mm


class DepthError:
    """Standard deviation of the depths by one method; quantities of the place alone are computed once.

    `free_mm2`, `gain_square` (h, w) of the grid: variance of free gel in mm², and of the depth scale, relative.
    """

    def __init__(self, method: CalibratedMethod, mm_per_px: Pair) -> None:
        self.method, self.mm_per_px, self.shape = method, mm_per_px, method.reference.shape
        card = method.card
        self.assumed = scale_is_assumed(card)
        share = ASSUMED_STEEP_SHARE if self.assumed else STEEP_SHARE
        self.steepest = share * (np.inf if card.steepest_slope is None else card.steepest_slope)
        every = self.every = max(2, round(GRID_MM / max(mm_per_px)))
        self.step_mm = every * mm_per_px[0], every * mm_per_px[1]
        noise = noise_variance(
            method.noise * np.float32(1.0 if card.frame_noise is None else card.frame_noise), mm_per_px
        )
        waves_mm = card.untouched_depth_rms_mm or 0.0
        free = free_variance(noise, waves_mm, untouched_std=np.array(card.untouched_std_mm or [[0.0]], np.float32))
        self.noise_mm2, self.free_mm2 = (whole[::every, ::every].copy() for whole in (noise, free))
        self.gain_square = gain_variance(card, method.relative_error, shape=self.free_mm2.shape)
        self.extrapolates = card.extrapolated_gain_std is not None
        beyond = np.asarray(extrapolated_gain_std(card), np.float32)
        self.extrapolated_std: Picture = np.asarray(cv2.resize(beyond, self.free_mm2.shape[::-1]))
        self._in_pixels: dict[tuple[int, ...], list[Picture]] = {}

    def std_mm(self, surface: Surface, unexplained_mm: Picture | None = None) -> Picture:
        """Return the standard deviation (H, W) mm of the depth of a `surface`.

        `unexplained_mm` (h, w) is the depth by slopes that the light does not explain
        (heightmap/inconsistent_light.py), None where there is none.
        """
        total, *others = self._variances(surface, unexplained_mm).values()
        for variance in others:
            if variance is not None:
                total += variance
        cv2.sqrt(total, dst=total)
        return np.asarray(cv2.resize(total, self.shape[::-1], interpolation=cv2.INTER_LINEAR))

    def terms_mm(self, surface: Surface, unexplained_mm: Picture | None = None) -> dict[str, Picture]:
        """Return the deviation (h, w) mm by each term; their squares sum to the square of `std_mm`.

        On the grid of every `every`th pixel. Not for every frame: it takes as long as the sum again.
        """
        found = self._variances(surface, unexplained_mm)
        scale = found["depth scale"]
        parts = found | {
            "slope noise": self.noise_mm2,
            "untouched gel": self.free_mm2 - self.noise_mm2,
        }
        return {name: np.zeros_like(scale) if one is None else np.sqrt(one) for name, one in parts.items()}

    def _variances(self, surface: Surface, unexplained_mm: Picture | None) -> dict[str, Any]:
        """Return the variances (h, w) mm² by term, None for none."""
        few = self._on_grid(surface.depth_mm)
        scale = scale_variance(few, self.gain_square)
        walls: Any = (None, None)
        if surface.walls:
            walls = wall_variances(few.shape, surface.walls, mm_per_point=self.step_mm)
        hidden_mm = self._hidden_mm(few, surface)
        return {
            "depth scale": scale,
            "missing colour": self._lost(few, surface.reading.lost_share),
            "slope noise": None,  # within the next term
            "untouched gel": self.free_mm2,
            "zero plane": zero_variance(surface.zero, few.shape),
            "illumination": self._light(surface, few.shape),
            "steep edge": walls[0],
            "cast shadow": walls[1],
            "steep slope": np.float32(hidden_mm**2) * (few > BEHIND * few.max()) if hidden_mm > 0 else None,
            "inconsistent light": None
            if unexplained_mm is None
            else np.square(cv2.resize(unexplained_mm, few.shape[::-1], interpolation=cv2.INTER_LINEAR)),
        }

    def in_pixels(self, shape: tuple[int, ...]) -> list[Picture]:
        """Return `gain_square` and `free_mm2`, (H, W) each, for a map of `shape`: cached, not to be modified."""
        if shape not in self._in_pixels:
            grids = (self.gain_square, self.free_mm2)
            self._in_pixels[shape] = [np.asarray(cv2.resize(grid, shape[::-1])) for grid in grids]
        return self._in_pixels[shape]

    @cached_property
    def untouched_std_mm(self) -> Picture:
        """Return the deviation (H, W) mm of untouched gel, a part of `std_mm`: not to be modified."""
        return np.asarray(cv2.resize(np.sqrt(self.free_mm2), self.shape[::-1], interpolation=cv2.INTER_LINEAR))

    @cached_property
    def drift(self) -> DriftError:
        """Return the response of depth to the drift of the light."""
        return DriftError(self.method, self.mm_per_px)

    def hides_much(self, surface: Surface) -> bool:
        """Return whether too steep slopes may hide a good part of the greatest depth of a `surface`."""
        few = self._on_grid(surface.depth_mm)
        return self._hidden_mm(few, surface) > MAX_HIDDEN_SHARE * float(few.max())

    def beyond_balls(self, contact: Bools) -> bool:
        """Return whether the depth of a `contact` is extrapolated beyond the balls, in the mean over it.

        `contact` is a mask (h, w) of the whole picture, of any resolution.
        """
        if not self.extrapolates:
            return False
        (high, wide), size = contact.shape, self.extrapolated_std.shape[::-1]
        left, top, across, down = cv2.boundingRect(np.asarray(contact, np.uint8))
        rows = slice(top * size[1] // high, -(-(top + down) * size[1] // high))
        columns = slice(left * size[0] // wide, -(-(left + across) * size[0] // wide))
        if self.extrapolated_std[rows, columns].max(initial=0.0) <= MAX_EXTRAPOLATED:
            return False  # no mean over these blocks is greater
        share = block_means(contact, size)
        covered = float(share.sum())
        return covered > 0.0 and float(np.vdot(self.extrapolated_std, share)) > MAX_EXTRAPOLATED * covered

    def _on_grid(self, depth_mm: Array) -> Picture:
        return np.array(depth_mm[:: self.every, :: self.every], np.float32)

    def _lost(self, few: Picture, lost_share: Patch | None) -> Picture | None:
        if lost_share is None:
            return None
        share = _thinned(lost_share, self.shape, few.shape)
        return missing_colour_variance(few, share, every=self.every, mm_per_px=self.mm_per_px)

    def _light(self, surface: Surface, shape: tuple[int, ...]) -> Picture | None:
        covariance = surface.reading.frame.drift.covariance if surface.reading.frame else None
        if covariance is None:
            return None
        blocks = self.drift.variance(covariance, surface.zero)
        return np.asarray(cv2.resize(blocks, shape[::-1], interpolation=cv2.INTER_LINEAR))

    def _hidden_mm(self, few: Picture, surface: Surface) -> float:
        reading = surface.reading
        if surface.walls or not reading.steepest > self.steepest:
            return 0.0
        at: Any = {"steepest": self.steepest, "every": self.every, "mm_per_px": self.mm_per_px}
        return hidden_step_mm(few, reading.slopes, sharp=self.assumed, **at)


def _thinned(patch: Patch, shape: tuple[int, int], size: tuple[int, ...]) -> Picture:
    """Return means over blocks (h, w) of a picture of `shape` (H, W) that is 0 outside a `patch`."""
    out = np.zeros(size, np.float32)
    down, across = (shares(count, blocks) for count, blocks in zip(shape, size, strict=True))
    rows, columns = (
        slice(along.start * blocks // count, -(-along.stop * blocks // count))
        for along, count, blocks in zip(patch.window, shape, size, strict=True)
    )
    out[rows, columns] = down[rows, patch.window[0]] @ (patch.values @ across[columns, patch.window[1]].T)
    return out


def contributions_mm(height: HeightMap, terms: Mapping[str, Picture]) -> dict[str, float]:
    """Return the rms in mm of each of the `terms` (h, w) mm where a `height` map exceeds half its depth."""
    depth = np.asarray(height.depth_mm, np.float32)
    size = next(iter(terms.values())).shape[::-1] if terms else (1, 1)
    few = np.asarray(cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST))
    deep = few > 0.5 * few.max()
    return {name: float(np.sqrt(np.mean(np.square(term[deep])))) for name, term in terms.items()}


# The term of the photometric scale: all depths have the relative error g.
#
#     variance(x, y) = g(x, y)^2 depth(x, y)^2          g^2 = g_seen^2 + g_place(x, y)^2 + g_beyond(x, y)^2
#
# g_seen: scatter of the scale over the calibration's balls, common to all maps. g_place: local change of the scale
# with other balls (photometric/cross_validation.py). g_beyond: extrapolation beyond the outermost balls
# (photometric/cross_validation.py). All are in the method's card; older cards lack the last. Vanishes where the
# depth is 0, and where every ball gives one scale. Assumes errors proportional to the slope.


def scale_variance(depth_mm: Picture, gain_square: Picture) -> Picture:
    """Return the scale's variance (h, w) mm² of `depth_mm` (h, w), of relative variance `gain_square` (h, w)."""
    square = cv2.multiply(depth_mm, depth_mm)
    square *= gain_square
    return np.asarray(square)


def gain_variance(card: MethodCard, relative_error: float, *, shape: tuple[int, ...]) -> Picture:
    """Return the relative variance of the depth scale over a picture of `shape` (h, w) from a method's card."""
    squares = place_gain_std(card, relative_error) ** 2, extrapolated_gain_std(card) ** 2
    place, beyond = (np.asarray(cv2.resize(np.asarray(one, np.float32), shape[::-1])) for one in squares)
    return np.asarray(place + beyond)


def extrapolated_gain_std(card: MethodCard) -> Floats:
    """Return the deviation (h, w) of the depth scale beyond the balls, a ratio; 0 where the card has none."""
    return np.array(card.extrapolated_gain_std or [[0.0]], np.float64)


def place_gain_std(card: MethodCard, relative_error: float) -> Floats:
    """Return the relative deviation (h, w) of the depth scale within the range of the balls."""
    return np.hypot(gain_std(card, relative_error), np.array(card.place_gain_std or [[0.0]], np.float64))


def gain_std(card: MethodCard, relative_error: float) -> float:
    """Return the relative deviation of the depth scale from ball to ball, common to all maps; else that of slopes.

    A card without the change by other balls includes it here, from held-out balls.
    """
    held_out = relative_error if card.held_out_gain_std is None else card.held_out_gain_std
    if card.seen_gain_std is None:
        return held_out
    seen = card.seen_gain_std
    return seen if card.place_gain_std is not None else float(np.sqrt(seen * (held_out + seen)))


# The term of missing colours: slopes from two colours have larger errors, and so has the depth.
#
#     variance(x, y) = < e >^2 max(depth^2, < depth^2 >)      < >: means over REACH_MM, and over a thickness of gel
#
# e: relative error of a slope without that colour in excess of a slope by all colours, 0 where all are valid
# (photometric/methods/two_colours.py). A few pixels without a colour hardly change the integral over them; the
# error of many spreads to the gel around them.
# Vanishes where all colours are valid, and where the depth is 0. Assumes errors proportional to the slope.

COARSE = 4  # points per thickness of gel on which the smooth mean is taken
BLUR = 4  # deviations at which OpenCV truncates a blur
REACH_MM = 1.0  # mm, correlation length of integrated slope errors: half of a usual contact


def missing_colour_variance(depth_mm: Picture, lost_share: Picture, *, every: int, mm_per_px: Pair) -> Picture:
    """Return the variance (h, w) mm² of `depth_mm` (h, w) mm; `lost_share` (h, w) is e, a ratio.

    Both hold every `every`th pixel of a picture at `mm_per_px` (x, y).
    """
    reach = [REACH_MM / (every * px) for px in mm_per_px]
    left, top, width, height = cv2.boundingRect(cv2.compare(lost_share, 0.0, cv2.CMP_NE))
    down, across = (int(BLUR * one) + 2 for one in reach[::-1])  # as far as the blur carries anything
    rows = slice(max(top - down, 0), top + height + down)
    columns = slice(max(left - across, 0), left + width + across)
    share = cv2.GaussianBlur(lost_share[rows, columns], (0, 0), reach[0], sigmaY=reach[1])
    square = np.square(depth_mm)
    square = cv2.max(_nearby_mean(square, every=every, mm_per_px=mm_per_px), square)
    variance = np.zeros(depth_mm.shape, np.float32)
    np.multiply(np.square(share), square[rows, columns], out=variance[rows, columns])
    return variance


def _nearby_mean(square: Picture, *, every: int, mm_per_px: Pair) -> Picture:
    """Return the mean (h, w) of values (h, w), every `every`th pixel, over a thickness of gel."""
    step = max(1, round(USUAL_THICKNESS_MM / (COARSE * every * max(mm_per_px))))
    reach = [USUAL_THICKNESS_MM / (step * every * px) for px in mm_per_px]
    coarse = cv2.GaussianBlur(square[::step, ::step], (0, 0), reach[0], sigmaY=reach[1])
    return np.asarray(cv2.resize(coarse, square.shape[::-1], interpolation=cv2.INTER_LINEAR))


# The term of the camera's noise: the depth noise that pixel noise of the slopes causes.
#
#     variance(x, y) = < (z - median z)^2 >      z: the surface of random slopes N(0, noise(x, y)^2)
#
# z is integrated as every surface; the mean over N_DRAWS fields is blurred to reduce its scatter.
# Vanishes with the noise, and grows with its square. Assumes noise that is independent from pixel to pixel:
# correlated waves have a term of their own. It depends on the place alone, so it is computed once for a method.

N_DRAWS = 6  # noise fields: with the blur they determine the variance to a tenth
BLUR_SHARE = 1 / 12  # of the picture's longer side: sigma of the blur; noise of a surface varies no faster


def noise_variance(noise: Picture, mm_per_px: Pair) -> Picture:
    """Return the variance (H, W) mm² of depth by slope noise `noise` (H, W) mm/mm, at `mm_per_px` (x, y)."""
    rng = np.random.default_rng(0)  # fixed seed: the certificate of a method is reproducible
    total = np.zeros(noise.shape, np.float32)
    for _ in range(N_DRAWS):
        fields = rng.standard_normal((2, *noise.shape), dtype=np.float32) * noise
        surface = integrate(SlopeMap(fields[0], fields[1]), mm_per_px)
        total += (surface - np.median(surface)) ** 2
    return np.asarray(cv2.GaussianBlur(total / N_DRAWS, (0, 0), max(noise.shape) * BLUR_SHARE), np.float32)


# The term of the untouched gel: its deviation from flat in excess of the simulated noise.
#
#     variance(x, y) = max(noise^2 + waves^2, untouched(x, y)^2) - noise^2
#
# waves: rms depth of untouched gel in the calibration's pictures, used without frames of the free gel.
# untouched: local deviation in single frames of the free gel. Their noise is correlated over many pixels (blur,
# compression). Integrated, it has slow waves of several times the effect of independent noise, most in dark
# corners. Vanishes where free frames are read as flat. Assumes that the gel's noise does not change later.


def free_variance(noise_mm2: Picture, waves_mm: float, *, untouched_std: Floats) -> Picture:
    """Return the variance (H, W) mm² of free gel: this term plus that of noise, `noise_mm2` (H, W) mm².

    `waves_mm` is one deviation for all places, `untouched_std` (h, w) mm one for each block.
    """
    variance = noise_mm2 + np.float32(waves_mm**2)
    blocks = np.asarray(untouched_std, np.float32)
    untouched = cv2.resize(blocks, variance.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.maximum(variance, untouched**2))


# The term of the zero plane: the untouched gel determines depth 0, limited by the gel's flatness.
#
#     variance = std_0^2 + (std_x X)^2 + (std_y Y)^2      X and Y from -1 to 1 over the picture
#
# std_0 of the plane at the picture's centre and std_x, std_y of its tilt are those of the fit
# (heightmap/zero_plane.py), with errors correlated over a tenth of the picture. Vanishes where untouched blocks
# all lie in one plane. The covariance of offset and tilt is neglected: it is zero for evenly distributed blocks.


def zero_variance(zero: ZeroPlane, shape: tuple[int, ...]) -> Picture:
    """Return the variance (H, W) mm² by the plane `zero` over a picture of this `shape`."""
    sides = zip(zero.tilt_std_mm, shape[::-1], strict=True)
    x, y = ((std * np.linspace(-1, 1, count)) ** 2 for std, count in sides)
    return np.asarray(y[:, None] + (x + zero.std_mm**2), dtype=np.float32)


# The term of the light's drift: the depth error by the uncertainty of the drift.
#
# An error of a drift coefficient g_k (photometric/drift.py) changes the colours of the whole picture, and the
# surface smoothly by D_k(x, y). The zero plane removes the plane component on the untouched gel,
#
#     variance(x, y) = D' C D'        D'_k = D_k - plane of D_k      C: covariance of the coefficients
#
# so that the term is small outside small contacts, and large under contacts with little untouched gel to separate
# drift from slopes. Vanishes without drift, and where D_k is a plane. D_k is computed once, for colours of flat
# gel.

STEP = 0.01  # of a coefficient: laws are linear over it to a hundredth


class DriftError:
    """Response of one method's depths to its drift coefficients; computed once, on the drift's blocks."""

    def __init__(self, method: CalibratedMethod, mm_per_px: Pair) -> None:
        tracker, shape = method.change.tracker, method.reference.shape
        self.blocks = (tracker.size[1], tracker.size[0])
        self.terms = plane_terms(shape, self.blocks)
        kept_share = block_means(method.kept_share, tracker.size)
        evaluate = method.law.evaluator(self.blocks)
        across, down = (n * mm / few for n, mm, few in zip(shape[::-1], mm_per_px, tracker.size, strict=True))
        effects = tracker.effects / (tracker.level + SOFTENING_GREY)[:, None, :]
        depths = np.zeros(effects.shape)
        for channel, parts in enumerate(effects):
            for number, part in enumerate(parts):
                change = np.zeros((3, *self.blocks), np.float32)
                change[channel] = STEP * part.reshape(self.blocks)
                dz_dx, dz_dy = (
                    kept_share * (more - less) / (2.0 * STEP)
                    for more, less in zip(evaluate(change), evaluate(-change), strict=True)
                )
                depths[channel, number] = integrate(SlopeMap(dz_dx, dz_dy), (across, down)).ravel()

        self.depths = depths.reshape(-1, len(tracker.basis))  # of all coefficients, channel by channel

    def variance(self, covariance: Floats, zero: ZeroPlane) -> Picture:
        """Return the variance (rows, columns) mm² of depth on the blocks, by a drift's `covariance` (18, 18)."""
        depths = self.depths
        if zero.takes is not None:
            depths = depths - (depths @ zero.takes.T) @ self.terms
        return np.asarray(np.sum(depths * (covariance @ depths), axis=0), np.float32).reshape(self.blocks)


# The terms of walls: a restored edge adds a step by the wall's law; gel near a steep wall may lie in the shadow of
# a lamp, and then reads as too steep.
#
#     variance(r) = std_e^2                            r < a
#     variance(r) = (s (u(K w) - u(r - a)))^2          r < a + K w;  K = 1/tan(elevation of the lowest lamp)
#
# std_e: of the step, from the fit of the law to the slopes around it (heightmap/walls.py); u: the surface's fall
# below the face by that law, from where slopes are read again outwards; w, a: depth and radius of the face; K:
# records/rig.py. An error of the fall in a shadow affects the face, too. s: rms relative error of that fall
# (renderings with lamps at 15 to 35 degrees read 1.05 to 1.47 of it). Vanish without restored edges, with the
# error of the fit, and beyond the shadow, which of a gentle wall ends where slopes are replaced. Assume round
# edges of a rigid flat face.

SHADED_FALL_STD = 0.3  # of the fall
SHADOW_REACH = SHADOW_ZONE.reach


def shades(edge: PunchEdge) -> bool:
    """Return whether the shadow of a wall may reach gel whose slopes are read."""
    return SHADOW_REACH * edge.depth_mm > edge.reach_mm


def wall_variances(shape: tuple[int, ...], edges: Sequence[PunchEdge], *, mm_per_point: Pair) -> Picture:
    """Return the variances (2, h, w) mm² by the steps of `edges` and by their shadows.

    The points are spaced `mm_per_point` (x, y) mm.
    """
    variances: Picture = np.zeros((2, *shape), np.float32)
    for edge in edges:
        end = max(SHADOW_REACH * edge.depth_mm, edge.reach_mm)
        window, x, y = window_of(shape, edge.centre_mm, mm_per_px=mm_per_point, outer_mm=edge.radius_mm + end)
        square = x * x + y * y
        variances[0, *window] += np.float32(edge.std_mm**2) * (square < edge.radius_mm**2)
        beyond = np.clip(np.sqrt(square) - edge.radius_mm, edge.reach_mm, end)
        fall = np.interp(end, edge.places_mm, edge.fall_mm) - np.interp(beyond, edge.places_mm, edge.fall_mm)
        variances[1, *window] += np.float32(SHADED_FALL_STD**2) * np.square(fall, dtype=np.float32)
    return variances


# The term of slopes steeper than the calibrated ones, outside the restored round faces.
#
#     variance(x, y) = (g l)^2      where the depth is over half of the greatest; 0 elsewhere
#
# g: the steepest calibrated slope; l: mean width of the steep band, n px^2 / sqrt(4 pi A), n its pixels and A the
# area inside it. Such a band may hide the fall of a slope g over its width, which changes all depths inside it:
# outside the sharp edge of a rigid flat face of any outline the slope falls as the inverse root of the distance,
# so that the surface falls by 2 g l over the band, of which at least g l is read.
# Vanishes where no slope is steeper than g. Assumes one approximately round contact. By an assumed light g is less
# and counts only at a sharp rim around a face: the slopes of balls and cones are seen to grow.

STEEP_SHARE = 0.95  # of the steepest calibrated slope: steeper slopes may be read too low
ASSUMED_STEEP_SHARE = 0.5  # the same by an assumed light, which reads steep walls at .6 to .8 of gentle ones
FLANK = 2  # points of the grid inwards, within which the slope of a sharp rim ends
FLAT_SHARE = 0.25  # of a rim's slope, below which the place inside it belongs to a flat face
SHARP_SHARE = 1 / 3  # of the rim's length: as much of a circular edge is needed
MIN_STEEP_PX = 12  # pixels of a steep band; fewer are noise
BEHIND = 0.5  # of the greatest depth: deeper points lie inside the steep band


def hidden_step_mm(
    depth_mm: Picture, slopes: SlopeMap, *, steepest: float, every: int, mm_per_px: Pair, sharp: bool = False
) -> float:
    """Return the step (mm) that `depth_mm` (h, w) may lack inside slopes (H, W) steeper than `steepest` (mm/mm).

    `depth_mm` holds every `every`th pixel each way; `mm_per_px` (x, y) is of the whole picture. `sharp`: 0 unless
    the steep slopes end within FLANK points at a flat face.
    """
    p, q = slopes.dz_dx[::every, ::every], slopes.dz_dy[::every, ::every]
    steep = (np.abs(p) > steepest) | (np.abs(q) > steepest)
    steep_px = every**2 * np.count_nonzero(steep)
    if steep_px < MIN_STEEP_PX:
        return 0.0
    area_px = max(float(every**2) * np.count_nonzero(depth_mm > BEHIND * depth_mm.max()), 1.0)
    rim_px = np.sqrt(4 * np.pi * area_px)
    if sharp and every * _ending_at_a_face(p, q, steep) < SHARP_SHARE * FLANK * rim_px:
        return 0.0
    return float(steepest * steep_px / rim_px * np.sqrt(mm_per_px[0] * mm_per_px[1]))


def _ending_at_a_face(p: Array, q: Array, steep: Bools) -> int:
    """Return the number of `steep` points (h, w) whose slopes p, q, followed inwards by FLANK points, end."""
    size = np.hypot(p, q).astype(np.float32)
    y, x = np.nonzero(steep)
    inwards = FLANK / size[steep]
    at = (x + inwards * p[steep]).astype(np.float32), (y + inwards * q[steep]).astype(np.float32)
    return int(np.count_nonzero(cv2.remap(size, *at, cv2.INTER_LINEAR).ravel() < FLAT_SHARE * size[steep]))
