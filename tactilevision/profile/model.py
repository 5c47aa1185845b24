"""What a sensor profile holds: one frozen record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tactilevision.force.calibrated import material_of
from tactilevision.force.compliance import GelCompliance
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.records import Bytes, Indenter, Material, Sensor

if TYPE_CHECKING:
    from tactilevision.certificate.depth.depth_scale import DepthScale
    from tactilevision.photometric.illumination.lamps import Lamps


Followed = Literal["markers", "texture", "nothing"]


@dataclass(frozen=True, eq=False)
class Profile:
    """A calibrated sensor.

    `method` holds the reference; `untouched` (H, W, 3) is one rectified picture of the free gel; `followed` says
    what of it single frames show, so that shear can be told. `calibration` is the content of calibration.json,
    None where E and nu are not known; `compliance` then is the gel's. `face_law` is how deep flat faces are over
    how deep they are read, None where no certified face has told. `lamps` are known where they cast shadows that
    frames showed; `undone_face_law` is that of faces read with these undone. `frame_size_px` (width, height) is
    that of raw frames, `white_level` as in recording.toml. `source` says in words what it was made from,
    `warnings` what was doubtful then; `path` is its file.
    """

    sensor: Sensor
    method: ReferencedMethod
    untouched: Bytes
    frame_size_px: tuple[int, int]
    date: str
    followed: Followed
    source: str = ""
    white_level: float | None = None
    calibration: Mapping[str, Any] | None = None
    compliance: GelCompliance | None = None
    face_law: DepthScale | None = None
    lamps: Lamps | None = None
    undone_face_law: DepthScale | None = None
    indenters: Mapping[str, Indenter] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    path: Path = Path("sensor.tvs")

    @property
    def told_lamps(self) -> Lamps | None:
        """The lamps, also where only balls told them and no frame showed whether they cast shadows."""
        return self.lamps or getattr(self.method, "lamps", None)

    @cached_property
    def material(self) -> Material | None:
        """E, nu and their covariance; None where they are not known, or the gel is not."""
        if self.calibration is None or self.sensor.gel is None:
            return None
        return material_of(self.calibration, where=f"{self.path}, calibration.json")

    @property
    def name(self) -> str:
        """Kind and serial number, as a person would say them."""
        return f"{self.sensor.kind} {self.sensor.serial}".rstrip()
