"""The parts of a camera that a seed draws: lens, ink, markers, stray light, vignetting, noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.records import Floats, Pair
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import Grid, Singles
from tactilevision.synthetic.lights import Finish, gelslim_lights, random_lights


@dataclass(frozen=True, slots=True)
class CameraOptions:
    """What a simulated camera is like.

    `light_seed` None: the lights of GelSlim 3.0; a number: three lights drawn from it. `texture` is the ink's
    relative contrast, `distortion_px` the lens' largest displacement (0: frames are rectified already),
    `drift` the lamps' relative swing during a recording. Noise: `full_well` electrons at white,
    `read_noise` in grey levels. `shadow_strip_mm`: the lamps cast shadows, as strips of this length and width do.
    """

    width_px: int = 427
    height_px: int = 320
    mm_per_px: Pair = (0.0634, 0.0634)
    light_seed: int | None = None
    markers: bool = False
    texture: float = 0.012
    distortion_px: float = 9.0
    blur_px: float = 0.6
    gamma: float = 1.8
    full_well: float = 12000.0
    read_noise: float = 0.6
    drift: float = 0.003
    gloss: float = 0.03
    shadow_strip_mm: Pair | None = None


def build_camera(options: CameraOptions, rng: np.random.Generator) -> Camera:
    """A camera of the given kind; `rng` draws the ink, the dirt and the phase of the drift."""
    width, height = options.width_px, options.height_px
    x = (np.arange(width, dtype=np.float64) - (width - 1) / 2) * options.mm_per_px[0]
    y = (np.arange(height, dtype=np.float64) - (height - 1) / 2) * options.mm_per_px[1]
    grid = Grid(x, y)
    drawn = options.light_seed is not None
    lights = random_lights(np.random.default_rng(options.light_seed)) if drawn else gelslim_lights()
    return Camera(
        grid=grid,
        lights=lights,
        finish=Finish(gloss=options.gloss),
        ink=_ink(grid, options, rng),
        stray=_stray(grid, drawn),
        vignette=_vignette(grid, drawn),
        to_raw=distortion(options).to_raw if options.distortion_px > 0 else None,
        blur_px=options.blur_px,
        gamma=options.gamma,
        full_well=options.full_well,
        read_noise=options.read_noise,
        drift=(options.drift * rng.uniform(0.3, 1.0, 3) * rng.choice([-1.0, 1.0], 3), rng.uniform(300.0, 900.0)),
        shadow_strip_mm=options.shadow_strip_mm,
    )


@dataclass(frozen=True, slots=True)
class Distortion:
    """The lens. `to_rectified` (map_x, map_y): rectified[y, x] = raw[map_y, map_x]; `to_raw` is its inverse."""

    to_rectified: tuple[Singles, Singles]
    to_raw: tuple[Singles, Singles]


def distortion(options: CameraOptions) -> Distortion:
    """A barrel with keystone that leaves the frame's border where it is.

    raw = rectified + d (x + k y, y + k x) (1 - x²)(1 - y²)/b for x, y from -1 to 1 across the frame, its largest
    displacement d = distortion_px; inverted by repeated substitution.
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
    return Distortion((map_x.astype(single), map_y.astype(single)), (x.astype(single), y.astype(single)))


def _ink(grid: Grid, options: CameraOptions, rng: np.random.Generator) -> Singles:
    """Brightness of the ink about 1: grain of one to six pixels, some dirt, and markers where asked for."""
    shape = grid.y_mm.size, grid.x_mm.size
    ink = np.ones(shape, np.float32)
    for size, share in ((1.0, 0.6), (2.5, 0.3), (6.0, 0.5)):
        grain = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), size)
        ink += np.float32(options.texture * share) * grain / grain.std()
    x, y = grid.places()
    for _ in range(3):
        at, size = rng.uniform(-0.9, 0.9, 2) * (grid.x_mm[-1], grid.y_mm[-1]), rng.uniform(0.1, 0.4)
        spot = np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * size**2))
        ink *= (1 - rng.uniform(0.01, 0.05) * spot).astype(np.float32)
    return ink * _markers(grid, rng) if options.markers else ink


def _markers(grid: Grid, rng: np.random.Generator) -> Singles:
    """Dark dots, two by two, on a lattice of 1.6 mm, as a laser cuts them: 1 beside them, dark on them."""
    x, y = grid.places()
    cell_x, cell_y = np.round(x / 1.6), np.round(y / 1.6)
    jitter = rng.normal(0.0, 0.03, 2)
    dark = np.zeros_like(x)
    for offset in (-0.18, 0.18):
        distance = np.hypot(x - 1.6 * cell_x - offset - jitter[0], y - 1.6 * cell_y - jitter[1])
        dark = np.maximum(dark, 1 / (1 + np.exp((distance - 0.16) / 0.03)))
    return np.asarray(1 - 0.75 * dark, dtype=np.float32)


def _stray(grid: Grid, drawn: bool) -> Singles:
    """Light that reaches the chip without the gel; GelSlim's has a reddish corner at the top left."""
    level = (0.004, 0.03, 0.015) if drawn else (0.0, 0.03, 0.02)
    stray = np.broadcast_to(np.array(level, np.float32), (grid.y_mm.size, grid.x_mm.size, 3)).copy()
    if not drawn:
        x, y = grid.places()
        stray[..., 0] += 0.13 * np.exp(-(((x + 13.0) / 8.8) ** 2) - ((y + 10.0) / 7.0) ** 2)
    return stray


def _vignette(grid: Grid, drawn: bool) -> Singles:
    """Fall-off towards the corners: a soft ellipse, for GelSlim shifted downwards and wide."""
    x, y = grid.places()
    u, v = x / abs(float(grid.x_mm[-1])), y / abs(float(grid.y_mm[-1]))
    if drawn:
        return np.asarray(0.1 + 0.9 / (1 + np.exp((np.hypot(u, v) - 1.3) / 0.12)), dtype=np.float32)
    return np.asarray(1 / (1 + np.exp((np.hypot(u - 0.07, 0.66 * (v - 0.14)) - 0.79) / 0.14)), dtype=np.float32)
