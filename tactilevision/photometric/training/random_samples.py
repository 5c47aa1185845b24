"""Samples under drawn lights: what a method learns from that is to work before any ball is pressed.

Each scene of `random_lights.py` shows bodies of `random_surfaces.py`, each pressed alone, at random places on
them and on the gel beside them, some of it of a fine texture; and untouched gel. Of each lamp arrives what the
body's shadow leaves. Colour changes are counted from the scene's own averaged reference, as `colour_change.py`
counts them.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.photometric.ball.samples import Samples, join
from tactilevision.photometric.illumination.camera_response import SOFTENING_GREY
from tactilevision.photometric.reference import MIN_SIGNAL, SATURATED
from tactilevision.photometric.training.light_kinds import LIGHT_KINDS, LightKind
from tactilevision.photometric.training.random_lights import draw_scenes, expose, shade
from tactilevision.photometric.training.random_surfaces import BODIES, draw_places, draw_surfaces, lit_share
from tactilevision.photometric.training.single_core import one_core

if TYPE_CHECKING:
    import torch

BATCH = 32  # scenes drawn together; bounds the memory, and fixes which numbers are drawn
EACH = 128  # samples a scene
TEXTURED = 0.1  # share of samples with a fine texture
TEXTURE = 0.1  # one sigma of its slopes, no unit
AVERAGED = 16  # frames of the reference


def draw_samples(scenes: int, seed: int, *, kind: str = "gelslim3") -> tuple[Samples, Samples]:
    """Samples of pressed and of untouched gel under at least `scenes` lights; `press` numbers the scene."""
    import torch

    rng = torch.Generator().manual_seed(seed)
    with one_core(seed), torch.no_grad():
        parts = [_draw(BATCH * k, rng, LIGHT_KINDS[kind]) for k in range(math.ceil(scenes / BATCH))]
    return join([pressed for pressed, _ in parts]), join([still for _, still in parts])


def _draw(first: int, rng: torch.Generator, kind: LightKind) -> tuple[Samples, Samples]:
    import torch

    scenes, surfaces = draw_scenes(BATCH, rng, kind), draw_surfaces(BATCH, rng, kind.size_mm)
    at = draw_places(surfaces, EACH // BODIES, rng, kind.size_mm)
    upright = kind.upright_mm[0] + (kind.upright_mm[1] - kind.upright_mm[0]) * torch.rand(BATCH, 1, generator=rng)
    lit, height, slopes, where = (
        part.reshape(BATCH, EACH, -1)
        for part in (
            lit_share(surfaces, at, scenes.place_mm, upright),
            surfaces.height(at),
            surfaces.slopes(at),
            at,
        )
    )
    textured = torch.rand(BATCH, EACH, 1, generator=rng) < TEXTURED
    slopes = slopes + textured * TEXTURE * torch.randn(BATCH, EACH, 2, generator=rng)
    untouched = shade(scenes, where, slopes=torch.zeros_like(slopes))
    level = expose(scenes, untouched, rng=rng, averaged=AVERAGED)
    seen = shade(scenes, torch.cat([where, height], -1), slopes=slopes, lit=lit)
    pressed, still = (expose(scenes, light, rng=rng) for light in (seen, untouched))
    usable = (level.amax(-1) < SATURATED) & (pressed.amax(-1) < SATURATED) & (level.amax(-1) > MIN_SIGNAL)
    scene = torch.arange(first, first + BATCH)[:, None].expand(-1, EACH)
    place = where / (0.5 * torch.tensor(kind.size_mm))

    def samples(grey: torch.Tensor, slope: torch.Tensor) -> Samples:
        change = (grey - level) / (level + SOFTENING_GREY)
        picked = [part[usable].double().numpy() for part in (change, place, slope)]
        return Samples(picked[0], picked[1], picked[2], np.asarray(scene[usable].numpy(), np.int64))

    return samples(pressed, slopes), samples(still, torch.zeros_like(slopes))
