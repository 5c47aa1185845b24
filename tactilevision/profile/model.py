"""Records of a sensor profile and of a calibrated sensor's readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from tactilevision.force.calibrated import material_of
from tactilevision.force.compliance import GelCompliance
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.records.maps import Footprint, HeightMap, TractionMap
from tactilevision.records.measured import Bools, Bytes, Floats, Material
from tactilevision.records.rig import Indenter, Sensor
from tactilevision.records.wrench import Patch, Wrench

if TYPE_CHECKING:
    from tactilevision.press.certified_faces import DepthScale

Followed = Literal["markers", "texture", "nothing"]


@dataclass(frozen=True, eq=False)
class Profile:
    """A calibrated sensor.

    `method` holds the reference; `untouched` (H, W, 3) is one rectified picture of the free gel; `followed` names
    what of it single frames show, from which shear is measured. `calibration` is the content of calibration.json,
    None where E and nu are not known; `compliance` then is the gel's. `face_law` is the true over the read depth
    of flat faces, None without certified faces. `frame_size_px` (width, height) is that of raw frames,
    `white_level` as in recording.toml. `source` names the data it was made from, `warnings` are those of that
    time; `path` is its file.
    """

    sensor: Sensor
    method: CalibratedMethod
    untouched: Bytes
    frame_size_px: tuple[int, int]
    date: str
    followed: Followed
    source: str = ""
    white_level: float | None = None
    calibration: Mapping[str, Any] | None = None
    compliance: GelCompliance | None = None
    face_law: DepthScale | None = None
    indenters: Mapping[str, Indenter] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    path: Path = Path("sensor.tvs")

    @cached_property
    def material(self) -> Material | None:
        """Return E, nu and their covariance; None where they or the gel are not known."""
        if self.calibration is None or self.sensor.gel is None:
            return None
        return material_of(self.calibration, where=f"{self.path}, calibration.json")

    @property
    def name(self) -> str:
        """Return kind and serial number."""
        return f"{self.sensor.kind} {self.sensor.serial}".rstrip()


Singles = npt.NDArray[np.floating]
AnyFloats = TypeVar("AnyFloats", Singles, Floats)


@dataclass(frozen=True, slots=True)
class Seen:
    """Reading of one frame.

    `height` is the map; `contact` (H, W) the mask of contact; `footprint` the face of the sought indenter, None
    without one; `tractions` None where E and nu are not known, or the force was not solved. `flags` are those of
    the map, then those of the force.
    """

    height: HeightMap
    contact: Bools
    footprint: Footprint | None
    tractions: TractionMap | None
    flags: tuple[str, ...]

    @property
    def std(self) -> Singles | None:
        """Return the standard deviation (H, W) of the depth, mm; None where the method states none."""
        return self.height.std_mm

    @property
    def wrench(self) -> Wrench | None:
        """Return force (N) and moment (N mm) with their deviations; None where no force is known."""
        return None if self.tractions is None else self.tractions.wrench

    @property
    def patches(self) -> tuple[Patch, ...]:
        """Return the contact patches, numbered within the frame; `Stream` keeps numbers over frames."""
        return () if self.tractions is None else self.tractions.patches


@dataclass(frozen=True, slots=True)
class SeenBatch:
    """Readings of N frames, stacked; `frames` has each by itself.

    A quantity that no frame has is None; one that a frame alone lacks is NaN there.
    """

    frames: tuple[Seen, ...]

    @property
    def height(self) -> Singles:
        """Return depth (N, H, W), mm; NaN where it is not known."""
        return np.stack([np.where(one.height.valid, one.height.depth_mm, np.nan) for one in self.frames])

    @property
    def std(self) -> Singles | None:
        """Return the standard deviation (N, H, W) of the depth, mm; None where the method states none."""
        return _stacked([one.std for one in self.frames])

    @property
    def contact(self) -> Bools:
        """Return the mask (N, H, W) of contact."""
        return np.stack([one.contact for one in self.frames])

    @property
    def footprint(self) -> tuple[Footprint | None, ...]:
        """Return the indenter's face in each frame."""
        return tuple(one.footprint for one in self.frames)

    @property
    def tractions(self) -> Floats | None:
        """Return tractions (N, 3, rows, columns) along x, y, z, MPa; None where no frame has any."""
        known = [one.tractions for one in self.frames]
        return _stacked([None if one is None else np.stack([one.t_x, one.t_y, one.t_z]) for one in known])

    @property
    def wrench(self) -> Floats | None:
        """Return force and moment (N, 6), N and N mm; None where no frame has any."""
        known = [one.wrench for one in self.frames]
        return _stacked([None if one is None else np.array([*one.force_N, *one.moment_Nmm]) for one in known])

    @property
    def flags(self) -> Sequence[tuple[str, ...]]:
        """Return the flags of each frame."""
        return tuple(one.flags for one in self.frames)


def _stacked(frames: Sequence[AnyFloats | None]) -> AnyFloats | None:
    """Stack arrays of one shape, NaN for a frame without; None where no frame has one."""
    first = next((one for one in frames if one is not None), None)
    if first is None:
        return None
    unknown = np.full_like(first, np.nan)
    return np.stack([unknown if one is None else one for one in frames])
