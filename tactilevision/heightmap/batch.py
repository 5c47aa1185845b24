"""Convert many frames to height maps at once, on the processor or a CUDA device, through torch.

The stages are those of `reconstructor.py`. Gentle gel is read in means of pixels; on a device, places with steeper
slopes pixel by pixel. Frames that need more are read one by one on the processor by the frame path: steep walls,
overexposed or dark pixels, little untouched gel, pictures that may not be of this sensor; without a device also
frames with steeper slopes. Maps of free and gentle gel are within 1 um rms of the frame path's.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, islice, repeat
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
from tactilevision.photometric.batched_drift import Batched, BatchedDrift, Drifts
from tactilevision.photometric.colour_change import FrameChange, brightest
from tactilevision.photometric.drift import means
from tactilevision.photometric.method import SlopeReading
from tactilevision.photometric.reference import SATURATED
from tactilevision.records.maps import Frame, HeightMap, as_frame
from tactilevision.records.measured import Array, Bools, Bytes, Picture

CHUNK = {"cpu": 32, "cuda": 128}  # frames at once: what stays in a cache, and what fills a device


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
        if isinstance(one := _whole(self.found[k]), InputError):
            raise one
        return one

    def each(self) -> Iterator[HeightMap | InputError]:
        """Yield the map of every frame, or the error why there is none."""
        return map(_whole, self.found)

    @property
    def valid(self) -> Bools:
        """Return where (N, H, W) depths are known."""
        none = np.zeros(self.depth_mm.shape[1:], np.bool_)
        return np.stack([none if isinstance(one, InputError) else one.valid for one in self.found])

    @property
    def std_mm(self) -> Array:
        """Return the standard deviations (N, H, W) of the depths, mm; NaN where there is none."""
        out = np.full(self.depth_mm.shape, np.nan, np.float32)
        for own, one in zip(out, self.each(), strict=True):
            if not isinstance(one, InputError) and one.std_mm is not None:
                own[...] = one.std_mm
        return out

    @property
    def flags(self) -> tuple[tuple[str, ...], ...]:
        """Return the flags of each frame's map, none for a frame without a map."""
        return tuple(() if isinstance(one, InputError) else one.flags for one in self.found)


def _whole(one: HeightMap | InputError) -> HeightMap | InputError:
    """Return a map with its deviation in every pixel, which is kept on a grid."""
    if isinstance(one, InputError) or one.std_mm is None or one.std_mm.shape == one.depth_mm.shape:
        return one
    return replace(one, std_mm=np.asarray(cv2.resize(one.std_mm, one.depth_mm.shape[::-1])))


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


