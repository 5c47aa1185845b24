"""Simulate random lights, gel surfaces and cast shadows in torch to train the network."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.photometric.ball_samples import Samples, join
from tactilevision.photometric.drift import SOFTENING_GREY
from tactilevision.photometric.network_training import one_core
from tactilevision.photometric.reference import MIN_SIGNAL, SATURATED
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Pair
from tactilevision.sensors import SENSORS

if TYPE_CHECKING:
    import torch


# Distributions of lamps, gel and camera of a kind of sensor, one record a kind.
#
# Azimuths are those of the lamps, from x to the top of the picture. GelSlim 3.0 and GelSight Mini: centred on
# lamps fitted to 10 and 49 balls of one real sensor each. DIGIT: three lamps as facebookresearch/tacto states in
# its config_digit.yml (30, 150 and 270 degrees), turned and bounded to fit 14 balls of one real sensor, and spread
# widely.

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class LightKind:
    """Bounds of uniform distributions; triples are of the red, green and blue lamp."""

    kind: str  # of sensor
    azimuth_deg: Triple
    azimuth_std_deg: float  # truncated at two standard deviations
    nearest_mm: Triple  # distance of a lamp from the middle
    farthest_mm: Triple
    lowest_deg: Triple  # elevation of a lamp
    highest_deg: Triple
    half_length_mm: float  # of a strip of lamps, at most
    aim_mm: Pair  # where a beam meets the gel, from the middle towards its lamp
    beam_mm: Pair  # standard deviation of a beam
    leak: Pair  # share of a lamp in other colours
    green_in_blue: Pair
    blue_in_green: Pair
    reflected: float  # share of a lamp's light from the wall opposite, at most
    stray: float  # of white, at most
    bulge: float  # slope of the untouched gel at the border, at most
    soft_edge: Pair = (0.01, 0.08)  # of attached shadows
    gamma: Pair = (1.0, 2.0)  # of the camera

    @property
    def size_mm(self) -> Pair:
        """Size of the rectified picture, to a tenth of a mm."""
        sensor = SENSORS[self.kind]
        return round(sensor.width_px * sensor.mm_per_px[0], 1), round(sensor.height_px * sensor.mm_per_px[1], 1)


UPRIGHT_MM = (1, 4)  # height of a lamp, which sets its penumbrae
DIGIT_LEAK = (0.05, 0.25)  # share of a lamp in another colour
_KINDS = (
    LightKind(
        "gelslim3",
        azimuth_deg=(-54, 179, 60),
        azimuth_std_deg=6,
        nearest_mm=(20, 38, 32),
        farthest_mm=(30, 70, 60),
        lowest_deg=(6, 11, 22),
        highest_deg=(10, 19, 34),
        half_length_mm=5,
        aim_mm=(-9, 0),
        beam_mm=(9, 16),
        leak=(0, 0.05),
        green_in_blue=(0, 0.1),
        blue_in_green=(0.1, 0.25),
        reflected=0.1,
        stray=0.02,
        bulge=0.05,
        soft_edge=(0.005, 0.02),
        gamma=(1.5, 2.4),
    ),
    LightKind(
        "gelsight_mini",
        azimuth_deg=(97, -1, -97),
        azimuth_std_deg=6,
        nearest_mm=(50, 45, 45),
        farthest_mm=(80, 80, 80),
        lowest_deg=(9, 10, 11),
        highest_deg=(16, 18, 22),
        half_length_mm=8,
        aim_mm=(-9, 1),
        beam_mm=(4, 8),
        leak=(0, 0.08),
        green_in_blue=(0.2, 0.5),
        blue_in_green=(0.05, 0.15),
        reflected=0.25,
        stray=0.1,
        bulge=0.1,
        soft_edge=(0.05, 0.1),
        gamma=(1.3, 2.1),
    ),
    LightKind(
        "digit",
        azimuth_deg=(45, 152, -76),
        azimuth_std_deg=12,
        nearest_mm=(18, 18, 18),
        farthest_mm=(40, 40, 40),
        lowest_deg=(10, 10, 10),
        highest_deg=(30, 30, 30),
        half_length_mm=2,
        aim_mm=(-10, 0),
        beam_mm=(5, 10),
        leak=DIGIT_LEAK,
        green_in_blue=DIGIT_LEAK,
        blue_in_green=DIGIT_LEAK,
        reflected=0.3,
        stray=0.1,
        bulge=0.15,
    ),
)
LIGHT_KINDS = {light.kind: light for light in _KINDS}


# Random lights of a kind of sensor, and the appearance of gel of any slope under them, in torch.
#
# Each of three colours is a beamed strip of lamps next to the gel, partly reflected by the wall opposite. A lamp
# at L (mm, z towards the camera) gives at a place x the vector e = P B (L - x)/|L - x|^3, B a Gaussian beam; gel
# of slope (p, q) with normal n = (-p, -q, 1)/sqrt(1 + p^2 + q^2) returns
#
#     s(n.e) + gloss |e| max(n.m, 0)^16     s(v) = (v + sqrt(v^2 + (2 d |e|)^2))/2,  m half-way to the camera
#
# times vignette and uneven ink (kornia); the camera adds stray light, takes the power 1/gamma, saturates at white,
# adds noise and rounds. The untouched gel may bulge by a slope of its own, which casts no shadow. Not included:
# light from gel to gel, lens flare.

GRID = (24, 32)  # of the fields and of the brightness of the untouched picture
STRIP = 3  # lamps per colour, and one for the reflected light
FAINT = 0.01  # least vignetting, and grain of the ink


@dataclass(frozen=True)
class Scenes:
    """B scenes of L lamps: `place_mm` (B, L, 3), `aim_mm`, `beam_mm` (B, L, 2), `tint` (B, L, 3).

    Of the camera: `stray` (B, 3), `gamma`, `gloss`, `soft_edge`, `noise_grey` (B, 1), and `fields` (B, 1, *GRID).
    `size_mm` of the picture; `bulge` (B, 2), the untouched gel's slope at the border.
    """

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
    """Return `count` sets of lights and cameras. Kornia uses torch's global generator: seed that as well."""
    import torch

    uniform = partial(_uniform, rng)
    turned = kind.azimuth_std_deg * torch.randn(count, 3, generator=rng).clamp(-2, 2)
    azimuth = torch.deg2rad(torch.tensor(kind.azimuth_deg) + turned)
    nearest, farthest, lowest, highest = map(
        torch.tensor, (kind.nearest_mm, kind.farthest_mm, kind.lowest_deg, kind.highest_deg)
    )
    far, elevation = uniform(nearest, farthest, count, 3), torch.deg2rad(uniform(lowest, highest, count, 3))
    high = far * torch.tan(elevation)
    towards = torch.stack([torch.cos(azimuth), -torch.sin(azimuth)], -1)
    along = torch.stack([-towards[..., 1], towards[..., 0]], -1)
    spread = torch.linspace(-1, 1, STRIP)[None, None, :, None] * uniform(0.0, kind.half_length_mm, count, 3, 1, 1)
    flat = (towards * far[..., None])[:, :, None] + along[:, :, None] * spread
    place = torch.cat([flat, high[:, :, None, None].expand(count, 3, STRIP, 1)], -1).reshape(count, -1, 3)
    aim = towards * uniform(*kind.aim_mm, count, 3, 1) + uniform(-3, 3, count, 3, 2)
    beam = uniform(*kind.beam_mm, count, 3, 2)
    tint = _draw_tints(count, uniform, kind)
    back = uniform(0.0, kind.reflected, count, 3, 1) * tint  # one lamp for a whole strip
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


