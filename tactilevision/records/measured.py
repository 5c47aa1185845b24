"""Records of measured quantities: arrays, estimates, forces, curves and the material."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records.constants import Z95
from tactilevision.records.ranges import Ranged, check_ranges

Array = npt.NDArray[np.floating[Any]]
Picture = npt.NDArray[np.float32]  # or several: planes (n, H, W)
Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Pair = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard deviation and 95 % interval.

    `value` is None if the data do not determine it; `why` then gives the reason, and `interval95` the range that
    the stated assumptions allow.
    """

    value: float | None
    std: float | None
    interval95: Pair | None
    unit: str
    why: str = ""

    @classmethod
    def normal(cls, value: float, std: float, unit: str) -> Estimate:
        """Return the estimate of a normal distribution."""
        return cls(value, std, (value - Z95 * std, value + Z95 * std), unit)

    def as_json(self) -> dict[str, Any]:
        """Return the form of every result file: value, std, interval95, unit, and why, if there is one."""
        interval = None if self.interval95 is None else list(self.interval95)
        content = {"value": self.value, "std": self.std, "interval95": interval, "unit": self.unit}
        return content | ({"why": self.why} if self.why else {})


@dataclass(frozen=True, slots=True)
class ForceSeries(Ranged):
    """Force against time on the F/T sensor's clock: `time_s` (T,), `force_N` (T, 3), `std_N` (3,) of one reading.

    `torque_Nm` (T, 3) and `temperature_C` (T,) if they were recorded.
    """

    time_s: Floats
    force_N: Floats
    std_N: tuple[float, float, float]
    torque_Nm: Floats | None = None
    temperature_C: Floats | None = None


@dataclass(frozen=True, slots=True)
class Curve:
    """One whole press on one clock.

    `time_s`, `depth_mm` (T,), `force_N` (T, 3), `phase` (T,) of "free", "load", "hold", "unload" or "";
    `z_mm` (T,) of the motion stage, if there is one. Rows of phase "free" precede or follow contact. A
    logger's codes are possible: the fit excludes and names such samples.
    """

    press: str
    time_s: Floats
    depth_mm: Floats
    force_N: Floats
    phase: npt.NDArray[np.str_]
    z_mm: Floats | None = None
    extra: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shapes = {name: np.shape(getattr(self, name)) for name in ("time_s", "depth_mm", "force_N", "phase")}
        count = np.size(self.time_s)
        if shapes != {"time_s": (count,), "depth_mm": (count,), "force_N": (count, 3), "phase": (count,)}:
            raise InputError(
                "time_s, depth_mm and phase have one entry a sample, force_N has three",
                where=f"curve {self.press}",
                value=", ".join(f"{name} {shape}" for name, shape in shapes.items()),
                remedy='numpy.stack([fx, fy, fz], axis=1); numpy.full(n, "") where no phase is known.',
            )

    def samples(self, keep: Bools) -> Curve:
        """Return these samples (T,)."""
        if keep.all():
            return self
        z_mm = None if self.z_mm is None else self.z_mm[keep]
        extra = {name: values[keep] for name, values in self.extra.items()}
        kept = (self.time_s[keep], self.depth_mm[keep], self.force_N[keep], self.phase[keep])
        return Curve(self.press, *kept, z_mm, extra)


REACH = ("deepest_mm", "fastest_mm_s")  # of the presses that a material was measured on


@dataclass(frozen=True, slots=True)
class Material:
    """A linear elastic, isotropic gel. `covariance` (2, 2) is of (youngs_modulus_MPa, poisson_ratio).

    `assumed`: both are published values of such gels, not measured on this one. `deepest_mm`, `fastest_mm_s`: the
    deepest and the fastest press that they were measured on; None where not known.
    """

    youngs_modulus_MPa: float
    poisson_ratio: float
    covariance: Floats | None = None
    assumed: bool = False
    deepest_mm: float | None = None
    fastest_mm_s: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.youngs_modulus_MPa) and self.youngs_modulus_MPa > 0):
            raise InputError(
                "Young's modulus must be above 0 MPa", where="Material", value=self.youngs_modulus_MPa
            )
        if not 0 <= self.poisson_ratio < 0.5:
            raise InputError(
                "Poisson's ratio must be in [0, 0.5)",
                where="Material",
                value=self.poisson_ratio,
                remedy="For an incompressible gel take 0.4999.",
            )
        check_ranges(self)

    @property
    def shear_modulus_MPa(self) -> float:
        """Return mu = E / (2 (1 + nu))."""
        return self.youngs_modulus_MPa / (2 * (1 + self.poisson_ratio))

    @property
    def bulk_modulus_MPa(self) -> float:
        """Return K = E / (3 (1 - 2 nu))."""
        return self.youngs_modulus_MPa / (3 * (1 - 2 * self.poisson_ratio))

    def as_json(self) -> dict[str, Any]:
        """Return E and nu in the form of every result file, value +- 1.96 std; null without a covariance."""
        found = {}
        for k, (name, unit) in enumerate((("youngs_modulus_MPa", "MPa"), ("poisson_ratio", "1"))):
            value = getattr(self, name)
            known = Estimate(value, None, None, unit)
            if self.covariance is not None:
                known = Estimate.normal(value, float(np.sqrt(self.covariance[k, k])), unit)
            found[name] = known.as_json()
        return found