class BatchReader:
    """Reads batches of frames by one `reconstructor` on one `device`; what both determine is prepared once.

    `fine`: whether steeper places are read there, pixel by pixel; by default on a CUDA device. Not for several
    threads.
    """

    def __init__(self, reconstructor: Reconstructor, device: str = "auto", *, fine: bool | None = None) -> None:
        self.reconstructor, self.may_change = reconstructor, device == "auto"
        self._prepare(find_device(device), fine)

    def _prepare(self, device: str, fine: bool | None = None) -> None:
        self.device, self.chunk = device, CHUNK[device.partition(":")[0]]
        self.fine = device != HOST if fine is None else fine
        method, sensor = self.reconstructor.referenced, self.reconstructor.sensor
        tiled = method.tiled_evaluator if method else None
        self.usable = method is not None and tiled is not None and Level.reads(method.evaluate)
        self.valid: Any = method and method.reference.usable & method.readable
        self.recorded: Recorded[Found] | None = None
        if not self.usable or method is None or tiled is None or self.reconstructor.error is None:
            return
        self.method, self.tiled, self.error, self.px = method, tiled, self.reconstructor.error, tiled.px
        self.grids, self.drift = self.reconstructor.grids, BatchedDrift(method.change.tracker, device)
        self.means = Level(tiled.maps, tiled.evaluate, tiled.kept_share, tiled.bias, device=device)
        self.pixels = Level(method.change.maps, method.evaluate, method.kept_share, method.bias, device=device)
        assert self.grids is not None
        shape, step = (
            (self.grids.shape, sensor.mm_per_px) if self.fine else (self.grids.size, self.grids.coarse_mm)
        )
        self.poisson = BatchedPoisson(shape, step, device)
        thickness = sensor.gel.thickness_mm if sensor.gel else None
        self.plane = BatchedPlane(
            shape, method.trusted_blocks, mm_per_px=step, thickness_mm=thickness, device=device
        )
        error, on = self.error, partial(torch.as_tensor, device=device)
        self.gain_square, self.free_mm2 = on(error.gain_square), on(error.free_mm2)
        self.drift_depths, self.drift_terms = on(error.drift.depths), on(error.drift.terms)
        self.threshold, self.per_noise = on(tiled.slope_threshold), on(tiled.per_noise)
        self.limit = min(self.reconstructor.readable, error.steepest)
        self.over = method.change.overexposed is not None
        self.sound = torch.as_tensor(self.valid, device=device)
        if device != HOST:
            size, maps = (sensor.height_px, sensor.width_px), sensor.rectification
            with torch.inference_mode():
                self.recorded = Recorded(self._on_device, device=device, count=self.chunk, shape=size, maps=maps)

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
            self._prepare(HOST)
        return self._read(given)

    def _read(self, frames: Sequence[Frame]) -> HeightMaps:
        sensor = self.reconstructor.sensor
        depth: Picture = np.empty((len(frames), sensor.height_px, sensor.width_px), np.float32)
        maps: list[HeightMap | InputError | None] = [None] * len(frames)
        size = frames[0].rgb.shape if frames else ()
        batched = [k for k, one in enumerate(frames) if self.usable and one.rgb.shape == size]
        with torch.inference_mode(), ThreadPoolExecutor(os.cpu_count()) as pool:
            act = map if self.device == HOST else pool.map
            for numbers, rectified, found in self._found(frames, batched):
                found = each(Tensor.numpy, found)
                depth[numbers] = found.depth[: len(numbers)]
                parts = [frames[k] for k in numbers], [depth[k] for k in numbers], rectified
                for number, one in zip(numbers, act(partial(self._map, found), count(), *parts), strict=True):
                    maps[number] = one
            alone = [k for k, one in enumerate(maps) if one is None]
            given = [frames[k] for k in alone], [depth[k] for k in alone]
            for number, one in zip(alone, act(self._alone, *given), strict=True):
                maps[number] = one
        return HeightMaps(depth, tuple(one for one in maps if one is not None))

    def _alone(self, frame: Frame, own: Picture) -> HeightMap | InputError:
        """Return the frame path's map, written to `own` (H, W) as well, or its error."""
        try:
            height = self.reconstructor.height_map(frame)
        except InputError as fault:
            own[...] = np.nan
            return fault
        own[...] = height.depth_mm
        return height

    def _map(self, found: Found, k: int, frame: Frame, own: Picture, rgb: Bytes | None) -> HeightMap | InputError:
        """Return the map of the k-th frame of a batch, whose depth (H, W) is `own`; `rgb` rectified, or None."""
        if found.odd[k]:
            return self._alone(frame, own)
        zero, drift = found.planes.of(k), found.drifts.of(k)
        seen = FrameChange(self.method.change, frame.rgb if rgb is None else rgb, drift, None, self.valid)
        flags = self.reconstructor.match.flags(seen, zero) if self.reconstructor.match else ()
        if max(-float(found.lowest[k]), float(found.highest[k])) < MIN_CHECKED_MM:
            std, scale = found.std[k].copy(), self.reconstructor.sensor.mm_per_px
            return HeightMap(
                own,
                self.valid,
                scale,
                std,
                frame.time_s,
                frame.name,
                flags,
                colour_change=drift.normalised_residual,
                untouched_std_mm=self.error.untouched_std_mm,
            )
        if rgb is None:
            seen = replace(seen, rgb=self.reconstructor.rectified(frame))
        surface = Surface(own, zero, (), SlopeReading((), (), self.valid, seen, 0.0))
        try:
            return self.reconstructor.assessed(surface, time_s=frame.time_s, name=frame.name).height
        except InputError as fault:
            own[...] = np.nan
            return fault

    def _found(
        self, frames: Sequence[Frame], batched: Sequence[int]
    ) -> Iterator[tuple[list[int], Iterable[Bytes | None], Found]]:
        """Yield numbers of frames, their rectified pictures where the processor made them, and what they gave."""
        left, waiting = iter(batched), None
        while numbers := list(islice(left, self.chunk)):
            if self.recorded is None:
                rgbs = [self.reconstructor.rectified(frames[k]) for k in numbers]
                sound, found = self._on_host(rgbs)
                if found is not None:
                    yield [numbers[k] for k in sound], [rgbs[k] for k in sound], found
                continue
            begun = self.recorded.begin([frames[k].rgb for k in numbers])
            if waiting is not None:
                yield waiting[0], repeat(None), self.recorded.end(waiting[1])
            waiting = numbers, begun
        if waiting is not None:
            assert self.recorded is not None
            yield waiting[0], repeat(None), self.recorded.end(waiting[1])

    def _on_host(self, rgbs: Sequence[Bytes]) -> tuple[list[int], Found | None]:
        """Return which of the rectified pictures are read on the processor at once, and what they give."""
        tiles = torch.from_numpy(np.stack([means(rgb, self.px) for rgb in rgbs]))
        greys = torch.from_numpy(np.stack(rgbs)).permute(0, 3, 1, 2).float() if self.fine else None
        drifts, slopes, odd = self._slopes(tiles, greys)
        sound = ~odd & torch.tensor([self._sound(rgb) for rgb in rgbs])
        numbers: list[int] = sound.nonzero()[:, 0].tolist()
        if not numbers:
            return numbers, None
        return numbers, self._surfaces(each(lambda one: one[sound], drifts), slopes[sound], odd[sound])

    def _sound(self, rgb: Bytes) -> bool:
        """Return whether no colour of a rectified picture is overexposed, and no readable pixel dark."""
        change = self.method.change
        if change.find_missing(rgb) is not None:
            return False
        return not (change.in_shadow(rgb, None) and (brightest(rgb)[self.valid] <= change.darkest).any())

    def _on_device(self, greys: Tensor) -> Found:
        """Return what rectified pictures (B, 3, H, W) give, all steps on their device."""
        dark = (greys.amax(1) <= self.method.change.darkest) & self.sound
        odd = (greys.amax((1, 2, 3)) >= SATURATED) | dark.any(2).any(1) | self.over
        drifts, slopes, more = self._slopes(functional.avg_pool2d(greys, self.px), greys)
        return self._surfaces(drifts, slopes, odd | more)

    def _slopes(self, tiles: Tensor, greys: Tensor | None) -> tuple[Drifts, Tensor, Tensor]:
        """Return drifts, slopes (B, 2, h, w) and which frames (B,) need the frame path.

        Of frames in means (B, 3, h, w) and, to read steeper places pixel by pixel, in pixels (B, 3, H, W).
        """
        drifts = self.drift.measure(tiles)
        slopes = self.means.slopes(unmixed(tiles, drifts, self.drift.power), drifts.gains)
        blocks = active_blocks(slopes, self.tiled, self.threshold, self.per_noise)
        odd = drifts.odd
        if greys is None:
            odd = odd | blocks.any(2).any(1)
        else:
            fine = self.pixels.slopes(unmixed(greys, drifts, self.drift.power), drifts.gains)
            inside = window_mask(blocks, self.tiled)
            slopes = torch.where(inside[:, None], fine, self._in_pixels(slopes))
        return drifts, slopes, odd | ~(slopes.square().sum(1).amax((1, 2)).sqrt() < self.limit)

    def _surfaces(self, drifts: Drifts, slopes: Tensor, odd: Tensor) -> Found:
        """Return what frames give by their drifts and slopes."""
        depth = self.poisson.integrate(slopes)
        planes = self.plane.find(depth, drifts.untouched)
        depth = self.plane.level(depth, planes)
        if not self.fine and self.grids is not None:
            depth = torch.from_numpy(np.stack([self.grids.whole(one, (), fine=()) for one in depth.numpy()]))
        lowest, highest = depth.amin((1, 2)), depth.amax((1, 2))
        return Found(depth, self._std(depth, planes, drifts), lowest, highest, odd | planes.odd, planes, drifts)

    def _in_pixels(self, slopes: Tensor) -> Tensor:
        """Return slopes of means interpolated to pixels (B, 2, H, W), the last ones continued to the border."""
        height, width = self.tiled.shape
        whole = functional.interpolate(slopes, scale_factor=self.px, mode="bilinear", align_corners=False)
        return functional.pad(whole, (0, width - whole.shape[3], 0, height - whole.shape[2]), mode="replicate")

    def _std(self, depth: Tensor, planes: Planes, drifts: Drifts) -> Tensor:
        """Return the deviation (B, h, w) mm on the grid of `DepthError`, of maps without special terms."""
        few = depth[:, :: self.error.every, :: self.error.every]
        x, y = (torch.linspace(-1, 1, n, device=depth.device).square() for n in few.shape[:0:-1])
        offset, along_x, along_y = planes.std_mm.float().square()[:, :, None, None].unbind(1)
        total: Tensor = (
            self.gain_square * few.square() + self.free_mm2 + (x * along_x + offset) + y[:, None] * along_y
        )
        if self.device != HOST or drifts.drifted.any():
            depths = self.drift_depths - (self.drift_depths @ planes.takes.double().mT) @ self.drift_terms
            light = (depths * (drifts.covariance @ depths)).sum(1).float().view(len(depth), 1, *self.drift.shape)
            light = functional.interpolate(light, size=few.shape[1:], mode="bilinear", align_corners=False)[:, 0]
            total = total + light
        return total.sqrt()