def _uniform(rng: torch.Generator, low: Any, high: Any, *shape: int) -> torch.Tensor:
    """Return uniform random numbers between bounds, numbers or tensors."""
    import torch

    return torch.as_tensor(low + (high - low) * torch.rand(*shape, generator=rng))


def _draw_tints(count: int, uniform: Callable[..., torch.Tensor], kind: LightKind) -> torch.Tensor:
    """Return the share of each colour (count, 3 lamps, 3 channels) in the light of a strip."""
    tint = uniform(*kind.leak, count, 3, 3)
    tint[:, 1, 2] = uniform(*kind.green_in_blue, count)
    tint[:, 2, 1] = uniform(*kind.blue_in_green, count)
    tint[:, range(3), range(3)] = 1.0
    tint *= uniform(0.5, 1.0, count, 3, 1)
    return tint


def draw_fields(count: int) -> torch.Tensor:
    """Return vignette and ink (count, 1, *GRID), 1 without loss."""
    import torch
    from kornia import augmentation as draw

    blank = torch.full((count, 1, *GRID), 0.5)
    uneven = draw.AugmentationSequential(
        draw.RandomLinearIllumination(gain=(FAINT, 0.2), p=0.5),
        draw.RandomLinearCornerIllumination(gain=(FAINT, 0.3), p=0.5),
        draw.RandomGaussianIllumination(gain=(FAINT, 0.35), sign=(-1.0, 1.0), p=0.7),
        draw.RandomGaussianNoise(std=FAINT, p=1.0),
    )
    return torch.as_tensor(uneven(blank)).clamp(0.05, 1.0) / 0.5


