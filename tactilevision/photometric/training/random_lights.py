"""Lights drawn at random round those of a kind of sensor, and how gel of any slope looks under them, in torch.

Each of three colours is a strip of lamps beside the gel, beamed across it, with a part thrown back by the wall
opposite. A lamp at L (mm, z towards the camera) shines on a place x with e = P B (L - x)/|L - x|^3, B a Gaussian
beam; gel of the slope (p, q) has the normal n = (-p, -q, 1)/sqrt(1 + p^2 + q^2) and sends back

    s(n.e) + gloss |e| max(n.m, 0)^16     s(v) = (v + sqrt(v^2 + (2 d |e|)^2))/2,  m half-way to the camera

times the picture's fields (vignette, uneven ink, by kornia); the camera adds stray light, takes the power
1/gamma, cuts at white, adds noise and rounds. Directions and bounds are a LightKind's (`light_kinds.py`).
The untouched gel may bulge: its own slope is added. Pressed gel casts shadows (`random_surfaces.py`), the bulge
casts none. What no such light shows (gel that lights gel, lens flare) is not in it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactilevision.photometric.training.light_kinds import LightKind, Triple
from tactilevision.records import Pair

if TYPE_CHECKING:
    import torch

GRID = (24, 32)  # of the untouched picture that a reader of light sees
STRIP = 3  # lamps a colour; one more is its light thrown back


@dataclass(frozen=True)
class Scenes:
    """B scenes of L lamps: `place_mm` (B, L, 3), `aim_mm`, `beam_mm` (B, L, 2), `tint` (B, L, 3); the camera's
    `stray` (B, 3), `gamma`, `gloss`, `soft_edge`, `noise_grey` (B, 1), and `fields` (B, 1, *GRID); `size_mm` of
    what the picture shows; `bulge` (B, 2), the untouched gel's slope at the border."""

    place_mm: torch.Tensor
    aim_mm: torch.Tensor
    beam_mm: torch.Tensor
    tint: torch.Tensor
    stray: torch.Tensor
    gamma: torch.Tensor
    gloss: torch.Tensor
    soft_edge: torch.Tensor
    noise_grey: torch.Tensor
    fields: torch.Tensor
    size_mm: Pair
    bulge: torch.Tensor


def draw_scenes(count: int, rng: torch.Generator, kind: LightKind) -> Scenes:
    """`count` sets of lights and cameras. Kornia's fields follow torch's own generator, so seed that as well."""
    import torch

    def uniform(low: float, high: float, *shape: int) -> torch.Tensor:
        return low + (high - low) * torch.rand(*shape, generator=rng)

    astray = kind.astray_deg * torch.randn(count, 3, generator=rng).clamp(-2, 2)
    azimuth = torch.deg2rad(torch.tensor(kind.azimuth_deg) + astray)
    far = _between(kind.nearest_mm, kind.farthest_mm, uniform(0.0, 1.0, count, 3))
    elevation = torch.deg2rad(_between(kind.lowest_deg, kind.highest_deg, uniform(0.0, 1.0, count, 3)))
    high = far * torch.tan(elevation)
    towards = torch.stack([torch.cos(azimuth), -torch.sin(azimuth)], -1)
    along = torch.stack([-towards[..., 1], towards[..., 0]], -1)
    spread = torch.linspace(-1, 1, STRIP)[None, None, :, None] * uniform(0.0, kind.half_length_mm, count, 3, 1, 1)
    flat = (towards * far[..., None])[:, :, None] + along[:, :, None] * spread
    place = torch.cat([flat, high[:, :, None, None].expand(count, 3, STRIP, 1)], -1).reshape(count, -1, 3)
    aim = towards * uniform(*kind.aim_mm, count, 3, 1) + uniform(-3.0, 3.0, count, 3, 2)
    beam = uniform(*kind.beam_mm, count, 3, 2)
    tint = _draw_tints(count, uniform, kind)
    back = uniform(0.0, kind.thrown_back, count, 3, 1) * tint  # by the wall opposite: one lamp for a whole strip
    mirrored = torch.cat([-towards * far[..., None], high[..., None]], -1)
    scenes = Scenes(
        torch.cat([place, mirrored], 1),
        torch.cat([aim.repeat_interleave(STRIP, 1), -aim], 1),
        torch.cat([beam.repeat_interleave(STRIP, 1), 2 * beam], 1),
        torch.cat([tint.repeat_interleave(STRIP, 1), back], 1),
        uniform(0.0, kind.stray, count, 3),
        uniform(*kind.gamma, count, 1),
        uniform(0.0, 0.1, count, 1),
        uniform(*kind.soft_edge, count, 1),
        uniform(0.3, 2.0, count, 1),
        draw_fields(count),
        kind.size_mm,
        torch.zeros(count, 2),
    )
    exposed = _exposed(scenes, uniform(0.6, 1.15, count, 1, 1) ** scenes.gamma[..., None])
    return dataclasses.replace(exposed, bulge=uniform(-kind.bulge, kind.bulge, count, 2))


def _between(low: Triple, high: Triple, share: torch.Tensor) -> torch.Tensor:
    """For each of three lamps what lies at `share` (count, 3) of the way from its bound `low` to `high`."""
    import torch

    least, most = torch.tensor(low), torch.tensor(high)
    return least + (most - least) * share


