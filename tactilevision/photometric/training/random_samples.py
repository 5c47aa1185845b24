"""Samples under drawn lights: what a method learns from that is to work before any ball is pressed.

Each scene of `random_lights.py` shows gel of known slopes at random places: under balls (up to a slope of .3 to
.7), on walls of every steepness to 42 degrees, in fine textures; and untouched gel. Its colour changes are counted
from its own averaged reference, as `colour_change.py` counts them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.photometric.ball.samples import Samples, join
from tactilevision.photometric.illumination.camera_response import SOFTENING_GREY
from tactilevision.photometric.reference import MIN_SIGNAL, SATURATED
from tactilevision.photometric.training.light_kinds import LIGHT_KINDS, LightKind
from tactilevision.photometric.training.random_lights import STRIP, draw_scenes, expose, shade
from tactilevision.photometric.training.single_core import one_core

if TYPE_CHECKING:
    import torch

BATCH = 32  # scenes drawn together; bounds the memory, and fixes which numbers are drawn
EACH = 128  # samples a scene
AVERAGED = 16  # frames of the reference


def draw_samples(scenes: int, seed: int, *, kind: str = "gelslim3") -> tuple[Samples, Samples]:
    """Samples of pressed and of untouched gel under at least `scenes` lights; `press` numbers the scene."""
    import torch

    rng = torch.Generator().manual_seed(seed)
    with one_core(seed), torch.no_grad():
        parts = [_draw(BATCH * k, rng, LIGHT_KINDS[kind]) for k in range(math.ceil(scenes / BATCH))]
    return join([pressed for pressed, _ in parts]), join([still for _, still in parts])


def draw_slopes(count: int, rng: torch.Generator) -> torch.Tensor:
    """Slopes (count, EACH, 2): under balls, on walls, of textures."""
    import torch

    def uniform(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=rng)

    angle = 2 * math.pi * uniform(count, EACH, 1)
    towards = torch.cat([angle.cos(), angle.sin()], -1)
    ball = (0.3 + 0.4 * uniform(count, 1, 1)) * uniform(count, EACH, 1).sqrt() * towards
    wall = 0.9 * uniform(count, EACH, 1) * towards
    texture = 0.1 * torch.randn(count, EACH, 2, generator=rng)
    which = uniform(count, EACH, 1)
    return torch.where(which < 0.8, ball, torch.where(which < 0.9, wall, texture))


def draw_shade(kind: LightKind, rng: torch.Generator) -> torch.Tensor | None:
    """The share of each lamp (BATCH, EACH, L) that arrives where another part of the gel may stand in its way."""
    import torch

    if not kind.shaded:
        return None
    lit = torch.ones(BATCH, EACH, 3 * STRIP + 3)
    fewer = torch.rand(BATCH, EACH, generator=rng)
    lamp = torch.randint(3, (BATCH, EACH), generator=rng)
    for colour in range(3):
        here = (lamp == colour) & (torch.rand(BATCH, EACH, generator=rng) < kind.shaded)
        lamps = [*range(STRIP * colour, STRIP * (colour + 1)), 3 * STRIP + colour]
        lit[:, :, lamps] = torch.where(here, fewer, 1.0)[..., None]
    return lit


def _draw(first: int, rng: torch.Generator, kind: LightKind) -> tuple[Samples, Samples]:
    import torch

    scenes = draw_scenes(BATCH, rng, kind)
    place = 2 * torch.rand(BATCH, EACH, 2, generator=rng) - 1
    where = place * torch.tensor(kind.size_mm) / 2
    slopes = draw_slopes(BATCH, rng)
    raised = torch.cat([where, torch.rand(BATCH, EACH, 1, generator=rng)], -1)  # pressed gel lies up to 1 mm up
    untouched = shade(scenes, where, slopes=torch.zeros_like(slopes))
    level = expose(scenes, untouched, rng=rng, averaged=AVERAGED)
    lit = draw_shade(kind, rng)
    pressed, still = (
        expose(scenes, shade(scenes, raised, slopes=slopes, lit=lit), rng=rng),
        expose(scenes, untouched, rng=rng),
    )
    usable = (level.amax(-1) < SATURATED) & (pressed.amax(-1) < SATURATED) & (level.amax(-1) > MIN_SIGNAL)
    scene = torch.arange(first, first + BATCH)[:, None].expand(-1, EACH)

    def samples(grey: torch.Tensor, slope: torch.Tensor) -> Samples:
        change = (grey - level) / (level + SOFTENING_GREY)
        picked = [part[usable].double().numpy() for part in (change, place, slope)]
        return Samples(picked[0], picked[1], picked[2], np.asarray(scene[usable].numpy(), np.int64))

    return samples(pressed, slopes), samples(still, torch.zeros_like(slopes))
