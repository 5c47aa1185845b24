"""A camera that looks at rendered gel: each lamp's radiance -> colours -> blur -> noise -> response -> 8 bits.

A press deepens continuously; only some of its depths are rendered. Between two of them each lamp's light is
taken as linear in the depth, before colours and response. The depth at which the bevel is met is one of them, so
that the light kinks where the gel does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np

from benchmarks.rendered.families import Response, Rig, field_mm, stream
from benchmarks.rendered.path_tracer import PathTracer, Transport
from tactilevision.records.measured import Bytes, Floats
from tactilevision.synthetic.gel import Flat, Grid, Singles, Surface
from tactilevision.synthetic.punch import PunchPress

_INTERVAL_MM = 0.075  # at most, from one depth to the next up to the bevel's touch
_MIN_BEFORE = 3
_AFTER_MM = (0.004, 0.012, 0.03, 0.07)  # beyond it
_STEPS = 16383
_DRIFT = 0.003  # largest swing of a lamp during a recording, relative


@dataclass(frozen=True, eq=False)
class RenderedCamera:
    """Frames of surfaces under one rig. `tracer` draws the lamps; the rest of the rig is applied here."""

    rig: Rig
    tracer: PathTracer

    @property
    def grid(self) -> Grid:
        return self.tracer.grid

    def ideal(self, surface: Surface, time_s: float = 0.0) -> Singles:
        """Linear light (H, W, 3), 1 is white, without noise."""
        light = mix(self._lamps(surface), self.rig, self.scale * self._gains(time_s))
        light *= (self._carried_ink(surface) * self._vignette)[..., None]
        return np.asarray(cv2.GaussianBlur(light, (0, 0), self.rig.blur_px), dtype=np.float32)

    def expose(self, light: Singles, rng: np.random.Generator | None, *, averaged: int = 1) -> Bytes:
        """A frame (H, W, 3) of the given light; `averaged` frames make one of less noise; no rng, no noise."""
        response = self.rig.response
        if rng is not None:
            read = response.read_noise / 255 / _slope_at_mid_grey(response)
            std = np.sqrt((np.maximum(light, 0) / np.float32(response.full_well) + np.float32(read**2)) / averaged)
            light = np.asarray(light + std * rng.standard_normal(light.shape, dtype=np.float32), dtype=np.float32)
        index = np.clip(light * np.float32(_STEPS) + np.float32(0.5), 0, _STEPS).astype(np.uint16)
        return np.asarray(255 * _curve(response)[index] + 0.5).astype(np.uint8)

    def picture(self, surface: Surface, rng: np.random.Generator, *, time_s: float = 0.0) -> Bytes:
        """One frame (H, W, 3) of a surface."""
        return self.expose(self.ideal(surface, time_s), rng)

    def _lamps(self, surface: Surface) -> Singles:
        """Light (H, W, 3) of each lamp; of a press between two rendered depths."""
        if not isinstance(surface, PunchPress) or surface.bevel is None:
            return self._rendered(surface)
        depths = _depths_mm(surface)
        low = int(np.clip(np.searchsorted(depths, surface.face_mm, side="right") - 1, 0, depths.size - 2))
        share = float(np.clip((surface.face_mm - depths[low]) / (depths[low + 1] - depths[low]), 0.0, 1.0))
        ends = [replace(surface, face_mm=float(depths[i])) if i else Flat() for i in (low, low + 1)]
        if share in (0.0, 1.0):
            return self._rendered(ends[int(share)])
        before, after = (self._rendered(end) for end in ends)
        return before + np.float32(share) * (after - before)

    def _rendered(self, surface: Surface) -> Singles:
        if surface not in self._recent:
            while len(self._recent) > 4:
                self._recent.pop(next(iter(self._recent)))
            self._recent[surface] = self.tracer.lamps(surface)
        return self._recent[surface]

    @cached_property
    def _recent(self) -> dict[Surface, Singles]:
        return {}

    @cached_property
    def scale(self) -> Floats:
        """Factor of each lamp (3,) that exposes the brightest places of the free gel as drawn."""
        free = self._rendered(Flat())
        levels = np.array([lamp.brightness for lamp in self.rig.lamps])
        scale = levels / np.percentile(free, 99.5, axis=(0, 1))
        colours = np.array([lamp.colour for lamp in self.rig.lamps])
        white = np.percentile(((free * scale) @ colours).max(axis=-1), 99.5)
        return np.asarray(scale * self.rig.response.exposure / white)

    def _gains(self, time_s: float) -> Floats:
        """Each lamp's brightness (3,) at a time: a slow swing, 1 at the start."""
        rng = stream(self.rig.family, self.rig.seed, 7)
        size, period_s = _DRIFT * rng.uniform(-1.0, 1.0, 3), rng.uniform(300.0, 900.0)
        phase = 2.1 * np.arange(3)
        return np.asarray(1 + size * (np.sin(2 * np.pi * time_s / period_s + phase) - np.sin(phase)))

    @cached_property
    def _ink(self) -> Singles:
        """Brightness (H, W) of the ink about 1: grain of one to six pixels."""
        rng, shape = stream(self.rig.family, self.rig.seed, 6), (self.grid.y_mm.size, self.grid.x_mm.size)
        ink = np.ones(shape, np.float32)
        for size, share in ((1.0, 0.6), (2.5, 0.3), (6.0, 0.5)):
            grain = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), size)
            ink += np.float32(self.rig.texture * share) * grain / grain.std()
        return ink

    def _carried_ink(self, surface: Surface) -> Singles:
        step_x, step_y = self.grid.spacing_mm
        shift_x, shift_y = surface.shift_mm(self.grid)
        rows, columns = np.indices(self._ink.shape, dtype=np.float32)
        from_x, from_y = columns - shift_x / np.float32(step_x), rows - shift_y / np.float32(step_y)
        return np.asarray(
            cv2.remap(self._ink, from_x, from_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        )

    @cached_property
    def _vignette(self) -> Singles:
        x, y = self.grid.places()
        half_x, half_y = field_mm(self.rig)
        return np.asarray(1 - self.rig.vignette * ((x / half_x) ** 2 + (y / half_y) ** 2) / 2, dtype=np.float32)


def mix(lamps: Singles, rig: Rig, scale: Floats) -> Singles:
    """Light (H, W, 3) of the channels, 1 is white, from that of each lamp (H, W, 3) times `scale` (3,)."""
    colours = np.array([lamp.colour for lamp in rig.lamps], np.float32)
    return np.asarray((lamps * scale.astype(np.float32)) @ colours, dtype=np.float32)


def build_camera(rig: Rig, cache: Path, *, transport: Transport = "path", samples: int = 16) -> RenderedCamera:
    """The camera of a rig; the rectified frame's middle is the pad's."""
    x = (np.arange(rig.width_px, dtype=np.float64) - (rig.width_px - 1) / 2) * rig.mm_per_px
    y = (np.arange(rig.height_px, dtype=np.float64) - (rig.height_px - 1) / 2) * rig.mm_per_px
    return RenderedCamera(rig, PathTracer(rig, Grid(x, y), cache, transport, samples))


@lru_cache(maxsize=64)
def _depths_of(still: PunchPress) -> Floats:
    assert still.bevel is not None
    touch = still.bevel.touch_depth_mm(still.profile, still.tilt)
    return np.concatenate(
        [
            np.linspace(0.0, touch, max(_MIN_BEFORE, int(np.ceil(touch / _INTERVAL_MM))) + 1),
            touch + np.asarray(_AFTER_MM),
        ]
    )


def _depths_mm(press: PunchPress) -> Floats:
    """Depths of the face at which a press is rendered; the first, 0, is the free gel."""
    return _depths_of(replace(press, face_mm=0.0))


@lru_cache(maxsize=4)
def _curve(response: Response) -> Singles:
    """Grey level (0 to 1) of linear light in steps of 1/_STEPS."""
    x = np.linspace(0.0, 1.0, _STEPS + 1)
    if response.shoulder > 0:
        x = -np.expm1(-response.shoulder * x) / -np.expm1(-response.shoulder)
    return np.asarray(x ** (1 / response.gamma), dtype=np.float32)


def _slope_at_mid_grey(response: Response) -> float:
    curve = _curve(response)
    place = int(np.searchsorted(curve, 0.5))
    return float(curve[place + 8] - curve[place - 8]) * _STEPS / 16
