"""Options of a simulated recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from tactilevision.errors import InputError, check_known
from tactilevision.records.certified import REASONS
from tactilevision.records.measured import Floats, Material, Pair
from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.lights import SOUND, SlopeResponse
from tactilevision.synthetic.punch import EDGE_RADIUS_MM, FRICTION, PAD_RADIUS_MM, PunchProfile
from tactilevision.synthetic.rig import Protocol

FAULTS = REASONS  # one bad press for each reason of rejection


@dataclass(frozen=True, slots=True)
class GelOptions:
    """The gel, and the prior of its Poisson ratio that the recording states (`prior_std` None: none).

    `friction`: Coulomb's coefficient between gel and face; `relaxing` (share, time constant s): a Maxwell
    branch that carries a share of the force.
    """

    youngs_modulus_MPa: float = 0.19
    poisson_ratio: float = 0.48
    friction: float = FRICTION
    thickness_mm: float = 3.0
    radius_mm: float = PAD_RADIUS_MM
    prior: float | None = None
    prior_std: float | None = 0.002
    relaxing: Pair = (0.0, 1.0)

    def __post_init__(self) -> None:
        Material(self.youngs_modulus_MPa, self.poisson_ratio)  # raises InputError for impossible values

    @property
    def reduced_modulus_MPa(self) -> float:
        """E/(1 - ν²)."""
        return self.youngs_modulus_MPa / (1 - self.poisson_ratio**2)

    def force_N(self, profile: PunchProfile, depth_mm: Floats | float) -> Floats:
        """Return the force (T,) N of the punch of `profile` at depths (T,) mm, without relaxation."""
        return self.youngs_modulus_MPa * profile.force_per_modulus(depth_mm)

    def relaxed(self, force_N: Floats, interval_s: float) -> Floats:
        """Return the force (T,) N with relaxation, for evenly spaced readings (T,)."""
        from scipy.signal import lfilter

        share, constant = self.relaxing
        if share == 0:
            return force_N
        keep = np.exp(-interval_s / constant)
        branch = lfilter([1.0, -1.0], [1.0, -keep], force_N)
        return np.asarray((1 - share) * force_N + share * branch)


@dataclass(frozen=True, slots=True)
class IndenterOptions:
    """A set of flat cylinders that differ in the height of the face over the bevel.

    True heights scatter about the machined ones by `height_std_mm`. `state_bevel_place` writes the distance and
    angle of the bevel into the recording; `edge_radius_mm`, the rounding of the rim, is not stated.
    """

    heights_mm: tuple[float, ...] = (0.15, 0.3, 0.4, 0.5, 0.6)
    radius_mm: float = 2.5
    bevel: Literal["right", "left", "top", "bottom"] = "right"
    bevel_distance_mm: float = 5.0
    bevel_angle_deg: float = 10.0
    height_std_mm: float = 0.001
    state_bevel_place: bool = True
    edge_radius_mm: float = EDGE_RADIUS_MM


@dataclass(frozen=True, slots=True)
class RigOptions:
    """Clocks, repeatability and noise.

    `clock_offset_s` None: random within +-0.2 s. `gain_std`: relative repeatability of the force; `tangential`:
    typical ratio of tangential to normal force; `tilt_std`: slope of the face; `frames_per_press`: informative
    frames that are kept of each press, None: all.
    """

    protocol: Protocol = field(default_factory=Protocol)
    clock_offset_s: float | None = None
    state_clock_offset: bool = False
    frame_rate_Hz: float = 90.0
    force_rate_Hz: float = 200.0
    gain_std: float = 0.002
    tangential: float = 0.01
    tilt_std: float = 0.0002
    place_std_mm: float = 0.4
    frames_per_press: int | None = 20


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """A whole recording: `presses` good ones with each indenter and one press for each of `faults`.

    `slope_response`: change of the light since the reference pictures; its `end_s` is that of the recording.
    `frames`: format of the pictures, "curves" or "points" for curves or certified points only. `flats` and
    `balls`: numbers of reference pictures.
    """

    name: str = "simulated"
    date: str = "2026-11-21"
    gel: GelOptions = field(default_factory=GelOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    slope_response: SlopeResponse = SOUND
    indenters: IndenterOptions = field(default_factory=IndenterOptions)
    rig: RigOptions = field(default_factory=RigOptions)
    presses: int = 3
    faults: tuple[str, ...] = FAULTS
    frames: Literal["png", "jpeg", "curves", "points"] = "png"
    jpeg_quality: int = 92
    flats: int = 2
    balls: int = 24
    ball_radii_mm: tuple[float, ...] = (2.0, 4.0)
    torn_frame: bool = True

    def __post_init__(self) -> None:
        for fault in self.faults:
            check_known(fault, FAULTS, what="no such fault can be simulated", where="SimulationOptions.faults")
        if self.presses < 0 or not self.indenters.heights_mm:
            raise InputError(
                "a recording needs at least one indenter and a number of presses not below 0",
                where="SimulationOptions",
                value=self.presses,
            )