def _draw_tints(count: int, uniform: Callable[..., torch.Tensor], kind: LightKind) -> torch.Tensor:
    """Share of each colour (count, 3 lamps, 3 channels) in the light of a strip."""
    tint = uniform(*kind.leak, count, 3, 3)
    # green and blue share a good part of their light, red keeps to itself
    tint[:, 1, 2] = uniform(*kind.green_in_blue, count)
    tint[:, 2, 1] = uniform(*kind.blue_in_green, count)
    tint[:, range(3), range(3)] = 1.0
    tint *= uniform(0.5, 1.0, count, 3, 1)
    return tint


def draw_fields(count: int) -> torch.Tensor:
    """What the lens and the ink take away: (count, 1, *GRID), 1 where nothing is lost."""
    import torch
    from kornia import augmentation as draw

    blank = torch.full((count, 1, *GRID), 0.5)
    uneven = draw.AugmentationSequential(
        draw.RandomLinearIllumination(gain=(0.01, 0.2), p=0.5),
        draw.RandomLinearCornerIllumination(gain=(0.01, 0.3), p=0.5),
        draw.RandomGaussianIllumination(gain=(0.01, 0.35), sign=(-1.0, 1.0), p=0.7),
        draw.RandomGaussianNoise(std=0.01, p=1.0),
    )
    return torch.as_tensor(uneven(blank)).clamp(0.05, 1.0) / 0.5


def shade(
    scenes: Scenes, place_mm: torch.Tensor, *, slopes: torch.Tensor, lit: torch.Tensor | None = None
) -> torch.Tensor:
    """Linear light (B, N, 3), 1 is white, of gel at `place_mm` (B, N, 2 or 3) with `slopes` (B, N, 2).

    `lit` (B, N, L) is the share of each lamp that arrives; None is all.
    """
    returned = _returned(scenes, place_mm, slopes)
    returned = returned if lit is None else returned * lit
    light: torch.Tensor = returned @ scenes.tint + scenes.stray[:, None]
    return light


def _returned(scenes: Scenes, place_mm: torch.Tensor, slopes: torch.Tensor) -> torch.Tensor:
    """What of each lamp (B, N, L) comes back, fields included."""
    import torch
    from torch.nn.functional import grid_sample, pad

    at = place_mm if place_mm.shape[-1] == 3 else pad(place_mm, (0, 1))
    ray = scenes.place_mm[:, None] - at[:, :, None]
    square = (ray * ray).sum(-1)
    ray = ray / square.sqrt()[..., None]
    off = (at[:, :, None, :2] - scenes.aim_mm[:, None]) / scenes.beam_mm[:, None]
    strength = torch.exp(-0.5 * (off * off).sum(-1)) / square
    half_mm = 0.5 * torch.tensor(scenes.size_mm)
    total = slopes + scenes.bulge[:, None] * at[..., :2] / half_mm
    normal = pad(-total, (0, 1), value=1.0)[:, :, None]
    normal = normal / normal.norm(dim=-1, keepdim=True)
    facing = (normal * ray).sum(-1)
    soft = 2 * scenes.soft_edge[:, None]
    back = 0.5 * (facing + torch.sqrt(facing * facing + soft * soft))
    half = ray + torch.tensor([0.0, 0.0, 1.0])
    shiny = (normal * half).sum(-1).clamp(min=0.0) / half.norm(dim=-1)
    where = (at[..., :2] / half_mm)[:, None]
    field = grid_sample(scenes.fields, where, padding_mode="border", align_corners=False)
    light: torch.Tensor = (back + scenes.gloss[:, None] * shiny**16) * strength * field[:, 0, 0, :, None]
    return light


def expose(scenes: Scenes, light: torch.Tensor, *, rng: torch.Generator, averaged: int = 1) -> torch.Tensor:
    """Grey levels 0 to 255, of the same shape as `light` (B, N, 3); the mean of `averaged` frames."""
    import torch

    grey = 255.0 * light.clamp(0.0, 1.0) ** (1 / scenes.gamma[:, None])
    noise = torch.randn(grey.shape, generator=rng) * scenes.noise_grey[:, None] / math.sqrt(averaged)
    return (grey + noise).round().clamp(0.0, 255.0)


def lattice(count: int, size_mm: Pair) -> torch.Tensor:
    """Places (count, GRID[0] GRID[1], 2) in mm of the blocks of the untouched picture."""
    import torch

    rows, columns = ((torch.arange(n) + 0.5) / n - 0.5 for n in GRID)
    y, x = torch.meshgrid(rows * size_mm[1], columns * size_mm[0], indexing="ij")
    return torch.stack([x, y], -1).reshape(1, -1, 2).expand(count, -1, 2)


def _exposed(scenes: Scenes, white: torch.Tensor) -> Scenes:
    """Each colour at the brightness drawn for it where it is brightest, then all to `white` (B, 1, 1) together.

    `white` is linear light, 1 is the camera's white.
    """
    count = len(white)
    returned = _returned(
        scenes, lattice(count, scenes.size_mm), scenes.place_mm.new_zeros(count, GRID[0] * GRID[1], 2)
    )
    tint = scenes.tint.clone()
    for colour in range(3):
        lamps = [*range(STRIP * colour, STRIP * (colour + 1)), 3 * STRIP + colour]
        top = (returned[:, :, lamps] @ scenes.tint[:, lamps]).amax((1, 2))
        tint[:, lamps] *= (scenes.tint[:, STRIP * colour].amax(-1) / top)[:, None, None]
    top = (returned @ tint).amax((1, 2))
    return dataclasses.replace(scenes, tint=tint * (white / top[:, None, None]))
