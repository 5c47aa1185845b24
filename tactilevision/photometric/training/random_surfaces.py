"""Surfaces of pressed gel drawn at random, and the shadows that they cast, in torch.

A body touches the gel about a segment: of length 0 a ball or a round punch, else an edge, a roller or a bar. With
rho the distance from the segment, the gel is flat to rho = a, follows a circle of radius R for a width w, and
leaves the body at the slope s = w / sqrt(R^2 - w^2); free gel then sinks as

    z = s l exp(-(rho - a - w)/l)

Of a lamp at P that stands between the tangents t- and t+ over a place, the share V arrives there, as
in synthetic/strips.py (a test compares the two):

    V = (t+ - h)/(t+ - t-), held between 0 and 1        h = max_s (z(x + s u) - z(x))/s,  u towards P
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactilevision.records import Pair

if TYPE_CHECKING:
    import torch

BODIES = 8  # bodies a scene, each pressed alone
PUNCHES = 0.25  # share of bodies that are flat
LONG = 0.25  # share of bodies about a segment that is no point
ARC_MM = (0.8, 3.0)  # mm, w of what is round
FLAT_MM = (0.5, 3.0)  # mm, a of punches
FILLET_MM = (0.1, 0.4)  # mm, w of a punch
SEGMENT_MM = (1.0, 6.0)  # mm, half its length
ROUND_SLOPE = (0.25, 0.7)  # slope s of what is round, as of balls to .57 of their radius
PUNCH_SLOPE = (0.25, 0.9)  # slope s of a punch: walls to 42 degrees
SINK_MM = (0.2, 1.0)  # mm, l of free gel
NEARBY = 1.5  # l beside the body within which places are drawn
AHEAD_MM = (0.05, 9.0)  # mm, the nearest and the farthest height that may shade a place
STEPS = 24  # heights on the way, evenly in the logarithm; shadows within .01 of the simulator's on the mean


@dataclass(frozen=True)
class Surfaces:
    """B scenes of BODIES; mm: `middle` (B, BODIES, 2) and `half` (B, BODIES, 2), the segment's; all others
    (B, BODIES): `flat` a, `width` w, `radius` R, `sink` l."""

    middle: torch.Tensor
    half: torch.Tensor
    flat: torch.Tensor
    width: torch.Tensor
    radius: torch.Tensor
    sink: torch.Tensor

    def height(self, at: torch.Tensor) -> torch.Tensor:
        """Heights (B, BODIES, ...) mm over the untouched gel, at places (B, BODIES, ..., 2) mm."""
        rho, _ = self._distance(at)
        flat, width, radius, sink = (_to(part, rho) for part in (self.flat, self.width, self.radius, self.sink))
        bent = (rho - flat).clamp(min=0.0).minimum(width)
        leaving = (radius**2 - width**2).sqrt()
        free = width / leaving * sink * (-(rho - flat - width).clamp(min=0.0) / sink).exp()
        height: torch.Tensor = (radius**2 - bent**2).sqrt() - leaving + free
        return height

    def slopes(self, at: torch.Tensor) -> torch.Tensor:
        """Slopes (B, BODIES, ..., 2) there."""
        rho, away = self._distance(at)
        flat, width, radius, sink = (_to(part, rho) for part in (self.flat, self.width, self.radius, self.sink))
        bent = (rho - flat).clamp(min=0.0).minimum(width)
        fall = bent / (radius**2 - bent**2).sqrt() * (-(rho - flat - width).clamp(min=0.0) / sink).exp()
        slopes: torch.Tensor = -away * (fall / rho.clamp(min=1e-6))[..., None]
        return slopes

    def _distance(self, at: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """rho, mm, and the way there from the segment, mm."""
        middle, half = (_to(part, at[..., 0]) for part in (self.middle, self.half))
        off = at - middle
        along = (off * half).sum(-1) / (half * half).sum(-1).clamp(min=1e-9)
        away = off - along.clamp(-1.0, 1.0)[..., None] * half
        return away.norm(dim=-1), away


def draw_surfaces(count: int, rng: torch.Generator, size_mm: Pair) -> Surfaces:
    """`count` scenes of BODIES whose middles lie in a picture of `size_mm`."""
    import torch

    def uniform(bounds: Pair, *shape: int) -> torch.Tensor:
        return bounds[0] + (bounds[1] - bounds[0]) * torch.rand(count, BODIES, *shape, generator=rng)

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
    """Places (B, BODIES, count, 2) mm on each body and beside it, held within the picture."""
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
    """Share (B, BODIES, N, L) of the light of lamps (B, L, 3) mm, `high_mm` (B, 1), at places (.., N, 2) mm."""
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
    """What each body has (B, BODIES, ...), to go with values `like` (B, BODIES, any sides)."""
    return part.reshape(*part.shape[:2], *[1] * (like.ndim - 2), *part.shape[2:])
