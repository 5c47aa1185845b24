"""The independent terms of the variance of a depth, one function a term."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.circular_edges import window_of
from tactilevision.heightmap.poisson import integrate
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.heightmap.zero_plane import USUAL_THICKNESS_MM, ZeroPlane, plane_terms
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.drift import SOFTENING_GREY
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Floats, Pair
from tactilevision.records.rig import SHADOW_ZONE
from tactilevision.robust import MAD_TO_STD

# The term of the photometric scale: all depths have the relative error g.
#
#     variance(x, y) = g(x, y)^2 depth(x, y)^2          g^2 = g_seen^2 + g_place(x, y)^2 + g_beyond(x, y)^2
#
# g_seen: scatter of the scale over the calibration's balls, common to all maps. g_place: local change of the scale
# with other balls (photometric/cross_validation.py). g_beyond: extrapolation beyond the outermost balls
# (photometric/cross_validation.py). All are in the method's card; older cards lack the last. Vanishes where the
# depth is 0, and where every ball gives one scale. Assumes errors proportional to the slope.

Picture = npt.NDArray[np.float32]


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

BLUR = 4.0  # deviations at which OpenCV truncates a blur
COARSE = 4  # points per thickness of gel on which the smooth mean is taken
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

BLOCK_PX = 16  # px: grid of the depth of untouched gel, finer than its waves


def free_variance(noise_mm2: Picture, waves_mm: float, *, untouched_std: Floats) -> Picture:
    """Return the variance (H, W) mm² of free gel: this term plus that of noise, `noise_mm2` (H, W) mm².

    `waves_mm` is one deviation for all places, `untouched_std` (h, w) mm one for each block.
    """
    variance = noise_mm2 + np.float32(waves_mm**2)
    blocks = np.asarray(untouched_std, np.float32)
    untouched = cv2.resize(blocks, variance.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.maximum(variance, untouched**2))


def untouched_std_mm(depths: Sequence[npt.NDArray[np.floating[Any]]]) -> Floats:
    """Return the standard deviation (h, w) mm of N >= 2 depths (H, W) mm of the free gel, in blocks of BLOCK_PX.

    The median over the frames, robust against touched ones; N/(N - 1) of the variance, as the mean of the same
    frames'
    slopes was subtracted; smoothed over neighbouring blocks.
    """
    height, width = depths[0].shape
    block_std = MAD_TO_STD * np.median(np.abs(np.stack(depths)), axis=0)
    size = (max(2, width // BLOCK_PX), max(2, height // BLOCK_PX))
    blocks = cv2.resize(np.asarray(block_std, np.float32), size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(blocks, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smooth * np.sqrt(len(depths) / (len(depths) - 1)), np.float64)


# The term of the zero plane: the untouched gel determines depth 0, limited by the gel's flatness.
#
#     variance = std_0^2 + (std_x X)^2 + (std_y Y)^2      X and Y from -1 to 1 over the picture
#
# std_0 of the plane at the picture's centre and std_x, std_y of its tilt are those of the fit
# (heightmap/zero_plane.py), with errors correlated over a tenth of the picture. Vanishes where untouched blocks
# all lie in one plane. The covariance of offset and tilt is neglected: it is zero for evenly distributed blocks.


def zero_variance(zero: ZeroPlane, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
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

    def __init__(self, method: ReferencedMethod, mm_per_px: Pair) -> None:
        tracker, shape = method.change.tracker, method.reference.shape
        self.blocks = (tracker.size[1], tracker.size[0])
        self.terms = plane_terms(shape, self.blocks)
        kept_share = cv2.resize(method.kept_share, tracker.size, interpolation=cv2.INTER_AREA)
        evaluate = method.law.evaluator(self.blocks)
        block_mm = tuple(
            n * mm / blocks for n, mm, blocks in zip(shape[::-1], mm_per_px, tracker.size, strict=True)
        )
        effects = tracker.effects / (tracker.level + SOFTENING_GREY)[:, None, :]
        depths = np.zeros(effects.shape)
        for channel, parts in enumerate(effects):
            for number, part in enumerate(parts):
                change = np.zeros((3, *self.blocks), np.float32)
                change[channel] = STEP * part.reshape(self.blocks)
                slopes = [
                    kept_share * (more - less) / (2.0 * STEP)
                    for more, less in zip(evaluate(change), evaluate(-change), strict=True)
                ]
                depths[channel, number] = integrate(SlopeMap(*slopes), (block_mm[0], block_mm[1])).ravel()

        self.depths = depths.reshape(-1, len(tracker.basis))  # of all coefficients, channel by channel

    def variance(self, covariance: Floats, zero: ZeroPlane) -> npt.NDArray[np.float32]:
        """Return the variance (rows, columns) mm² of depth on the blocks, by a drift's `covariance` (18, 18)."""
        depths = self.depths
        if zero.takes is not None:
            depths = depths - (depths @ zero.takes.T) @ self.terms
        return np.asarray(np.sum(depths * (covariance @ depths), axis=0), np.float32).reshape(self.blocks)


