"""Convert many frames to height maps at once on a CUDA device, through torch.

The stages are those of `reconstructor.py`, without a look at numbers: gentle gel in means of pixels, places with
steeper slopes pixel by pixel. Frames that need more are read one by one on the processor by the frame path: steep
walls, overexposed or dark pixels, little untouched gel, pictures that may not be of this sensor. Without a device
all are. Maps of free and gentle gel are within 1 um rms of the frame path's.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.nn import functional

from tactilevision.errors import InputError
from tactilevision.heightmap.batched_slopes import Level, active_blocks, unmixed, window_mask
from tactilevision.heightmap.batched_surface import BatchedPlane, BatchedPoisson, Planes
from tactilevision.heightmap.deviation import Surface
from tactilevision.heightmap.device import HOST, Recorded, each, find_device
from tactilevision.heightmap.reconstructor import MIN_CHECKED_MM, Reconstructor
from tactilevision.photometric.batched_drift import Batched, BatchedDrift, Drifts, chosen
from tactilevision.photometric.colour_change import FrameChange
from tactilevision.photometric.method import SlopeReading
from tactilevision.photometric.reference import SATURATED
from tactilevision.records.maps import Frame, HeightMap, as_frame
from tactilevision.records.measured import Bytes, Picture

CHUNK = 128  # frames at once: what fills a device


@dataclass(frozen=True, eq=False)
class HeightMaps(Sequence[HeightMap]):
    """Height maps of N frames of one sensor, in order: `maps[k]` is that of frame k.

    `depth_mm` (N, H, W) float32, NaN in frames without a map; `found` holds each frame's map, or the error why
    there is none, which `maps[k]` raises.
    """

    depth_mm: Picture
    found: tuple[HeightMap | InputError, ...]

    def __len__(self) -> int:
        return len(self.found)

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            return replace(self, depth_mm=self.depth_mm[k], found=self.found[k])
        if isinstance(one := self.found[k], InputError):
            raise one
        return one


def reconstruct_batch(
    reconstructor: Reconstructor, frames: npt.NDArray[np.uint8] | Sequence[Frame | Bytes], device: str = "auto"
) -> HeightMaps:
    """Return the height maps of raw frames (N, H, W, 3) uint8, red first, as `Reconstructor.height_map`.

    `device` is "cpu", "cuda" or "cuda:N", or "auto": a CUDA device where there is one, else the processor, which
    also goes on where the device's memory is too small. A frame that cannot be read has its error in `found`.
    Raises InputError for a device that is not there or whose memory is too small, and for what is no frame. For
    several batches make one `BatchReader`.
    """
    return BatchReader(reconstructor, device).read(frames)


class Found(NamedTuple):
    """What a batch of B frames gave; `lowest`, `highest` of the depths (B,) mm; `odd` (B,) need the frame path."""

    depth: Batched
    std: Batched
    lowest: Batched
    highest: Batched
    odd: Batched
    planes: Planes
    drifts: Drifts


class Steps:
    """The steps from pictures to maps of gentle gel, by one `reconstructor` on one `device`.

    No step depends on numbers, so that all may be recorded.
    """

    def __init__(self, reconstructor: Reconstructor, device: str) -> None:
        method, sensor, error = reconstructor.referenced, reconstructor.sensor, reconstructor.error
        assert method is not None
        assert method.tiled_evaluator is not None
        assert error is not None
        on, tiled = partial(torch.as_tensor, device=device), method.tiled_evaluator
        self.reconstructor, self.method, self.tiled, self.error = reconstructor, method, tiled, error
        self.valid = method.reference.usable & method.readable
        self.drift, shape = BatchedDrift(method.change.tracker, device), method.reference.shape
        self.means = Level(tiled.maps, tiled.evaluate, tiled.kept_share, tiled.bias, device=device)
        self.pixels = Level(method.change.maps, method.evaluate, method.kept_share, method.bias, device=device)
        self.poisson = BatchedPoisson(shape, sensor.mm_per_px, device)
        thickness, trusted = sensor.gel.thickness_mm if sensor.gel else None, method.trusted_blocks
        self.plane = BatchedPlane(shape, trusted, sensor.mm_per_px, thickness_mm=thickness, device=device)
        self.gain_square, self.free_mm2 = on(error.gain_square), on(error.free_mm2)
        self.drift_depths, self.drift_terms = on(error.drift.depths), on(error.drift.terms)
        self.threshold, self.per_noise = on(tiled.slope_threshold), on(tiled.per_noise)
        self.limit = min(reconstructor.readable, error.steepest)
        self.over, self.sound = method.change.overexposed is not None, on(self.valid)

    @staticmethod
    def serve(reconstructor: Reconstructor) -> bool:
        """Return whether the steps have the law of a reconstructor."""
        method = reconstructor.referenced
        return method is not None and method.tiled_evaluator is not None and Level.reads(method.evaluate)

    def __call__(self, greys: Tensor) -> Found:
        """Return what rectified pictures (B, 3, H, W) give."""
        dark = (greys.amax(1) <= self.method.change.darkest) & self.sound
        odd = (greys.amax((1, 2, 3)) >= SATURATED) | dark.any(2).any(1) | self.over
        drifts, slopes = self._slopes(greys)
        odd = odd | drifts.odd | ~(slopes.square().sum(1).amax((1, 2)).sqrt() < self.limit)
        depth = self.poisson.integrate(slopes)
        planes = self.plane.find(depth, drifts.untouched)
        depth = self.plane.level(depth, planes)
        lowest, highest = depth.amin((1, 2)), depth.amax((1, 2))
        return Found(depth, self._std(depth, planes, drifts), lowest, highest, odd | planes.odd, planes, drifts)

    def _slopes(self, greys: Tensor) -> tuple[Drifts, Tensor]:
        """Return drifts and slopes (B, 2, H, W), those of gentle gel interpolated between means."""
        tiles = functional.avg_pool2d(greys, self.tiled.px)
        drifts = self.drift.measure_all(tiles)
        few, fine = (
            level.slopes(unmixed(one, drifts, self.drift.power), drifts.gains)
            for level, one in ((self.means, tiles), (self.pixels, greys))
        )
        inside = window_mask(active_blocks(few, self.tiled, self.threshold, self.per_noise), self.tiled)
        whole = functional.interpolate(few, scale_factor=self.tiled.px, mode="bilinear", align_corners=False)
        beyond = 0, fine.shape[3] - whole.shape[3], 0, fine.shape[2] - whole.shape[2]
        return drifts, torch.where(inside[:, None], fine, functional.pad(whole, beyond, mode="replicate"))

    def _std(self, depth: Tensor, planes: Planes, drifts: Drifts) -> Tensor:
        """Return the deviation (B, h, w) mm on the grid of `DepthError`, of maps without special terms."""
        few = depth[:, :: self.error.every, :: self.error.every]
        x, y = (torch.linspace(-1, 1, n, device=depth.device).square() for n in few.shape[:0:-1])
        offset, along_x, along_y = planes.std_mm.float().square()[:, :, None, None].unbind(1)
        total = self.gain_square * few.square() + self.free_mm2 + (x * along_x + offset) + y[:, None] * along_y
        depths = self.drift_depths - (self.drift_depths @ planes.takes.double().mT) @ self.drift_terms
        light = (depths * (drifts.covariance @ depths)).sum(1).float().view(*drifts.untouched.shape)[:, None]
        light = functional.interpolate(light, size=few.shape[1:], mode="bilinear", align_corners=False)
        light = chosen(drifts.drifted, light, torch.zeros_like(light))[:, 0]
        std: Tensor = (total + light).sqrt()
        return std

    def height_map(self, found: Found, k: int, frame: Frame, own: Picture) -> HeightMap:
        """Return the map of the k-th frame of a batch, whose depth (H, W) is `own`. Raises as the frame path."""
        zero, drift, reconstructor = found.planes.of(k), found.drifts.of(k), self.reconstructor
        seen = FrameChange(self.method.change, frame.rgb, drift, None, self.valid)
        if max(-float(found.lowest[k]), float(found.highest[k])) >= MIN_CHECKED_MM:
            seen = replace(seen, rgb=reconstructor.rectified(frame))
            surface = Surface(own, zero, (), SlopeReading((), (), self.valid, seen, 0.0))
            return reconstructor.assessed(surface, time_s=frame.time_s, name=frame.name).height
        std_mm, scale = np.asarray(cv2.resize(found.std[k], own.shape[::-1])), reconstructor.sensor.mm_per_px
        flags = reconstructor.match.flags(seen, zero) if reconstructor.match else ()
        change, free_mm = drift.normalised_residual, self.error.untouched_std_mm
        found_map = HeightMap(own, self.valid, scale, std_mm, frame.time_s, frame.name, flags)
        return replace(found_map, colour_change=change, untouched_std_mm=free_mm)


class BatchReader:
    """Reads batches of frames by one `reconstructor` on one `device`; what both determine is prepared once.

    Not for several threads.
    """

    def __init__(self, reconstructor: Reconstructor, device: str = "auto") -> None:
        self.reconstructor, self.may_change = reconstructor, device == "auto"
        self.device, self.chunk = find_device(device), 1
        self.recorded: Recorded[Found] | None = None
        if self.device != HOST and Steps.serve(reconstructor):
            self._record(Steps(reconstructor, self.device), CHUNK)

    def _record(self, steps: Steps, count: int) -> None:
        """Record the steps on batches of `count` frames."""
        sensor = self.reconstructor.sensor
        shape, self.steps, self.chunk = (sensor.height_px, sensor.width_px), steps, count
        with torch.inference_mode():
            self.recorded = Recorded(
                steps, device=self.device, count=count, shape=shape, maps=sensor.rectification
            )

    def read(self, frames: Iterable[Frame | Bytes]) -> HeightMaps:
        """Return the height maps of raw frames. Raises as `reconstruct_batch`."""
        given = [as_frame(one) for one in frames]
        try:
            return self._read(given)
        except torch.OutOfMemoryError as fault:
            what = f"the memory of the device is too small for {self.chunk} frames at once"
            if not self.may_change or self.device == HOST:
                remedy = "End other programs on it, or use cpu."
                raise InputError(what, where="device", value=self.device, remedy=remedy) from fault
            logging.getLogger(__name__).warning("%s: the processor goes on", what)
            self.device, self.chunk, self.recorded = HOST, 1, None
        return self._read(given)

    def _read(self, frames: Sequence[Frame]) -> HeightMaps:
        sensor = self.reconstructor.sensor
        depth: Picture = np.empty((len(frames), sensor.height_px, sensor.width_px), np.float32)
        maps: dict[int, HeightMap | InputError] = {}
        size = frames[0].rgb.shape if frames else ()
        batched = [k for k, one in enumerate(frames) if self.recorded and one.rgb.shape == size]
        with torch.inference_mode(), ThreadPoolExecutor(os.cpu_count()) as pool:
            act = map if self.recorded is None else pool.map
            for numbers, found in self._found(frames, batched):
                found = each(Tensor.numpy, found)
                depth[numbers] = found.depth[: len(numbers)]
                tasks = [(frames[n], depth[n], found, k) for k, n in enumerate(numbers)]
                maps.update(zip(numbers, act(self._map, *zip(*tasks, strict=True)), strict=True))
            alone = [k for k in range(len(frames)) if k not in maps]
            given = [frames[k] for k in alone], [depth[k] for k in alone]
            maps.update(zip(alone, act(self._map, *given), strict=True))
        return HeightMaps(depth, tuple(maps[k] for k in range(len(frames))))

    def _map(self, frame: Frame, own: Picture, found: Found | None = None, k: int = 0) -> HeightMap | InputError:
        """Return a frame's map, or its error, and write its depth to `own` (H, W).

        It is the k-th of what a batch `found`, unless it is to be read by the frame path.
        """
        try:
            if found is not None and not found.odd[k]:
                return self.steps.height_map(found, k, frame, own)
            height = self.reconstructor.height_map(frame)
        except InputError as fault:
            own[...] = np.nan
            return fault
        own[...] = height.depth_mm
        return height

    def _found(self, frames: Sequence[Frame], batched: Sequence[int]) -> Iterator[tuple[list[int], Found]]:
        """Yield numbers of frames and what they gave; the next batch is under way meanwhile."""
        waiting: tuple[list[int], int] | None = None
        while self.recorded is not None and (batched or waiting):
            numbers, batched = list(batched[: self.chunk]), batched[self.chunk :]
            begun = (numbers, self.recorded.begin([frames[k].rgb for k in numbers])) if numbers else None
            if waiting is not None:
                yield waiting[0], self.recorded.end(waiting[1])
            waiting = begun
