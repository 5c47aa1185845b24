"""Made-up recordings of certified points, drawn from the written-out law with known errors of every kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from calibration.inputs.observations import Measured
from tactilevision.mechanics.kappa import kappa
from tactilevision.recording.model import Recording
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

HEIGHTS_MM = (0.15, 0.3, 0.4, 0.5, 0.6)


def recording_of(
    sensor: Sensor,
    indenters: Mapping[str, Indenter],
    presses: tuple[Press, ...] = (),
    *,
    depth_source: Literal["vision", "stage", "gauge"] = "gauge",
) -> Recording:
    """What the fitting side reads of a recording."""
    return Recording(Path(), "made", sensor, depth_source=depth_source, indenters=indenters, presses=presses)


@dataclass(frozen=True)
class Truth:
    """The gel that is measured, and how badly."""

    modulus_MPa: float = 0.2
    poisson_ratio: float = 0.48
    beta: float = 0.85
    sticking: float = 0.0
    radii_mm: tuple[float, ...] = (2.5,)
    repeats: int = 3
    depth_std_mm: float = 0.002
    force_std_N: float = 0.002
    height_std_mm: float = 0.004
    radius_std_mm: float = 0.005
    thickness_std_mm: float = 0.02
    poisson_std: float = 0.002
    states_noise: bool = True
    states_poisson: bool = True
    extra: Mapping[str, Any] = field(default_factory=dict)

    def stiffness(self, radius_mm: float, thickness_mm: float = 3.0) -> float:
        """c of a sliding punch times 1 + sticking."""
        k = kappa(self.poisson_ratio, radius_mm / thickness_mm)
        free = 2 * radius_mm * self.modulus_MPa * k / (1 - self.poisson_ratio**2)
        return float(free * (1 + self.sticking))


def draw(truth: Truth, rng: np.random.Generator) -> Measured:
    """Five heights of each radius, each pressed `repeats` times; what is stated differs from what is."""
    thickness = 3.0 + truth.thickness_std_mm * rng.standard_normal()
    stated_nu = float(np.clip(truth.poisson_ratio + truth.poisson_std * rng.standard_normal(), 0, 0.4999))
    gel = Gel(
        3.0,
        truth.thickness_std_mm,
        "disc",
        15.0,
        poisson_ratio=stated_nu if truth.states_poisson else None,
        poisson_ratio_std=truth.poisson_std if truth.states_poisson else None,
    )
    indenters, points = {}, []
    for radius in truth.radii_mm:
        true_radius = radius + truth.radius_std_mm * rng.standard_normal()
        for height in HEIGHTS_MM:
            name = f"R{radius:g}H{height:g}"
            indenters[name] = Indenter(
                name, "flat_cylinder", radius, truth.radius_std_mm, height, truth.height_std_mm
            )
            real = height + truth.height_std_mm * rng.standard_normal()
            for k in range(truth.repeats):
                depth = real + truth.depth_std_mm * rng.standard_normal()
                force = truth.stiffness(true_radius, thickness) * depth * (1 + truth.beta * depth / thickness)
                force += truth.force_std_N * rng.standard_normal()
                std = float(np.hypot(truth.depth_std_mm, truth.height_std_mm)) if truth.states_noise else np.nan
                points.append(
                    CertifiedPoint(
                        f"{name}-{k}",
                        name,
                        height,
                        force,
                        std,
                        truth.force_std_N if truth.states_noise else np.nan,
                        **truth.extra,
                    )
                )
    sensor = Sensor("custom", 427, 320, (0.0634, 0.0634), gel)
    return Measured(recording_of(sensor, indenters), points=tuple(points))


def points_of(depth_mm: Floats, force_N: Floats, *, radius_mm: float = 2.5, gel: Gel | None = None) -> Measured:
    """One indenter and one press for each depth, nothing stated beside."""
    sensor = Sensor("custom", 427, 320, (0.0634, 0.0634), gel or Gel(3.0, shape="disc", radius_mm=15.0))
    pairs = enumerate(zip(depth_mm, force_N, strict=True))
    table = [CertifiedPoint(str(k + 1), "A", float(w), float(P)) for k, (w, P) in pairs]
    return Measured(recording_of(sensor, {"A": Indenter("A", radius_mm=radius_mm)}), points=tuple(table))