# The term of restored edges: the depth inside one includes a step given by the wall's law.
#
#     variance(x, y) = sum over edges of std_e^2      within the edge's radius; 0 outside
#
# std_e: of the step, from the fit of the law to the slopes around it (heightmap/walls.py).
# Vanishes without restored edges, and with the error of the fit. Assumes round edges of a rigid flat face.


def add_edge_variance(variance_mm2: Picture, edges: Sequence[PunchEdge], *, mm_per_point: Pair) -> None:
    """Add the variance by `edges` to `variance_mm2` (h, w) mm², in place.

    Its points are spaced `mm_per_point` (x, y) mm.
    """
    for edge in edges:
        window, x, y = window_of(
            variance_mm2.shape, edge.centre_mm, mm_per_px=mm_per_point, outer_mm=edge.radius_mm
        )
        variance_mm2[window] += np.float32(edge.std_mm**2) * (x * x + y * y < edge.radius_mm**2)


# The term of cast shadows: gel near a steep wall may lie in the shadow of a lamp, and then reads as too steep.
#
#     variance(r) = (s (u(K w) - u(r - a)))^2      r < a + K w;  K = 1/tan(elevation of the lowest lamp)
#
# u: the surface's fall below the face by the wall's law, from where slopes are read again outwards; w, a: depth
# and radius of the face; K: records/rig.py. An error of the fall in a shadow affects the face, too. s: rms
# relative error of that fall (renderings with lamps at 15 to 35 degrees read 1.05 to 1.47 of it).
# Vanishes beyond the shadow, and for gentle walls, whose shadow ends where slopes are replaced.

SHADED_FALL_STD = 0.3  # of the fall


def shades(edge: PunchEdge) -> bool:
    """Return whether the shadow of a wall may reach gel whose slopes are read."""
    return SHADOW_ZONE.reach * edge.depth_mm > edge.reach_mm


def add_shadow_variance(variance_mm2: Picture, edges: Sequence[PunchEdge], *, mm_per_point: Pair) -> None:
    """Add the variance of gel that `edges` may shade to `variance_mm2` (h, w) mm², in place."""
    for edge in filter(shades, edges):
        end = SHADOW_ZONE.reach * edge.depth_mm
        window, x, y = window_of(
            variance_mm2.shape, edge.centre_mm, mm_per_px=mm_per_point, outer_mm=edge.radius_mm + end
        )
        beyond = np.clip(np.sqrt(x * x + y * y) - edge.radius_mm, edge.reach_mm, end)
        fall = np.interp(end, edge.places_mm, edge.fall_mm) - np.interp(beyond, edge.places_mm, edge.fall_mm)
        variance_mm2[window] += np.float32(SHADED_FALL_STD**2) * np.square(fall, dtype=np.float32)


# The term of slopes steeper than the calibrated ones, outside the restored round faces.
#
#     variance(x, y) = (g l)^2      where the depth is over half of the greatest; 0 elsewhere
#
# g: the steepest calibrated slope; l: mean width of the steep band, n px^2 / sqrt(4 pi A), n its pixels and A the
# area inside it. Such a band may hide the fall of a slope g over its width, which changes all depths inside it.
# Vanishes where no slope is steeper than g. Assumes one approximately round contact.

STEEP_SHARE = 0.95  # of the steepest calibrated slope: steeper slopes may be read too low
MIN_STEEP_PX = 12  # pixels of a steep band; fewer are noise
BEHIND = 0.5  # of the greatest depth: deeper points lie inside the steep band


def hidden_step_mm(depth_mm: Picture, slopes: SlopeMap, *, steepest: float, every: int, mm_per_px: Pair) -> float:
    """Return the step (mm) that `depth_mm` (h, w) may lack inside slopes (H, W) steeper than `steepest` (mm/mm).

    `depth_mm` holds every `every`th pixel each way; `mm_per_px` (x, y) is of the whole picture.
    """
    p, q = slopes.dz_dx[::every, ::every], slopes.dz_dy[::every, ::every]
    steep_px = every**2 * np.count_nonzero((np.abs(p) > steepest) | (np.abs(q) > steepest))
    if steep_px < MIN_STEEP_PX:
        return 0.0
    area_px = max(float(every**2) * np.count_nonzero(depth_mm > BEHIND * depth_mm.max()), 1.0)
    width_px = steep_px / np.sqrt(4.0 * np.pi * area_px)
    return float(steepest * width_px * np.sqrt(mm_per_px[0] * mm_per_px[1]))


def add_steep_variance(variance_mm2: Picture, depth_mm: Picture, *, hidden_mm: float) -> None:
    """Add the variance of a step of `hidden_mm` to `variance_mm2` (h, w) mm² inside the band, in place."""
    if hidden_mm > 0:
        variance_mm2 += np.float32(hidden_mm**2) * (depth_mm > BEHIND * depth_mm.max())