def shade(
    scenes: Scenes, place_mm: torch.Tensor, *, slopes: torch.Tensor, lit: torch.Tensor | None = None
) -> torch.Tensor:
    """Return linear light (B, N, 3), 1 is white, of gel at `place_mm` (B, N, 2 or 3) with `slopes` (B, N, 2).

    `lit` (B, N, L): visible share of each lamp; None: all.
    """
    returned = _returned(scenes, place_mm, slopes)
    returned = returned if lit is None else returned * lit
    light: torch.Tensor = returned @ scenes.tint + scenes.stray[:, None]
    return light


def _returned(scenes: Scenes, place_mm: torch.Tensor, slopes: torch.Tensor) -> torch.Tensor:
    """Return the light (B, N, L) by each lamp, fields included."""
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
    """Return grey levels 0 to 255 of `light` (B, N, 3), the mean of `averaged` frames."""
    import torch

    grey = 255 * light.clamp(0.0, 1.0) ** (1 / scenes.gamma[:, None])
    noise = torch.randn(grey.shape, generator=rng) * scenes.noise_grey[:, None] / math.sqrt(averaged)
    return (grey + noise).round().clamp(0, 255)


def lattice(count: int, size_mm: Pair) -> torch.Tensor:
    """Return the places (count, GRID[0] GRID[1], 2) in mm of the blocks of the picture."""
    import torch

    rows, columns = ((torch.arange(n) + 0.5) / n - 0.5 for n in GRID)
    y, x = torch.meshgrid(rows * size_mm[1], columns * size_mm[0], indexing="ij")
    return torch.stack([x, y], -1).reshape(1, -1, 2).expand(count, -1, 2)


def _exposed(scenes: Scenes, white: torch.Tensor) -> Scenes:
    """Return scenes with each colour scaled to its own maximum, then all to that of `white` (B, 1, 1), linear."""
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


# Random surfaces of pressed gel and the shadows that they cast, in torch.
#
# A body touches the gel around a segment: of length 0 for a ball or a round punch, else an edge, a roller or a
# bar. With rho the distance from the segment, the gel is flat to rho = a, follows a circle of radius R for a width
# w, and leaves the body at the slope s = w / sqrt(R^2 - w^2); free gel then sinks as
#
#     z = s l exp(-(rho - a - w)/l)
#
# The share V of a lamp at P between the tangents t- and t+ over a place is, as in synthetic/lights.py,
#
#     V = (t+ - h)/(t+ - t-), clipped to 0 to 1        h = max_s (z(x + s u) - z(x))/s,  u towards P

