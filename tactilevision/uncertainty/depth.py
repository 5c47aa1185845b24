"""How far a depth is to be trusted, pixel by pixel: what `HeightMap.std_mm` says.

    std^2 = max(noise^2 + waves^2, untouched^2) + zero^2 + drift^2 + max(gain^2 depth^2, spread <gain^2 depth^2>)
            + wall^2

noise: the slopes' own noise carried through the integration, measured on a few drawn noise fields (it depends on
the place alone, so it is done once); waves: how far untouched gel was from flat in the calibration's pictures,
as errors of the light's colour over wide areas make it; untouched: how far, place by place, single frames of the
free gel were from flat. Their noise is alike over many pixels (blur, compression), and drawn noise is not:
integrated, slow waves of it come to several times as much, most of all in dark corners. zero: the zero plane's;
drift: what is not known of the light's (`drift_error.py`);
gain: how far the depth scale of balls scatters that are in the calibration, which no map escapes, and, place by
place, what other balls would have made of it (`photometric/jackknife.py`); < > over a thickness of gel, as errors
of slope spread to the gel beside, where they have nothing to fall off with: how far, leaving out balls shows
(`spread.py`). Neither is set by hand; both stand in the method's card.
wall: how far the step of a restored wall may be off (`walls.py`), and where slopes steeper than any ball showed
belong to no round face, as much again as such a slope drops over the wall's width; all behind it stands on that.
Assumes these to be independent. Blur of contacts only a few pixels wide is not in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.integration.circular_edges import window_of
from tactilevision.integration.poisson import integrate
from tactilevision.integration.steep_edges import PunchEdge
from tactilevision.integration.zero_plane import USUAL_THICKNESS_MM, ZeroPlane
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.illumination.drift import Drift
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.records import Pair, SlopeMap
from tactilevision.uncertainty.illumination import DriftError

Picture = npt.NDArray[np.float32]
DRAWS = 6
STEEP = 0.95  # of the steepest slope that was calibrated
MIN_STEEP = 12  # pixels; fewer are noise
GRID_MM = 0.18  # on which it is worked out, about; it is smooth but for walls, where a pixel does not matter
COARSE = 4  # points of the grid on which depth nearby is looked up, to a thickness of gel
ROOM = 16  # px: grid on which the depth of untouched gel is kept
MEDIAN_TO_STD = 1.4826


class DepthError:
    """Standard deviation of the depths that one method gives; what depends on the place alone is made once."""

    def __init__(self, method: ReferencedMethod, mm_per_px: Pair) -> None:
        self.method, self.mm_per_px = method, mm_per_px
        gain = place_gain_std(method.card, method.relative_error)
        self.spread = 1.0 if method.card.leakage_std is None else method.card.leakage_std
        self.steep = STEEP * (np.inf if method.card.steepest_slope is None else method.card.steepest_slope)
        waves_mm = method.card.untouched_depth_rms_mm or 0.0
        noise = method.noise * np.float32(1.0 if method.card.frame_noise is None else method.card.frame_noise)
        self.variance = _noise_variance(noise, mm_per_px) + np.float32(waves_mm**2)
        untouched = np.array(method.card.untouched_std_mm or [[0.0]], np.float32)
        shape = self.variance.shape
        untouched = cv2.resize(untouched, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
        every = self.every = max(2, round(GRID_MM / max(mm_per_px)))
        self.variance = np.maximum(self.variance, untouched**2)[::every, ::every].copy()
        size = (self.variance.shape[1], self.variance.shape[0])
        self.gain_square = cv2.resize(np.asarray(gain**2, np.float32), size, interpolation=cv2.INTER_LINEAR)

    def std_mm(
        self,
        depth: npt.NDArray[np.floating[Any]],
        zero: ZeroPlane,
        *,
        slopes: SlopeMap | None = None,
        walls: Sequence[PunchEdge] = (),
        drift: Drift | None = None,
    ) -> Picture:
        """Standard deviation (H, W) of `depth` (H, W), mm; `walls` are those that were restored.

        `slopes` may be left out where walls were restored, and where none is too steep (`too_steep`).
        """
        few = np.array(depth[:: self.every, :: self.every], np.float32)
        total = self._nearby(few)
        cv2.addWeighted(total, 1.0, self.variance, 1.0, zero.std_mm**2, dst=total)
        if drift is not None and drift.covariance is not None:
            light = self.drift.variance(drift.covariance, zero)
            total += cv2.resize(light, total.shape[::-1], interpolation=cv2.INTER_LINEAR)
        for restored in walls:
            step = (self.every * self.mm_per_px[0], self.every * self.mm_per_px[1])
            window, x, y = window_of(few.shape, restored.centre_mm, step, restored.radius_mm)
            total[window] += np.float32(restored.std_mm**2) * (x * x + y * y < restored.radius_mm**2)
        wall = 0.0 if walls or slopes is None else self.wall_mm(few, slopes)
        if wall > 0:
            total += np.float32(wall**2) * (few > 0.5 * few.max())
        cv2.sqrt(total, dst=total)
        return np.asarray(cv2.resize(total, depth.shape[::-1], interpolation=cv2.INTER_LINEAR))

    @cached_property
    def drift(self) -> DriftError:
        """How depth answers to the drift of the light."""
        return DriftError(self.method, self.mm_per_px)

    def too_steep(self, steepest: float) -> bool:
        """Whether a picture whose greatest |slope| is `steepest` may hide depth behind its walls."""
        return steepest > self.steep

    def _nearby(self, few: Picture) -> Picture:
        """The gain's part of the variance (h, w): of the depth there, or of depths nearby where that is more."""
        every = max(1, round(USUAL_THICKNESS_MM / (COARSE * self.every * max(self.mm_per_px))))
        square = cv2.multiply(few, few)
        square *= self.gain_square
        coarse = square[::every, ::every]
        spread = [USUAL_THICKNESS_MM / (every * self.every * step) for step in self.mm_per_px]
        coarse = cv2.GaussianBlur(coarse, (0, 0), spread[0], sigmaY=spread[1])
        coarse *= np.float32(self.spread)
        wide = cv2.resize(coarse, few.shape[::-1], interpolation=cv2.INTER_LINEAR)
        return np.asarray(cv2.max(wide, square, dst=square))

    def wall_mm(self, few: Picture, slopes: SlopeMap) -> float:
        """What may be missing of the depth behind walls steeper than the calibration knows; a wall is long."""
        p, q = slopes.dz_dx[:: self.every, :: self.every], slopes.dz_dy[:: self.every, :: self.every]
        steep = self.every**2 * np.count_nonzero((np.abs(p) > self.steep) | (np.abs(q) > self.steep))
        if steep < MIN_STEEP:
            return 0.0
        area = max(float(self.every**2) * np.count_nonzero(few > 0.5 * few.max()), 1.0)
        width_px = steep / np.sqrt(4.0 * np.pi * area)
        return float(self.steep * width_px * np.sqrt(self.mm_per_px[0] * self.mm_per_px[1]))


