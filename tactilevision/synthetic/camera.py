"""Render a frame of the gel's surface with the optics and noise of a real camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import cv2
import numpy as np

from tactilevision.records.measured import Bytes, Floats, Pair
from tactilevision.sensors import SENSORS
from tactilevision.synthetic.gel import Area, Grid, Singles, Surface
from tactilevision.synthetic.lights import (
    SOUND,
    Finish,
    Light,
    Shine,
    SlopeResponse,
    Strip,
    gelslim_lights,
    random_lights,
    reflect,
    visibility,
)

# surface -> slopes -> light of three lamps (lights.py) -> ink texture and markers, carried by the gel ->
# vignetting -> lens distortion -> blur -> shot and read noise -> response -> 8 bits. Steep parts of the surface
# are rendered on a grid three times finer and averaged over each pixel.

Shares = tuple[Singles, ...] | None
_FINER = 3  # grid points per pixel at steep places
_STEPS = 16383  # levels of the table of the response, 14 bits


class Imaging(Protocol):
    """A camera that renders surfaces."""

    def ideal(self, surface: Surface, time_s: float = 0.0) -> Singles:
        """Return linear light (H, W, 3), 1 is white, without noise."""

    def expose(self, light: Singles, rng: np.random.Generator | None, *, averaged: int = 1) -> Bytes:
        """Return a frame (H, W, 3) of the given light, the mean of `averaged`."""

    def picture(self, surface: Surface, rng: np.random.Generator, *, time_s: float = 0.0) -> Bytes:
        """Return one frame (H, W, 3) of a surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Optics and noise of a camera; see `build_camera`.

    `ink` (H, W): brightness of the ink on the untouched gel; `stray` (H, W, 3): light that bypasses the gel;
    `vignette` (H, W); `to_raw` (x, y): rectified places of the raw pixels, None without distortion; `drift`: the
    lamps' amplitudes and their period in s. Blur, gamma, noise and shadows are those of its `options`.
    """

    grid: Grid
    lights: tuple[Light | Strip, ...]
    finish: Finish
    ink: Singles
    stray: Singles
    vignette: Singles
    to_raw: tuple[Singles, Singles] | None
    drift: tuple[Floats, float]
    options: CameraOptions
    slope_response: SlopeResponse = SOUND

    def ideal(self, surface: Surface, time_s: float = 0.0) -> Singles:
        """Return linear light (H, W, 3), 1 is white, in the camera's raw geometry, without noise."""
        shares = self._shares(surface)
        light = self._reflected(surface, self.grid, time_s, shares)
        for area in surface.steep:
            self._render_finely(light, surface, area, time_s=time_s, shares=shares)
        light *= (_carried(self.ink, surface, self.grid) * self.vignette)[..., None]
        light += self.stray
        if self.to_raw is not None:
            light = cv2.remap(light, *self.to_raw, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        if self.options.blur_px > 0:
            light = cv2.GaussianBlur(light, (0, 0), self.options.blur_px)
        return np.asarray(np.maximum(light, 0.0), dtype=np.float32)

    def expose(self, light: Singles, rng: np.random.Generator | None, *, averaged: int = 1) -> Bytes:
        """Return a frame (H, W, 3) of the given light, the mean of `averaged`; without `rng`, without noise."""
        gamma = self.options.gamma
        if rng is not None:
            # read noise is stated in grey levels near mid-grey, where the response has the slope 0.5^(1/γ-1)/γ
            read = self.options.read_noise / 255 * gamma * 0.5 ** (1 - 1 / gamma)
            std = np.sqrt((light / np.float32(self.options.full_well) + np.float32(read**2)) / averaged)
            noisy = light + std * rng.standard_normal(light.shape, dtype=np.float32)
            light = noisy.astype(np.float32, copy=False)
        index = np.clip(light * np.float32(_STEPS) + np.float32(0.5), 0, _STEPS).astype(np.uint16)
        return np.asarray(_response(gamma)[index] + np.float32(0.5)).astype(np.uint8)

    def picture(self, surface: Surface, rng: np.random.Generator, *, time_s: float = 0.0) -> Bytes:
        """Return one frame (H, W, 3) of a surface."""
        return self.expose(self.ideal(surface, time_s), rng)

    def _gains(self, time_s: float) -> Floats:
        """Return the brightness of each lamp at a time: a slow oscillation, 1 at the start."""
        amplitudes, period_s = self.drift
        phases = np.arange(amplitudes.size) * 2.1
        return np.asarray(1 + amplitudes * (np.sin(2 * np.pi * time_s / period_s + phases) - np.sin(phases)))

    def _shares(self, surface: Surface) -> tuple[Singles, ...] | None:
        """Return the visible share (H, W) of each lamp; None without shadows."""
        size = self.options.shadow_strip_mm
        if size is None:
            return None
        return visibility([light.strip(size) for light in self.lights], surface, self.grid)

    def _reflected(self, surface: Surface, grid: Grid, time_s: float, shares: Shares) -> Singles:
        slopes = self.slope_response.shown(_slopes(surface, grid), time_s)
        shines = _shines(self.lights, grid, self.grid)
        return reflect(shines, self._gains(time_s), slopes=slopes, finish=self.finish, shares=shares)

    def _render_finely(
        self, light: Singles, surface: Surface, area: Area, *, time_s: float, shares: Shares
    ) -> None:
        part, fine = _window(self.grid, area)
        inner = light[part]
        if min(inner.shape[:2]) < 5:
            return
        if shares is not None:
            size = fine.x_mm.size, fine.y_mm.size
            shares = tuple(cv2.resize(share[part], size, interpolation=cv2.INTER_LINEAR) for share in shares)
        rendered = self._reflected(surface, fine, time_s, shares)
        small = cv2.resize(rendered, (inner.shape[1], inner.shape[0]), interpolation=cv2.INTER_AREA)
        inner[2:-2, 2:-2] = small[2:-2, 2:-2]  # the rim keeps the coarse slopes


@lru_cache(maxsize=16)
def _window(grid: Grid, area: Area) -> tuple[tuple[slice, slice], Grid]:
    """Return the finer grid of an area, cached so that its light is computed once."""
    part = grid.part(area)
    return part, grid.finer(part, _FINER)


@lru_cache(maxsize=8)
def _shines(lights: tuple[Light | Strip, ...], grid: Grid, reference: Grid) -> tuple[Shine, ...]:
    return tuple(light.shine(grid, reference=reference) for light in lights)


@lru_cache(maxsize=8)
def _response(gamma: float) -> Singles:
    """Return the grey level (0 to 255) of linear light in steps of 1/_STEPS."""
    return np.asarray(255 * np.linspace(0.0, 1.0, _STEPS + 1) ** (1 / gamma), dtype=np.float32)


def _slopes(surface: Surface, grid: Grid) -> tuple[Singles, Singles]:
    """Return slopes dz/dx, dz/dy (H, W) by central differences on the grid."""
    depth = surface.depth_mm(grid)
    step_x, step_y = grid.spacing_mm
    kernel = np.array([-0.5, 0.0, 0.5], np.float32)
    one = np.ones(1, np.float32)
    p = cv2.sepFilter2D(depth, -1, kernel / np.float32(step_x), one, borderType=cv2.BORDER_REPLICATE)
    q = cv2.sepFilter2D(depth, -1, one, kernel / np.float32(step_y), borderType=cv2.BORDER_REPLICATE)
    return p, q


@lru_cache(maxsize=2)
def _indices(shape: tuple[int, int]) -> tuple[Singles, Singles]:
    rows, columns = np.indices(shape, dtype=np.float32)
    return rows, columns


def _carried(ink: Singles, surface: Surface, grid: Grid) -> Singles:
    """Return the brightness of the ink, carried by the gel."""
    step_x, step_y = grid.spacing_mm
    shift_x, shift_y = surface.shift_mm(grid)
    rows, columns = _indices(ink.shape)
    from_x, from_y = columns - shift_x / np.float32(step_x), rows - shift_y / np.float32(step_y)
    return np.asarray(cv2.remap(ink, from_x, from_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101))


# Options and random parts of a camera: lens, ink, markers, stray light, vignetting, noise.

GELSLIM3 = SENSORS["gelslim3"]


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """Options of a simulated camera.

    `light_seed`: None for the lights of GelSlim 3.0, or the seed of three random lights. `texture`: relative
    contrast of the ink; `distortion_px`: largest displacement by the lens (0: rectified frames); `drift`: relative
    oscillation of the lamps. Noise: `full_well` electrons at white, `read_noise` in grey levels.
    `shadow_strip_mm`: the lamps cast shadows as strips of this length and width.
    """

    width_px: int = GELSLIM3.width_px
    height_px: int = GELSLIM3.height_px
    mm_per_px: Pair = GELSLIM3.mm_per_px
    light_seed: int | None = None
    markers: bool = False
    texture: float = 0.012
    distortion_px: float = 9
    blur_px: float = 0.6
    gamma: float = 1.8
    full_well: float = 12_000
    read_noise: float = 0.6
    drift: float = 0.003
    shadow_strip_mm: Pair | None = None

    @property
    def half_mm(self) -> Pair:
        """Half of the picture's width and height."""
        return self.width_px * self.mm_per_px[0] / 2, self.height_px * self.mm_per_px[1] / 2


def build_camera(options: CameraOptions, rng: np.random.Generator) -> Camera:
    """Return a camera of the given options; `rng` gives ink, dirt and drift."""
    width, height = options.width_px, options.height_px
    x = (np.arange(width, dtype=np.float64) - (width - 1) / 2) * options.mm_per_px[0]
    y = (np.arange(height, dtype=np.float64) - (height - 1) / 2) * options.mm_per_px[1]
    grid = Grid(x, y)
    random = options.light_seed is not None
    lights = random_lights(np.random.default_rng(options.light_seed)) if random else gelslim_lights()
    return Camera(
        grid=grid,
        lights=lights,
        finish=Finish(),
        ink=_ink(grid, options, rng),
        stray=_stray(grid, random),
        vignette=_vignette(grid, random),
        to_raw=distortion(options)[1] if options.distortion_px > 0 else None,
        drift=(options.drift * rng.uniform(0.3, 1.0, 3) * rng.choice([-1.0, 1.0], 3), rng.uniform(300, 900)),
        options=options,
    )


Maps = tuple[Singles, Singles]  # map_x, map_y: out[y, x] = in[map_y, map_x]


def distortion(options: CameraOptions) -> tuple[Maps, Maps]:
    """Return the maps that rectify raw frames, and their inverse, for a barrel distortion with keystone.

    It keeps the border of the frame:

    raw = rectified + d (x + k y, y + k x) (1 - x²)(1 - y²)/b for x, y from -1 to 1 across the frame, with the
    largest displacement d = distortion_px; inverted by fixed-point iteration.
    """
    width, height = options.width_px, options.height_px
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))

    def moved(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        u, v = 2 * x / (width - 1) - 1, 2 * y / (height - 1) - 1
        bow = options.distortion_px * (1 - u * u) * (1 - v * v) / 0.47
        return x - bow * (u + 0.25 * v), y - bow * (v + 0.15 * u)

    x, y = columns.copy(), rows.copy()
    for _ in range(30):
        there_x, there_y = moved(x, y)
        x, y = x + columns - there_x, y + rows - there_y
    map_x, map_y = (np.round(64 * m) / 64 for m in moved(columns, rows))  # so that the file packs well
    single = np.float32
    return (map_x.astype(single), map_y.astype(single)), (x.astype(single), y.astype(single))


def _ink(grid: Grid, options: CameraOptions, rng: np.random.Generator) -> Singles:
    """Return the brightness of the ink about 1: grain of one to six pixels, some dirt, and optional markers."""
    shape = grid.y_mm.size, grid.x_mm.size
    ink = np.ones(shape, np.float32)
    for size, share in ((1.0, 0.6), (2.5, 0.3), (6, 0.5)):
        grain = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), size)
        ink += np.float32(options.texture * share) * grain / grain.std()
    x, y = grid.places()
    for _ in range(3):
        at, size = rng.uniform(-0.9, 0.9, 2) * (grid.x_mm[-1], grid.y_mm[-1]), rng.uniform(0.1, 0.4)
        spot = np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * size**2))
        ink *= (1 - rng.uniform(0.01, 0.05) * spot).astype(np.float32)
    return ink * _markers(grid, rng) if options.markers else ink


