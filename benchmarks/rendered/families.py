"""What a seed draws: lamps, ink and camera of one sensor, in two families that share no draw.

Every property is a place u between 0 and 1 of its range. The range is cut into sixteen teeth; `train` draws from
the even ones, `bench` from the odd ones, each from streams of its own. So both cover every range, and no lamp or
ink that something was developed on comes back where it is judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tactilevision.records.measured import Pair
from tactilevision.synthetic.lights import Strip

Family = Literal["train", "bench"]
_TEETH = 16
_STREAM = {"train": 71001, "bench": 90533}


@dataclass(frozen=True, slots=True)
class Ink:
    """Diffuse reflectance under some gloss; `kind` is the name of Mitsuba's model."""

    kind: Literal["roughplastic", "principled", "diffuse"]
    reflectance: float
    roughness: float
    specular: float


@dataclass(frozen=True, slots=True)
class Response:
    """Grey level v of light x: v = f(x)^(1/gamma), f(x) = (1 - exp(-kx))/(1 - exp(-k)); k = 0: f(x) = x."""

    gamma: float
    shoulder: float
    exposure: float
    full_well: float
    read_noise: float


@dataclass(frozen=True, slots=True)
class Rig:
    """One sensor: three lamps, ink, and what the camera makes of light."""

    family: Family
    seed: int
    lamps: tuple[Strip, Strip, Strip]
    ink: Ink
    response: Response
    texture: float
    blur_px: float
    vignette: float
    width_px: int = 427
    height_px: int = 320
    mm_per_px: float = 0.0634


def stream(family: Family, seed: int, number: int) -> np.random.Generator:
    """An independent stream of a rig."""
    return np.random.default_rng([_STREAM[family], seed, number])


def draw_rig(family: Family, seed: int) -> Rig:
    """The rig of a seed."""
    comb = _Comb(family, stream(family, seed, 0))
    start, hand = comb.draw(0.0, 2 * np.pi), 1 if comb.draw(0.0, 1.0) < 0.5 else -1
    order = comb.rng.permutation(3)
    lamps = [
        _lamp(comb, start + hand * (i * 2 * np.pi / 3 + comb.draw(-0.3, 0.3)), int(order[i])) for i in range(3)
    ]
    kind: Literal["roughplastic", "principled"] = "roughplastic" if comb.draw(0.0, 1.0) < 0.5 else "principled"
    ink = Ink(kind, comb.draw(0.45, 0.75), comb.draw(0.25, 0.6), comb.draw(0.1, 0.6))
    shoulder = max(comb.draw(-1.2, 1.2), 0.0)
    response = Response(
        gamma=comb.draw(1.6, 2.4),
        shoulder=shoulder,
        exposure=comb.draw(0.6, 0.85),
        full_well=comb.draw(8000.0, 16000.0),
        read_noise=comb.draw(0.4, 0.9),
    )
    return Rig(
        family,
        seed,
        (lamps[0], lamps[1], lamps[2]),
        ink,
        response,
        texture=comb.draw(0.006, 0.014),
        blur_px=comb.draw(0.4, 0.8),
        vignette=comb.draw(0.0, 0.25),
    )


def _lamp(comb: _Comb, azimuth: float, main: int) -> Strip:
    out, elevation = comb.draw(18.0, 28.0), np.deg2rad(comb.draw(15.0, 35.0))
    direction = np.array([np.cos(azimuth), np.sin(azimuth)])
    x, y = direction * out
    aim = -direction * comb.draw(0.0, 8.0)
    colour = [comb.draw(0.02, 0.25) for _ in range(3)]
    if main == 1:
        colour[2] = comb.draw(0.2, 0.7)
    colour[main] = 1.0
    return Strip(
        (float(x), float(y), float(out * np.tan(elevation))),
        (float(aim[0]), float(aim[1]), comb.draw(0.0, 6.0)),
        length_mm=comb.draw(10.0, 30.0),
        width_mm=comb.draw(1.0, 3.5),
        brightness=comb.draw(0.75, 1.3),
        colour=(colour[0], colour[1], colour[2]),
    )


@dataclass(frozen=True, slots=True)
class _Comb:
    family: Family
    rng: np.random.Generator

    def draw(self, low: float, high: float) -> float:
        """A number between two bounds, out of the family's teeth."""
        tooth = 2 * int(self.rng.integers(_TEETH // 2)) + (self.family == "bench")
        return float(low + (high - low) * (tooth + self.rng.random()) / _TEETH)


def field_mm(rig: Rig) -> Pair:
    """Half the width and height that the camera sees, mm."""
    return rig.width_px * rig.mm_per_px / 2, rig.height_px * rig.mm_per_px / 2