def place_gain_std(card: MethodCard, relative_error: float) -> npt.NDArray[np.float64]:
    """Relative deviation (h, w) of the depth scale over the picture, as a method's card tells it."""
    return np.hypot(gain_std(card, relative_error), np.array(card.place_gain_std or [[0.0]], np.float64))


def gain_std(card: MethodCard, relative_error: float) -> float:
    """Relative deviation of the depth scale from ball to ball, which no map escapes; of slopes where not told.

    A card that does not say what other balls would have changed has it mixed with balls held out.
    """
    held_out = relative_error if card.held_out_gain_std is None else card.held_out_gain_std
    if card.seen_gain_std is None:
        return held_out
    seen = card.seen_gain_std
    return seen if card.place_gain_std is not None else float(np.sqrt(seen * (held_out + seen)))


def untouched_std_mm(depths: Sequence[npt.NDArray[np.floating[Any]]]) -> npt.NDArray[np.float64]:
    """Standard deviation (h, w) in mm of the depth that N >= 2 frames of the free gel show, in blocks of ROOM px.

    The median over the frames, as in one or the other something may have touched; N/(N - 1) of the variance, as
    the mean of the same frames' slopes was taken off; smooth over neighbouring blocks, as few frames are rough.
    """
    height, width = depths[0].shape
    spread = MEDIAN_TO_STD * np.median(np.abs(np.stack(depths)), axis=0)
    size = (max(2, width // ROOM), max(2, height // ROOM))
    blocks = cv2.resize(np.asarray(spread, np.float32), size, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(blocks, (0, 0), 1.0, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smooth * np.sqrt(len(depths) / (len(depths) - 1)), np.float64)


def _noise_variance(noise: Picture, mm_per_px: Pair) -> Picture:
    rng = np.random.default_rng(0)  # a fixed draw: the certificate of a method does not change between runs
    total = np.zeros(noise.shape, np.float32)
    for _ in range(DRAWS):
        fields = rng.standard_normal((2, *noise.shape), dtype=np.float32) * noise
        surface = integrate(SlopeMap(fields[0], fields[1]), mm_per_px)
        total += (surface - np.median(surface)) ** 2
    spread = max(noise.shape) / 12.0
    return np.asarray(cv2.GaussianBlur(total / DRAWS, (0, 0), spread), np.float32)
