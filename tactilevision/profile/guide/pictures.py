"""What the page shows of a press: the picture, its change of colour against the untouched gel, the depth."""

from __future__ import annotations

import cv2
import numpy as np

from tactilevision.photometric.illumination.colour_change import Planes
from tactilevision.records import Bytes, Floats

MIDDLE_GREY = 128  # of the change's picture: no change
FULL_PERCENTILE = 99.5  # percentile of the change that is drawn in full colour


def encode(rgb: Bytes) -> bytes:
    """PNG of a picture (H, W, 3) of grey levels, red first."""
    return cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes()


def draw_change(change: Planes) -> Bytes:
    """A relative change (3, H, W) as colours round grey (H, W, 3), grey levels; unknown colours stay grey."""
    known = np.nan_to_num(np.asarray(change, np.float32))
    full = max(float(np.percentile(np.abs(known), FULL_PERCENTILE)), 1e-6)
    level = MIDDLE_GREY + (MIDDLE_GREY - 1) * np.clip(known / full, -1.0, 1.0)
    return np.ascontiguousarray(level.transpose(1, 2, 0)).astype(np.uint8)


def draw_depth(depth_mm: Floats) -> Bytes:
    """Depth (H, W) in mm as colours (H, W, 3) of grey levels, from 0 (dark) to the deepest (bright)."""
    top = max(float(np.nanmax(depth_mm)), 1e-9)
    level = np.asarray(255 * np.clip(np.nan_to_num(depth_mm) / top, 0.0, 1.0), np.uint8)
    return np.asarray(cv2.cvtColor(cv2.applyColorMap(level, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB), np.uint8)