def _markers(grid: Grid, rng: np.random.Generator) -> Singles:
    """Return pairs of dark dots on a lattice, as a laser cuts them: 1 around them, dark on them."""
    x, y = grid.places()
    pitch_mm = 1.6
    cell_x, cell_y = np.round(x / pitch_mm), np.round(y / pitch_mm)
    jitter = rng.normal(0.0, 0.03, 2)
    dark = np.zeros_like(x)
    for offset in (-0.18, 0.18):
        distance = np.hypot(x - pitch_mm * cell_x - offset - jitter[0], y - pitch_mm * cell_y - jitter[1])
        dark = np.maximum(dark, 1 / (1 + np.exp((distance - 0.16) / 0.03)))
    return np.asarray(1 - 0.75 * dark, dtype=np.float32)


def _stray(grid: Grid, random: bool) -> Singles:
    """Return the light that bypasses the gel; that of GelSlim is reddish in the top left corner."""
    level = (0.004, 0.03, 0.015) if random else (0.0, 0.03, 0.02)
    stray = np.broadcast_to(np.array(level, np.float32), (grid.y_mm.size, grid.x_mm.size, 3)).copy()
    if not random:
        x, y = grid.places()
        stray[..., 0] += 0.13 * np.exp(-(((x + 13) / 8.8) ** 2) - ((y + 10) / 7) ** 2)
    return stray


def _vignette(grid: Grid, random: bool) -> Singles:
    """Return the fall-off towards the corners: a soft ellipse, wide and shifted downwards for GelSlim."""
    x, y = grid.places()
    u, v = x / abs(float(grid.x_mm[-1])), y / abs(float(grid.y_mm[-1]))
    if random:
        return np.asarray(0.1 + 0.9 / (1 + np.exp((np.hypot(u, v) - 1.3) / 0.12)), dtype=np.float32)
    return np.asarray(1 / (1 + np.exp((np.hypot(u - 0.07, 0.66 * (v - 0.14)) - 0.79) / 0.14)), dtype=np.float32)
