"""The frozen records that all packages share, and the one place that states signs, axes, orders and units.

Units are mm, N, MPa (N/mm²), s throughout, so no conversion factor appears inside the library.
Axes: z into the gel, x to the right, y down, in the rectified frame as the camera shows it. Arrays of
pictures are indexed [row = y, column = x]; places are written (x, y). A place in pixels has (0, 0) at the
centre of the top left pixel; a place on the pad in mm has (0, 0) at the centre of the rectified frame.
Seen from the camera this can be a left-handed set: convert with care for anything outside.
Depth is positive into the gel and 0 where it is untouched; the rise beside a contact is negative.
Force is what the indenter does to the gel: fz > 0 presses into it, fx and fy act along x and y.
Colours are in the order red, green, blue.
"""

from __future__ import annotations

from tactilevision.records.certified import REASONS, CertificationDetails, CertifiedPoint, EdgeDrop, EdgeProfile
from tactilevision.records.maps import Footprint, Frame, HeightMap, ShearMap, SlopeMap, TractionMap
from tactilevision.records.measured import Curve, ForceSeries, Material, Wrench
from tactilevision.records.numbers import Bools, Bytes, Estimate, Floats, Pair
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

__all__ = [
    "REASONS",
    "Bools",
    "Bytes",
    "CertificationDetails",
    "CertifiedPoint",
    "Curve",
    "EdgeDrop",
    "EdgeProfile",
    "Estimate",
    "Floats",
    "Footprint",
    "ForceSeries",
    "Frame",
    "Gel",
    "HeightMap",
    "Indenter",
    "Material",
    "Pair",
    "Press",
    "Sensor",
    "ShearMap",
    "SlopeMap",
    "TractionMap",
    "Wrench",
]
