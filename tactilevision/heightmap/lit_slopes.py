"""Slopes outside one press where every lamp reaches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.shadows_seen import UNDONE_LEAN
from tactilevision.photometric.illumination.cast_shadow import LightField, lit
from tactilevision.photometric.illumination.interreflection import reflected, without
from tactilevision.records.maps import Frame, SlopeMap
from tactilevision.records.measured import Bools

SCALES = (0.5, 2.0)  # of the certified depth over the map's: beyond, the map shows another face


@dataclass(frozen=True, slots=True, eq=False)
class LitSlopes:
    """A reader of one press's frames: `reached` (H, W) by all lamps, `factor` (H, W, 3) of the wall's light."""

    reader: Reconstructor
    reached: Bools
    factor: npt.NDArray[np.float32]

    def slope_map(self, frame: Frame) -> SlopeMap:
        """The slopes (H, W) of a raw frame, mm/mm; not valid in shadow. Raises as `Reconstructor.slope_map`."""
        method, rgb = self.reader.referenced, self.reader.rectified(frame)
        if method is None:
            return self.reader.slope_map(frame)
        with self.reader.turn.lock:
            slopes = method.read(without(rgb, self.factor)).slopes
        valid = self.reached if slopes.valid is None else slopes.valid & self.reached
        return replace(slopes, valid=valid)


def lit_slopes(
    reader: Reconstructor, field: LightField, frame: Frame, *, face: Bools, depth_mm: float
) -> LitSlopes:
    """A reader for frames of about this one's depth in mm; `face` (H, W) is the punch's in the picture.

    The map of the frame, its cast shadows undone and its face as its wall has it, gives the shape, and the
    certified depth its scale. Raises as `Reconstructor.height_map`.
    """
    before = reader.shadows, reader.lean
    try:
        reader.shadows, reader.lean = field.unrefined, UNDONE_LEAN
        shape = reader.height_map(frame).depth_mm
    finally:
        reader.shadows, reader.lean = before
    shown = float(np.median(shape[face])) if face.any() else depth_mm
    scale = float(np.clip(depth_mm / max(shown, 1e-6), *SCALES))
    surface = scale * shape
    reached = lit(field.lamps, shape, reader.sensor.mm_per_px)
    return LitSlopes(reader, reached, reflected(field, surface))
