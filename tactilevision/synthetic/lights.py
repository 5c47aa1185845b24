"""Three near-field coloured lights over a gel, and how their light comes back from a slope.

At a place on the pad a light at position L (z towards the camera) shines with the vector e = I B (L - x)/|L - x|³,
B a Gaussian beam round the place it is aimed at. A surface of depth slope (p, q) has the normal
n = (-p, -q, 1)/sqrt(1 + p² + q²) and sends back

    s(n·e)  +  gloss |e| (n·m)^16        s(v) = (v + sqrt(v² + (2δ|e|)²))/2

with m half-way between light and camera. s lets a wall that is steeper than the light stands high go dark
over the soft edge δ that an extended light makes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.records import Floats, Pair
from tactilevision.synthetic.gel import Grid, Singles

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Light:
    """One lamp: `position_mm` from the pad's centre, `aim_mm` and `beam_mm` of its Gaussian beam (a spread per
    axis), `brightness` it gives the brightest place of a pad of GelSlim's size, `colour` it gives the channels."""

    position_mm: Triple
    aim_mm: Pair
    beam_mm: Pair
    brightness: float
    colour: Triple


@dataclass(frozen=True, slots=True)
class Finish:
    """How the ink returns light: `gloss` of its highlight, `soft_edge` δ of attached shadows."""

    gloss: float = 0.03
    soft_edge: float = 0.06


@dataclass(frozen=True, slots=True)
class Shine:
    """One light on one grid: its vector (ex, ey, ez), (H, W) each, and its half-way direction."""

    vector: tuple[Singles, Singles, Singles]
    strength: Singles
    half_way: tuple[Singles, Singles, Singles]
    colour: Triple


def shine(light: Light, grid: Grid, *, reference: Grid) -> Shine:
    """The light on a grid; `reference` is the whole pad, on which its brightness is defined."""
    x, y, z, strength = _rays(light, grid)
    _, _, z_all, strength_all = _rays(light, reference)
    strength = strength * np.float32(light.brightness / float((strength_all * z_all).max()))
    norm = np.sqrt(x * x + y * y + (z + 1) ** 2)
    vector = _single(strength * x), _single(strength * y), _single(strength * z)
    return Shine(vector, strength, (_single(x / norm), _single(y / norm), _single((z + 1) / norm)), light.colour)


def shine_of(vector: tuple[Singles, Singles, Singles], scale: np.float32, *, colour: Triple) -> Shine:
    """A light given by its vector (x, y, z), (H, W) each in a unit of its own, times `scale`, 1."""
    strength = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    x, y, z = (axis / strength for axis in vector)
    norm = np.sqrt(x * x + y * y + (z + 1) ** 2)
    scaled = _single(vector[0] * scale), _single(vector[1] * scale), _single(vector[2] * scale)
    return Shine(scaled, _single(strength * scale), (x / norm, y / norm, (z + 1) / norm), colour)


def _single(values: npt.NDArray[Any]) -> Singles:
    return np.asarray(values, dtype=np.float32)


def _rays(light: Light, grid: Grid) -> tuple[Singles, Singles, Singles, Singles]:
    """Unit direction to the light and unscaled strength, (H, W) each."""
    px, py = grid.places()
    dx, dy, dz = light.position_mm[0] - px, light.position_mm[1] - py, np.float32(light.position_mm[2])
    squared = dx * dx + dy * dy + dz * dz
    root = np.sqrt(squared)
    ax, ay = (px - light.aim_mm[0]) / light.beam_mm[0], (py - light.aim_mm[1]) / light.beam_mm[1]
    beam = np.exp(-0.5 * (ax * ax + ay * ay)).astype(np.float32)
    return _single(dx / root), _single(dy / root), _single(dz / root), _single(beam / squared)


def reflect(
    shines: tuple[Shine, ...],
    gains: Floats,
    *,
    slopes: tuple[Singles, Singles],
    finish: Finish,
    shares: tuple[Singles, ...] | None = None,
) -> Singles:
    """Linear light (H, W, 3) that reaches the camera from slopes dz/dx, dz/dy, each lamp times its gain.

    `shares` is how much of each lamp (H, W) each place sees; None: all of every lamp.
    """
    p, q = slopes
    up = 1 / np.sqrt(1 + p * p + q * q)
    light = np.zeros((*p.shape, 3), np.float32)
    for i, (lamp, gain) in enumerate(zip(shines, gains, strict=True)):
        ex, ey, ez = lamp.vector
        v = (ez - p * ex - q * ey) * up
        soft = np.float32(2 * finish.soft_edge) * lamp.strength
        back = 0.5 * (v + np.sqrt(v * v + soft * soft))
        if finish.gloss > 0:
            mx, my, mz = lamp.half_way
            shiny = np.maximum((mz - p * mx - q * my) * up, 0.0)
            for _ in range(4):
                shiny = shiny * shiny
            back = back + np.float32(finish.gloss) * lamp.strength * shiny
        if shares is not None:
            back = back * shares[i]
        for channel, share in enumerate(lamp.colour):
            if share > 0:
                light[..., channel] += np.float32(share * gain) * back
    return light


def gelslim_lights() -> tuple[Light, ...]:
    """Blue from the top, green from the left, red from the lower right, as GelSlim 3.0's frames show them."""
    return (
        Light((4.6, 11.0, 8.1), (-1.2, 4.2), (8.0, 8.0), 0.82, (1.0, 0.0, 0.12)),
        Light((-19.4, 3.1, 5.0), (14.0, -0.7), (21.7, 14.0), 2.09, (0.0, 1.0, 0.70)),
        Light((8.4, -12.4, 8.9), (-6.2, 11.0), (12.0, 17.3), 1.21, (0.0, 0.17, 1.0)),
    )


def random_lights(rng: np.random.Generator) -> tuple[Light, ...]:
    """Three lights about 120 degrees apart, at random elevations, distances, beams, colours and order."""
    start, hand = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
    lights = []
    for i, main in enumerate(rng.permutation(3)):
        angle = start + hand * (i * 2 * np.pi / 3 + rng.uniform(-0.35, 0.35))
        out, height = rng.uniform(14.0, 24.0), rng.uniform(9.0, 20.0)
        direction = np.array([np.cos(angle), np.sin(angle)])
        aim = direction * rng.uniform(0.0, 7.0) + rng.uniform(-2.0, 2.0, 2)
        beam = rng.uniform(10.0, 22.0, 2)
        colour = rng.uniform(0.02, 0.30, 3)
        colour[main] = 1.0
        x, y = direction * out
        lights.append(
            Light(
                (float(x), float(y), float(height)),
                (float(aim[0]), float(aim[1])),
                (float(beam[0]), float(beam[1])),
                float(rng.uniform(0.45, 0.75)),
                (float(colour[0]), float(colour[1]), float(colour[2])),
            )
        )
    return tuple(lights)
