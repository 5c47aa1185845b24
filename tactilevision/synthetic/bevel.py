"""The bevel beside an indenter's face: where its body is, when the gel meets it, how the gel gives way."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from tactilevision.records import Bools, Floats, Pair
from tactilevision.synthetic.gel import Area, Singles
from tactilevision.synthetic.profile import PunchProfile

_SIDES: dict[str, Pair] = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "top": (0.0, -1.0), "bottom": (0.0, 1.0)}


@dataclass(frozen=True, slots=True)
class Bevel:
    """The body of an indenter beside its face: a plane that starts at a straight edge.

    The edge lies `distance_mm` from the axis towards `side`, `height_mm` behind the face; from there the plane
    falls away by `angle_deg`. It reaches `half_width_mm` to both sides along the edge.
    """

    side: str
    distance_mm: float
    height_mm: float
    angle_deg: float
    half_width_mm: float

    def along(self, x: Floats | Singles, y: Floats | Singles) -> tuple[Floats, Floats]:
        """Distances from the axis towards the bevel, and along its edge; mm, any shape (as x and y)."""
        ex, ey = _SIDES[self.side]
        return np.asarray(ex * x + ey * y), np.asarray(-ey * x + ex * y)

    def area(self, centre_mm: Pair, reach_mm: Pair, *, beside_mm: float) -> Area:
        """The rectangle from before the edge to behind it (`reach_mm`) and `beside_mm` past both of its ends."""
        ex, ey = _SIDES[self.side]
        middle = self.distance_mm + 0.5 * (reach_mm[1] - reach_mm[0])
        half_s, half_t = 0.5 * sum(reach_mm), self.half_width_mm + beside_mm
        half = (half_s, half_t) if ex else (half_t, half_s)
        return Area((centre_mm[0] + ex * middle, centre_mm[1] + ey * middle), half)

    def depth_mm(self, s: Floats, face_mm: float) -> Floats:
        """Depth (any shape, mm) of the bevel's plane with the face at `face_mm`; meant for s >= distance_mm."""
        slope = np.tan(np.deg2rad(self.angle_deg))
        return np.asarray(face_mm - self.height_mm - (s - self.distance_mm) * slope)

    def gap_mm(self, profile: PunchProfile, face_mm: float, *, tilt: Pair = (0.0, 0.0)) -> float:
        """Smallest distance between the bevel and the gel that rises towards it; below 0 they overlap."""
        s = self.distance_mm + np.linspace(0.0, 1.0, 21)
        s, t = np.meshgrid(s, np.linspace(-self.half_width_mm, self.half_width_mm, 41))
        ex, ey = _SIDES[self.side]
        leaning = tilt[0] * (ex * s - ey * t) + tilt[1] * (ey * s + ex * t)
        return float(np.min(profile.depth_at(np.hypot(s, t), face_mm) - self.depth_mm(s, face_mm) - leaning))

    def touch_depth_mm(self, profile: PunchProfile, tilt: Pair = (0.0, 0.0)) -> float:
        """Depth of the face at which the gel first meets the bevel: w + rise = H."""
        from scipy.optimize import brentq

        def gap(w: float) -> float:
            return self.gap_mm(profile, w, tilt=tilt)

        return float(brentq(gap, 0.0, 2.0 * self.height_mm + 0.5, xtol=1e-9))


def bevel_dent(
    surface: Singles, bevel: Bevel, *, places: tuple[Singles, Singles], face_mm: float, tilt: Pair
) -> Singles:
    """What the bevel adds (H, W) mm to the depth of the free surface (H, W) mm.

    A pixel that the bevel's edge crosses is as deep as the edge: else contact would begin only where the plane has
    fallen off to the next pixel's centre, microns too late.
    """
    x, y = places
    pixel_mm = float(abs(x[0, 1] - x[0, 0]))
    s, t = bevel.along(x, y)
    plane = bevel.depth_mm(np.maximum(s, bevel.distance_mm), face_mm) + tilt[0] * x + tilt[1] * y
    under = (s + 0.5 * pixel_mm >= bevel.distance_mm) & (np.abs(t) <= bevel.half_width_mm)
    overlap = np.where(under, plane - surface, 0.0)
    dent = np.maximum(overlap, 0.0)
    if not (dent > 0).any():
        return np.zeros_like(surface)
    return _spread(dent.astype(np.float32), dent > 0, pixel_mm)


def _spread(dent: Singles, touching: Bools, mm_per_px: float) -> Singles:
    """Carry a dent beyond the contact that makes it, decaying with the distance q from the contact."""
    q, nearest = cv2.distanceTransformWithLabels(
        (~touching).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    strength = np.zeros(int(nearest.max()) + 1, np.float32)
    strength[nearest[touching]] = dent[touching]
    length = 0.25
    reach = np.float32(mm_per_px / length) * q
    decay = (2 / np.pi) * np.arcsin(1 / (1 + reach)) * np.exp(-((reach / 8) ** 2))
    return np.asarray(np.where(touching, dent, strength[nearest] * decay), dtype=np.float32)
