"""Catalogue of sensors, and rectification of raw pictures.

Any other `records.Sensor` works everywhere too. A new one is an entry of SENSORS.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from tactilevision.errors import InputError, check_known
from tactilevision.records.measured import Material
from tactilevision.records.ranges import SCALE
from tactilevision.records.rig import Gel, Sensor

_GELSLIM3 = Sensor("gelslim3", width_px=427, height_px=320, mm_per_px=(0.0634, 0.0634))
_MINI = Sensor("gelsight_mini", width_px=320, height_px=240, mm_per_px=(0.0634, 0.0634))
_CATALOGUE = (
    # GelSlim 3.0: Raspberry-Pi camera behind a mirror, blue light from the top, green left, red lower right.
    # Stream 427 by 320 px at 90 frames a second. The raw picture is strongly distorted: a rectification belongs to
    # each finger. Scale about 0.0634 mm/px after it (a lens of 27.4 mm fills the width; 0.10577, found in public
    # code, is wrong). Source: Taylor, Dong, Rodriguez, "GelSlim 3.0", ICRA 2022.
    _GELSLIM3,
    dataclasses.replace(_GELSLIM3, kind="gelslim3_markers", has_markers=True),
    # GelSight Mini: three lights round a square gel, 320 by 240 px as its software streams it. Scale about
    # 0.0634 mm/px at that size (0.0317 at 640 by 480) by the maker's software; measure it where depth matters. On
    # two measured sensors red comes from above, green from the right, blue from below. Source: GelSight Inc.,
    # gsrobotics.
    _MINI,
    # The same with its gel of tracking markers.
    dataclasses.replace(_MINI, kind="gelsight_mini_markers", has_markers=True),
    # DIGIT: a low-cost fingertip, 240 by 320 px upright, three lights below the gel. About 16 mm by 19 mm of gel
    # fill the picture. The camera views the gel at an angle, so the scale is a mean; measure it where depth
    # matters. The network of this library takes pictures as digit-interface returns them: red from the upper
    # right, green from the upper left, blue from below. Source: Lambeta et al., IEEE RA-L 5 (2020).
    Sensor("digit", width_px=240, height_px=320, mm_per_px=(0.0640, 0.0600)),
    # GelSight Wedge: mirror and camera in a wedge; the gel is a trapezoid in the raw picture until it is warped.
    # About 11 px per mm after the warp (`sensor_from_corners`); 320 by 240 px is the size taken there. Source:
    # Wang, She, Romero, Adelson, "GelSight Wedge", ICRA 2021.
    Sensor("gelsight_wedge", width_px=320, height_px=240, mm_per_px=(0.0909, 0.0909)),
)
SENSORS: dict[str, Sensor] = {sensor.kind: sensor for sensor in _CATALOGUE}

# Thickness of the gels in mm, of which a depth can be at most MAX_COMPRESSION where the user states no gel.
_THICKNESS_MM = {
    # Not published: the pads of the calibration that this library implements are 3.0 mm thick. The mould in the
    # makers' repository (mcubelab/gelslim) is open and sets no thickness.
    "gelslim3": 3.0,
    # Crown 4.0 mm over its base: CAD model of Helmut et al., "Learning Force Distribution Estimation for the
    # GelSight Mini", arXiv 2411.03315 (feats-ai/feats, gelsight_mini.step). TacEx (arXiv 2411.04776) has 4.5 mm.
    "gelsight_mini": 4.0,
    # Crown 2.3 mm over its base: makers' model of the gel (facebookresearch/digit-design, Digit Gel.STEP).
    "digit": 2.3,
    # Not published: a bound. Pads of this family (GelSight Mini, R1.5, GelSlim) are 2 to 4.5 mm thick.
    "gelsight_wedge": 5.0,
}
# Published E and nu of the usual gel of a kind, which are assumed where nobody has calibrated the gel.
# Of a GelSight Mini: E .43 MPa (neo-Hookean C10 .0725 MPa) by indentation, Helmut et al., arXiv 2411.03315
# (feats-ai/feats). Of gels of its silicone, XP-565: E .275 MPa from Shore 00 60, nu .485, Burgess et al., arXiv
# 2406.15304. Of a simulated GelSight: E .145 MPa, nu .45, Chen et al., arXiv 2301.08343 (Tacchi). The value is the
# middle of these, its deviation half of their range.
_USUAL_MATERIAL = {"gelsight_mini": Material(0.29, 0.48, np.diag([0.145**2, 0.015**2]), assumed=True)}
# of the thickness: a bonded layer stiffens as (1 - w/h)^-3, here 125 times (Johnson, Contact Mechanics, 5.8)
MAX_COMPRESSION = 0.8


def get_sensor(kind: str, **overrides: Any) -> Sensor:
    """Return the sensor of that name, with fields of `records.Sensor` replaced by `overrides`.

    "custom" has no defaults: width_px, height_px and mm_per_px are then needed. `mm_per_px` may be one number.
    Raises InputError for an unknown name, an unknown or missing field, and sizes or scales not above 0.
    """
    scale = overrides.get("mm_per_px")
    if isinstance(scale, int | float):
        overrides["mm_per_px"] = (float(scale), float(scale))
    unknown = set(overrides) - {field.name for field in dataclasses.fields(Sensor)}
    if unknown:
        raise InputError(
            "a sensor has no such field",
            where="get_sensor",
            value=sorted(unknown),
            remedy="Fields: " + ", ".join(field.name for field in dataclasses.fields(Sensor)) + ".",
        )
    if kind == "custom":
        missing = [name for name in ("width_px", "height_px", "mm_per_px") if name not in overrides]
        if missing:
            raise InputError(f"a custom sensor needs {', '.join(missing)}", where="get_sensor")
        return _checked(Sensor(kind="custom", **overrides))
    check_known(kind, [*SENSORS, "custom"], what="no sensor of that name", where="get_sensor")
    return _checked(dataclasses.replace(SENSORS[kind], **overrides))


def usual_gel(sensor: Sensor) -> tuple[Gel, Material] | None:
    """Return the sensor's gel, or its kind's usual one, and published E and nu of such gels; None without any.

    Their deviations are wide: E of a GelSight Mini is known to 50 %.
    """
    kind = sensor.kind.removesuffix("_markers")
    material = _USUAL_MATERIAL.get(kind)
    return None if material is None else (sensor.gel or Gel(_THICKNESS_MM[kind]), material)


def may_have_marks(sensor: Sensor) -> bool:
    """Return whether to look for marks: not if this kind has none by the catalogue."""
    return sensor.has_markers or sensor.kind not in SENSORS


def deepest_mm(sensor: Sensor) -> float:
    """Return the greatest depth in mm that gel of the sensor can have, by its thickness or that of its kind.

    Infinite for a sensor of an unknown kind without a stated gel.
    """
    usual = _THICKNESS_MM.get(sensor.kind.removesuffix("_markers"), float("inf"))
    return MAX_COMPRESSION * (sensor.gel.thickness_mm if sensor.gel else usual)


def check_scale(mm_per_px: float, *, where: str) -> None:
    """Raise InputError for a scale outside of SCALE, or not a number."""
    if not SCALE[0] <= mm_per_px <= SCALE[1]:
        raise InputError(
            f"a scale lies between {SCALE[0]:g} and {SCALE[1]:g} mm per pixel",
            where=where,
            value=mm_per_px,
            remedy="State a length on the gel in mm over its length in the picture in pixels: most are .02 to .1.",
        )


def _checked(sensor: Sensor) -> Sensor:
    if min(sensor.width_px, sensor.height_px) < 2:
        raise InputError(
            "a sensor has 2 px or more each way",
            where=f"sensor {sensor.kind}",
            value=(sensor.width_px, sensor.height_px),
        )
    for scale in sensor.mm_per_px:
        check_scale(scale, where=f"sensor {sensor.kind}")
    return sensor