BODIES = 8  # per scene, each pressed alone
PUNCHES = 0.25  # share of flat bodies
LONG = PUNCHES  # share of bodies around a segment
ARC_MM = (0.8, 3)  # mm, w of round bodies
FLAT_MM = (0.5, 3)  # mm, a of punches
FILLET_MM = (0.1, 0.4)  # mm, w of a punch
SEGMENT_MM = (1, 6)  # mm, half its length
ROUND_SLOPE = (0.25, 0.7)  # slope s of round bodies, as of balls to .57 of their radius
PUNCH_SLOPE = (0.25, 0.9)  # slope s of a punch: walls to 42 degrees
SINK_MM = (0.2, 1.0)  # mm, l of free gel
NEARBY = 1.5  # l outside the body within which places are sampled
AHEAD_MM = (0.05, 9)  # mm, nearest and farthest height that may shade a place
STEPS = 24  # such heights, in logarithmic steps; shadows are within .01 of the simulator's on the mean


@dataclass(frozen=True)
class Surfaces:
    """B scenes of BODIES, in mm: segments by `middle` and `half` (B, BODIES, 2); all others are (B, BODIES).

    `flat` a, `width` w, `radius` R, `sink` l.
    """

    middle: torch.Tensor
    half: torch.Tensor
    flat: torch.Tensor
    width: torch.Tensor
    radius: torch.Tensor
    sink: torch.Tensor

    def height(self, at: torch.Tensor) -> torch.Tensor:
        """Return heights (B, BODIES, ...) mm over the untouched gel at places (B, BODIES, ..., 2) mm."""
        rho, _ = self._distance(at)
        flat, width, radius, sink = (_to(part, rho) for part in (self.flat, self.width, self.radius, self.sink))
        bent = (rho - flat).clamp(min=0.0).minimum(width)
        leaving = (radius**2 - width**2).sqrt()
        free = width / leaving * sink * (-(rho - flat - width).clamp(min=0.0) / sink).exp()
        height: torch.Tensor = (radius**2 - bent**2).sqrt() - leaving + free
        return height

    def slopes(self, at: torch.Tensor) -> torch.Tensor:
        """Return slopes (B, BODIES, ..., 2) at places (B, BODIES, ..., 2) mm."""
        rho, away = self._distance(at)
        flat, width, radius, sink = (_to(part, rho) for part in (self.flat, self.width, self.radius, self.sink))
        bent = (rho - flat).clamp(min=0.0).minimum(width)
        fall = bent / (radius**2 - bent**2).sqrt() * (-(rho - flat - width).clamp(min=0.0) / sink).exp()
        slopes: torch.Tensor = -away * (fall / rho.clamp(min=1e-6))[..., None]
        return slopes

    def _distance(self, at: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return rho, and the vector from the segment, mm."""
        middle, half = (_to(part, at[..., 0]) for part in (self.middle, self.half))
        off = at - middle
        along = (off * half).sum(-1) / (half * half).sum(-1).clamp(min=TINY)
        away = off - along.clamp(-1.0, 1.0)[..., None] * half
        return away.norm(dim=-1), away


def draw_surfaces(count: int, rng: torch.Generator, size_mm: Pair) -> Surfaces:
    """Return `count` scenes of BODIES with their middles in a picture of `size_mm`."""
    import torch

    def uniform(bounds: Pair, *shape: int) -> torch.Tensor:
        return _uniform(rng, *bounds, count, BODIES, *shape)

    punch, long = (uniform((0.0, 1.0)) < share for share in (PUNCHES, LONG))
    slope = torch.where(punch, uniform(PUNCH_SLOPE), uniform(ROUND_SLOPE))
    width = torch.where(punch, uniform(FILLET_MM), uniform(ARC_MM))
    angle, half = uniform((0.0, torch.pi)), torch.where(long, uniform(SEGMENT_MM), 0.0)
    return Surfaces(
        middle=0.5 * torch.tensor(size_mm) * uniform((-1.0, 1.0), 2),
        half=torch.stack([half * angle.cos(), half * angle.sin()], -1),
        flat=torch.where(punch, uniform(FLAT_MM), 0.0),
        width=width,
        radius=width * (1.0 + 1.0 / slope**2).sqrt(),
        sink=uniform(SINK_MM),
    )


def draw_places(surfaces: Surfaces, count: int, rng: torch.Generator, size_mm: Pair) -> torch.Tensor:
    """Return places (B, BODIES, count, 2) mm on and around each body, clipped to the picture."""
    import torch

    shape = (*surfaces.flat.shape, count)
    turn = 2 * torch.pi * torch.rand(shape, generator=rng)
    reach = surfaces.flat + surfaces.width + NEARBY * surfaces.sink
    rho = reach[..., None] * torch.rand(shape, generator=rng).sqrt()
    at = (
        surfaces.middle[:, :, None]
        + surfaces.half[:, :, None] * (2 * torch.rand(shape, generator=rng) - 1)[..., None]
    )
    at = at + rho[..., None] * torch.stack([turn.cos(), turn.sin()], -1)
    edge = 0.5 * torch.tensor(size_mm)
    return torch.as_tensor(at.minimum(edge).maximum(-edge))


def lit_share(surfaces: Surfaces, at: torch.Tensor, lamps_mm: torch.Tensor, high_mm: torch.Tensor) -> torch.Tensor:
    """Return visible shares (B, BODIES, N, L) of lamps (B, L, 3) mm, `high_mm` (B, 1), at places (.., N, 2) mm."""
    import torch

    height = surfaces.height(at)[..., None]
    way = lamps_mm[:, None, None, :, :2] - at[..., None, :]
    far = way.norm(dim=-1)
    unit = way / far[..., None]
    horizon = torch.zeros_like(far)
    first, last = torch.tensor(AHEAD_MM).log10().tolist()
    for step in torch.logspace(first, last, STEPS).tolist():
        ahead = surfaces.height(at[..., None, :] + step * unit)
        horizon = horizon.maximum((ahead - height) / step)
    half = 0.5 * high_mm[:, None, None] / far
    middle = (lamps_mm[:, None, None, :, 2] - height) / far
    share: torch.Tensor = ((middle + half - horizon) / (2 * half)).clamp(0.0, 1.0)
    return share


def _to(part: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    """Return values per body (B, BODIES, ...) reshaped to broadcast with `like` (B, BODIES, any sides)."""
    return part.reshape(*part.shape[:2], *[1] * (like.ndim - 2), *part.shape[2:])


# Training samples: pressed and untouched gel under random lights, some of it finely textured. Colour changes refer
# to the averaged reference of the scene, as in `colour_change.py`.

BATCH = 32  # scenes sampled together; part of the random sequence
EACH = 128  # samples a scene
TEXTURED = 0.1  # share of samples with a fine texture
TEXTURE = TEXTURED  # standard deviation of its slopes
AVERAGED = 16  # frames of the reference


def draw_samples(scenes: int, seed: int, *, kind: str = "gelslim3") -> tuple[Samples, Samples]:
    """Return samples of pressed and of untouched gel under at least `scenes` lights; `press` numbers the scene."""
    import torch

    rng = torch.Generator().manual_seed(seed)
    with one_core(seed), torch.no_grad():
        parts = [_draw(BATCH * k, rng, LIGHT_KINDS[kind]) for k in range(math.ceil(scenes / BATCH))]
    return join([pressed for pressed, _ in parts]), join([still for _, still in parts])


def _draw(first: int, rng: torch.Generator, kind: LightKind) -> tuple[Samples, Samples]:
    import torch

    scenes, surfaces = draw_scenes(BATCH, rng, kind), draw_surfaces(BATCH, rng, kind.size_mm)
    at = draw_places(surfaces, EACH // BODIES, rng, kind.size_mm)
    upright = _uniform(rng, *UPRIGHT_MM, BATCH, 1)
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
