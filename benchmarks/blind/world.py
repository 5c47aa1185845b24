"""What is true: the gel, the rig, and what is hidden in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

Numbers = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class World:
    """The gel as stated, but E and nu, which only the truth knows; `amounts` of what is hidden, by key, 0
    where absent.

    `shapes` the hidden effects' further numbers (time constants, directions); `straight` whether the gel
    follows the
    usual straight bracket or the finite elements as they are. `source` of the depth: vision, stage or gauge.
    """

    modulus_MPa: float = 0.2
    nu: float = 0.48
    thickness_mm: float = 3.0
    pad_radius_mm: float = 10.0
    straight: bool = True
    source: str = "vision"
    amounts: Numbers = field(default_factory=dict)
    shapes: Numbers = field(default_factory=dict)

    def amount(self, key: str) -> float:
        """How much of an effect there is."""
        return self.amounts.get(key, 0.0)

    def shape(self, name: str) -> float:
        """A further number of a hidden effect."""
        return self.shapes[name]

    def with_amount(self, key: str, value: float) -> World:
        """The same world with more or less of one effect."""
        return replace(self, amounts={**self.amounts, key: value})


@dataclass(frozen=True, slots=True)
class Hidden:
    """An effect that can be hidden: between which sizes (`low` first tried), on which side, and where it is
    seen.
    """

    key: str
    low: float
    high: float
    unit: str
    signed: bool = False
    source: str = "vision"
    catalogued: bool = True
    certified: bool = False


def _all(*hidden: Hidden) -> Mapping[str, Hidden]:
    return MappingProxyType({h.key: h for h in hidden})


# Ranges as in the table of effects; those that no design can tell from E (force_gain, one punch's skin ...)
# are left out.
HIDDEN = _all(
    Hidden("depth_zero", 0.002, 0.05, "mm", signed=True),
    Hidden("force_bias", 0.002, 0.05, "N", signed=True),
    Hidden("force_crosstalk", 0.002, 0.1, "1", signed=True),
    Hidden("clock_offset", 5e-5, 0.1, "s", signed=True),
    Hidden("tilt", 0.001, 0.02, "rad"),
    Hidden("edge_fillet", 0.03, 0.5, "mm"),
    Hidden("backing_compliance", 0.0005, 0.03, "mm/N", source="stage"),
    Hidden("lateral_boundary", 0.01, 0.3, "1", signed=True),
    Hidden("thickness", 0.005, 0.3, "1", signed=True),
    Hidden("thickness_wedge", 0.0005, 0.05, "mm/mm"),
    Hidden("skin", 0.5, 25.0, "E_skin/E - 1"),
    Hidden("friction", 0.1, 1.0, "1"),
    Hidden("adhesion", 2e-5, 2e-3, "N/mm"),
    Hidden("viscoelasticity", 0.002, 0.3, "1"),
    Hidden("recovery", 0.005, 0.2, "1"),
    Hidden("mullins", 0.003, 0.15, "1"),
    Hidden("stiffening", 0.02, 3.0, "1"),
    Hidden("ageing", 0.001, 0.3, "1"),
    Hidden("temperature", 0.3, 5.0, "of rubber's .34 %/K"),
    Hidden("bevel_rise", 0.05, 1.3, "of the computed rise", source="gauge", certified=True),
    Hidden("photometric_gain", 0.002, 0.08, "1", signed=True, certified=True, source="gauge"),
    Hidden("photometric_drift", 0.002, 0.08, "1", signed=True, certified=True, source="gauge"),
    Hidden("slope_saturation", 0.005, 0.2, "share lost at .6 mm", certified=True, source="gauge"),
    Hidden("screw_error", 0.0005, 0.03, "mm", source="stage"),
    Hidden("zero_creep", 0.002, 0.2, "N", signed=True),
    Hidden("backlash", 0.0003, 0.05, "mm", source="stage"),
    Hidden("stick_slip", 0.005, 0.3, "N", catalogued=False),
    Hidden("two_ranges", 0.005, 0.3, "N", signed=True, catalogued=False),
)


def draw_world(rng: np.random.Generator, *, straight: bool = True) -> World:
    """A gel with everything in order, and the shapes of whatever may be hidden in it."""
    azimuth = rng.uniform(0, 2 * np.pi, 2)
    shapes = {
        "azimuth": azimuth[0],
        "wedge_azimuth": azimuth[1],
        "tau_s": np.exp(rng.uniform(np.log(0.3), np.log(3.0))),
        "recovery_s": np.exp(rng.uniform(np.log(25), np.log(150))),
        "damage_mm": rng.uniform(0.2, 0.4),
        "ageing_day": np.exp(rng.uniform(np.log(0.3), np.log(10))),
        "skin_mm": rng.uniform(0.02, 0.05),
        "period_mm": rng.uniform(0.08, 0.25),
        "creep_s": np.exp(rng.uniform(np.log(0.5), np.log(5))),
        "gent": float(rng.random() < 0.5),
        "slip_seed": float(rng.integers(2**31)),
        "rise": rng.uniform(0.08, 0.11),
    }
    return World(
        modulus_MPa=float(np.exp(rng.uniform(np.log(0.12), np.log(0.3)))),
        nu=float(rng.uniform(0.47, 0.49)),
        thickness_mm=round(float(rng.uniform(2.8, 3.3)), 2),
        straight=straight,
        shapes={name: float(value) for name, value in shapes.items()},
    )
