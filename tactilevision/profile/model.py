"""Records of a sensor profile and of a calibrated sensor's readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from tactilevision.force.calibrated import material_of
from tactilevision.force.compliance import GelCompliance
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.records.constants import KILO
from tactilevision.records.display import Displayed, Summary, number
from tactilevision.records.maps import Footprint, HeightMap, TractionMap
from tactilevision.records.measured import Bools, Bytes, Material
from tactilevision.records.rig import Indenter, Sensor
from tactilevision.records.taxels import TaxelGrid, Taxels, taxel_means
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


@dataclass(frozen=True, slots=True, repr=False)
class Seen(Displayed):
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

    def summary(self) -> Summary:
        """Return the map's summary with the contact and the force."""
        found, wrench, (x, y) = self.height.summary(), self.wrench, self.height.mm_per_px
        force = "not known"
        if wrench is not None:
            force = f"fz {number(wrench.force_N[2], wrench.force_std_N[2])} N, std {wrench.force_std_N[2]:.2g} N"
        values = {**found.values, "contact": f"{self.contact.sum() * x * y:.1f} mm²", "force": force}
        more = (flag for flag in self.flags if flag not in self.height.flags)
        return replace(
            found, title=f"Seen {self.height.name}".rstrip(), values=values, notes=(*found.notes, *more)
        )

    def at_taxels(self, grid: TaxelGrid) -> Taxels:
        """Return penetration (rows, columns) in m and traction (3, rows, columns) in Pa, averaged over each taxel.

        Penetration is the depth of the gel's face within contact, and 0 outside it: gel that sinks or rises next
        to a contact is not penetrated. Tractions are None where no force is known, and NaN along x and y without
        shear. A taxel is NaN where less than half of it was seen. Sums of traction times area are the force where
        the grid covers the contact.
        """
        height, tractions = self.height, self.tractions
        rows, columns = height.depth_mm.shape
        x, y = height.mm_per_px
        penetration = np.where(self.contact, np.maximum(height.depth_mm, 0), 0.0)
        first = (-(columns - 1) / 2 * x, -(rows - 1) / 2 * y)
        depth_mm = taxel_means(penetration[None], height.valid, (x, y), first, grid=grid)[0]
        if tractions is None:
            return Taxels(grid, depth_mm / KILO, None)
        found = [  # each by itself: without shear only t_z is known
            taxel_means(t[None], np.isfinite(t), tractions.mm_per_px, tractions.first_mm, grid=grid)[0]
            for t in (tractions.t_x, tractions.t_y, tractions.t_z)
        ]
        return Taxels(grid, depth_mm / KILO, np.stack(found) * KILO**2)

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
