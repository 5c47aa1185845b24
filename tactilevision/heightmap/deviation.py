"""The standard deviation of a depth, pixel by pixel, as a sum of variance terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.deviation_terms import (
    STEEP_SHARE,
    DriftError,
    add_edge_variance,
    add_shadow_variance,
    add_steep_variance,
    extrapolated_gain_std,
    free_variance,
    gain_variance,
    hidden_step_mm,
    missing_colour_variance,
    noise_variance,
    scale_variance,
    zero_variance,
)
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.heightmap.zero_plane import ZeroPlane
from tactilevision.photometric.drift import Drift
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.photometric.windows import Patch, shares
from tactilevision.records.maps import HeightMap, SlopeMap
from tactilevision.records.measured import Bools, Pair
from tactilevision.robust import frame_mad_std, median

# The uncertainty of a depth, pixel by pixel: `HeightMap.std_mm`.
#
#   std^2 = scale + missing colour + free gel + zero plane + illumination + steep edges + cast shadow
#           + steep slope + inconsistent light
#
# The terms, their equations and limits are in `deviation_terms.py`; here they are summed as independent. The sum
# is computed on a grid, as all but edges is smooth.

Picture = npt.NDArray[np.float32]
Array = npt.NDArray[np.floating[Any]]
GRID_MM = 0.18  # mm, approximate step of the grid: finer than the deviation varies, except at edges
# of the greatest depth: what too steep slopes may hide before a map says so; calibrated balls stay below .1
MAX_HIDDEN_SHARE = 0.2
MAX_EXTRAPOLATED = 0.05  # of the depth, by lying beyond the balls; real sets' own balls have .01 (real_frames.md)
TERMS = (
    "depth scale",
    "missing colour",
    "slope noise",
    "untouched gel",
    "zero plane",
    "illumination",
    "steep edge",
    "cast shadow",
    "steep slope",
    "inconsistent light",
)


@dataclass(frozen=True, slots=True)
class MapEvidence:
    """Input of one height map's deviation, in addition to its depth.

    `slopes` (H, W) is optional where edges were restored, and where none is too steep (`too_steep`); `edges` are
    the restored ones; `drift` is None where the light was not followed. `lost_share` is the relative error of a
    slope where
    colours are missing, None where none is. `unexplained_mm` (h, w) is the depth by slopes that the light does not
    explain (heightmap/inconsistent_light.py), None where there is none.
    """

    zero: ZeroPlane
    slopes: SlopeMap | None = None
    edges: Sequence[PunchEdge] = ()
    drift: Drift | None = None
    lost_share: Patch | None = None
    unexplained_mm: Picture | None = None


class DepthError:
    """Standard deviation of the depths by one method; quantities of the place alone are computed once.

    `free_mm2`, `gain_square` (h, w) of the grid: variance of free gel in mm², and of the depth scale, relative.
    """

    def __init__(self, method: ReferencedMethod, mm_per_px: Pair) -> None:
        self.method, self.mm_per_px = method, mm_per_px
        card = method.card
        self.steepest = STEEP_SHARE * (np.inf if card.steepest_slope is None else card.steepest_slope)
        every = self.every = max(2, round(GRID_MM / max(mm_per_px)))
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

    def std_mm(self, depth_mm: Array, evidence: MapEvidence) -> Picture:
        """Return the standard deviation (H, W) mm of `depth_mm` (H, W), by the `evidence` of the same map."""
        few = self._on_grid(depth_mm)
        total = scale_variance(few, self.gain_square)
        lost = self._lost(few, evidence)
        if lost is not None:
            total += lost
        total += self.free_mm2
        total += zero_variance(evidence.zero, total.shape)
        light = self._light(evidence, total.shape)
        if light is not None:
            total += light
        add_edge_variance(total, evidence.edges, mm_per_point=self._step_mm)
        add_shadow_variance(total, evidence.edges, mm_per_point=self._step_mm)
        add_steep_variance(total, few, hidden_mm=self._hidden_mm(few, evidence))
        if evidence.unexplained_mm is not None:
            total += self._unexplained(evidence.unexplained_mm, total.shape)
        cv2.sqrt(total, dst=total)
        return np.asarray(cv2.resize(total, depth_mm.shape[::-1], interpolation=cv2.INTER_LINEAR))

    def in_pixels(self, shape: tuple[int, ...]) -> list[Picture]:
        """Return `gain_square` and `free_mm2`, (H, W) each, for a map of `shape`: cached, not to be modified."""
        if shape not in self._in_pixels:
            grids = (self.gain_square, self.free_mm2)
            self._in_pixels[shape] = [np.asarray(cv2.resize(grid, shape[::-1])) for grid in grids]
        return self._in_pixels[shape]

    def terms_mm(self, depth_mm: Array, evidence: MapEvidence) -> dict[str, Picture]:
        """Return the deviation (h, w) mm that each of TERMS adds to `depth_mm` (H, W); their squares sum to
        std_mm's.

        On the grid of every `every`th pixel. Of two terms with a maximum, the second is its excess over the first.
        Not for
        every frame: it takes as long as the sum again.
        """
        few = self._on_grid(depth_mm)
        lost = self._lost(few, evidence)
        light, edges, steep = self._light(evidence, few.shape), np.zeros_like(few), np.zeros_like(few)
        shadow = np.zeros_like(few)
        add_edge_variance(edges, evidence.edges, mm_per_point=self._step_mm)
        add_shadow_variance(shadow, evidence.edges, mm_per_point=self._step_mm)
        add_steep_variance(steep, few, hidden_mm=self._hidden_mm(few, evidence))
        variances = (
            scale_variance(few, self.gain_square),
            np.zeros_like(few) if lost is None else lost,
            self.noise_mm2,
            self.free_mm2 - self.noise_mm2,
            zero_variance(evidence.zero, few.shape),
            np.zeros_like(few) if light is None else light,
            edges,
            shadow,
            steep,
            np.zeros_like(few)
            if evidence.unexplained_mm is None
            else self._unexplained(evidence.unexplained_mm, few.shape),
        )
        return {name: np.sqrt(variance) for name, variance in zip(TERMS, variances, strict=True)}

    @cached_property
    def drift(self) -> DriftError:
        """Return the response of depth to the drift of the light."""
        return DriftError(self.method, self.mm_per_px)

    def too_steep(self, steepest: float) -> bool:
        """Return whether a picture whose greatest |slope| is `steepest` may hide depth behind steep slopes."""
        return steepest > self.steepest

    def hides_much(self, depth_mm: Array, evidence: MapEvidence) -> bool:
        """Return whether too steep slopes may hide a good part of the greatest depth of `depth_mm` (H, W), mm."""
        few = self._on_grid(depth_mm)
        return self._hidden_mm(few, evidence) > MAX_HIDDEN_SHARE * float(few.max())

    def beyond_balls(self, contact: Bools) -> bool:
        """Return whether the depth of a `contact` is extrapolated beyond the balls, in the mean over it.

        `contact` is a mask (h, w) of the whole picture, of any resolution.
        """
        if not self.extrapolates:
            return False
        size = self.extrapolated_std.shape[::-1]
        share = cv2.resize(contact.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        covered = float(share.sum())
        return covered > 0.0 and float(np.vdot(self.extrapolated_std, share)) > MAX_EXTRAPOLATED * covered

    @property
    def _step_mm(self) -> Pair:
        return self.every * self.mm_per_px[0], self.every * self.mm_per_px[1]

    def _on_grid(self, depth_mm: Array) -> Picture:
        return np.array(depth_mm[:: self.every, :: self.every], np.float32)

    def _lost(self, few: Picture, evidence: MapEvidence) -> Picture | None:
        if evidence.lost_share is None:
            return None
        share = _thinned(evidence.lost_share, self.method.reference.shape, few.shape)
        return missing_colour_variance(few, share, every=self.every, mm_per_px=self.mm_per_px)

    def _light(self, evidence: MapEvidence, shape: tuple[int, ...]) -> Picture | None:
        if evidence.drift is None or evidence.drift.covariance is None:
            return None
        blocks = self.drift.variance(evidence.drift.covariance, evidence.zero)
        return np.asarray(cv2.resize(blocks, shape[::-1], interpolation=cv2.INTER_LINEAR))

    def _unexplained(self, depth_mm: Picture, shape: tuple[int, ...]) -> Picture:
        """Return the variance (h, w) mm^2 by slopes that the light does not explain: all of that depth."""
        return np.asarray(np.square(cv2.resize(depth_mm, shape[::-1], interpolation=cv2.INTER_LINEAR)))

    def _hidden_mm(self, few: Picture, evidence: MapEvidence) -> float:
        if evidence.edges or evidence.slopes is None:
            return 0.0
        return hidden_step_mm(
            few, evidence.slopes, steepest=self.steepest, every=self.every, mm_per_px=self.mm_per_px
        )


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


# Does anything touch the gel? The deviation of untouched gel, with which a depth is compared.
#
# `HeightMap.std_mm` includes the uncertainty of the depth's scale, a part g of the depth. It makes the depth of a
# contact uncertain, but not its presence: with g of a fifth no contact would reach five deviations. So it is
# removed, and applied to the deviation of untouched gel, which has that scale,
#
#     s^2 = (1 + g)^2 [ max(std^2 - g^2 depth^2, u^2) + r^2 ]
#
# u: the least local deviation of untouched gel; r: roughness of the shallow part of the map itself, in excess of
# the method's stated noise (median distance of the shallower half from its median, as a standard deviation).

SAMPLED = 4000  # approximate number of pixels that determine a map's roughness


def untouched_std(
    height: HeightMap,
    error: DepthError | None,
    *,
    every: int = 1,
    places: npt.NDArray[np.intp] | None = None,
    noise_mm: float | None = None,
) -> Array | None:
    """Return the standard deviation (h, w) in mm of untouched depth, of every `every`th pixel each way.

    Only at the `places` (n,) of the flattened (h, w) where they are given, (n,). `error` is that of the method
    which made the map; None: the map's own deviation, which may itself be None. `noise_mm` of the map where it is
    known.
    """

    def wanted(grid: Array) -> Array:
        return grid if places is None else grid.take(places)

    if height.std_mm is None or error is None:
        return None if height.std_mm is None else wanted(height.std_mm[::every, ::every])
    depth, std = (np.asarray(many[::every, ::every], np.float32) for many in (height.depth_mm, height.std_mm))
    gain_square, least = map(wanted, error.in_pixels(depth.shape))
    depth, std = wanted(depth), wanted(std)
    noise_mm = map_noise_mm(height) if noise_mm is None else noise_mm
    square = np.maximum(std * std - gain_square * depth * depth, least)
    return np.asarray((1.0 + np.sqrt(gain_square)) * np.sqrt(square + np.float32(noise_mm**2)))


def map_noise_mm(height: HeightMap) -> float:
    """Return the standard deviation (mm) of the shallower half of a map (H, W), from the median distance to its
    median.

    0 of nothing.
    """
    step = max(1, int(np.sqrt(height.depth_mm.size / SAMPLED)))
    depth = height.depth_mm[::step, ::step][height.valid[::step, ::step]]
    if not depth.size:
        return 0.0
    shallow = depth[depth <= median(depth)]
    return frame_mad_std(shallow)
