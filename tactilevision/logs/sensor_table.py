"""[sensor] of an imported recording: what a kind's name or a sensor profile says of the frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files import replacing
from tactilevision.profile.contents import SUFFIX
from tactilevision.profile.read import read_profile
from tactilevision.recording.pictures import first_look
from tactilevision.records import Sensor
from tactilevision.sensors import SENSORS

MAPS = "rectification.npz"


@dataclass(frozen=True, slots=True)
class SensorTable:
    """The table's keys, and the maps of the rectification that a profile brings along."""

    table: Mapping[str, Any]
    maps: tuple[Any, Any] | None = None

    @classmethod
    def of(cls, named: str | None, *, mm_per_px: float | None) -> SensorTable:
        """From a kind's name, or a profile's file. Raises InputError where there is no such sensor."""
        stated: dict[str, Any] = {} if mm_per_px is None else {"mm_per_px": mm_per_px}
        if named is None:
            return cls(stated)
        if named.lower().endswith(SUFFIX):
            sensor = read_profile(named).sensor
            return cls(MappingProxyType(_told(sensor) | stated), sensor.rectification)
        if named not in SENSORS:
            known = f"a profile (FILE{SUFFIX}), or one of {', '.join(SENSORS)}"
            raise InputError("there is no such sensor", where="--sensor", value=named, remedy=f"Name {known}.")
        return cls(MappingProxyType({"kind": named} | stated))

    def scaled(self, frames: Path, names: Sequence[str]) -> tuple[SensorTable, tuple[str, ...]]:
        """With the scale of the pictures in a folder where the sensor's kind alone is named; what was guessed.

        Raises RecordingError for pictures of another shape than the kind's.
        """
        from tactilevision.recording.guess import guess_scale
        from tactilevision.recording.settings import SensorSettings

        usual = SENSORS.get(self.table.get("kind", ""))
        if usual is None or "mm_per_px" in self.table:
            return self, ()
        size_px, _ = first_look(frames, names)
        if size_px == (usual.width_px, usual.height_px):
            return self, ()
        settings, notes = guess_scale(SensorSettings(kind=usual.kind), size_px)
        return SensorTable({**self.table, "mm_per_px": settings.mm_per_px}, self.maps), notes

    def write_maps(self, folder: Path) -> None:
        """Write the maps beside recording.toml, where there are any."""
        if self.maps is not None:
            with replacing(folder / MAPS) as temporary, temporary.open("wb") as file:
                np.savez(file, map_x=self.maps[0], map_y=self.maps[1])


def _told(sensor: Sensor) -> dict[str, Any]:
    found: dict[str, Any] = {"kind": sensor.kind, "mm_per_px": list(sensor.mm_per_px)}
    found |= {"width_px": sensor.width_px, "height_px": sensor.height_px}
    found |= {"serial": sensor.serial} if sensor.serial else {}
    return found | ({"rectification": MAPS} if sensor.rectification is not None else {})
