"""Columns of points.csv beside the point's own: how it was certified, and the surface beside its face."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from tactilevision.records.certified import CertificationDetails, CertifiedPoint, EdgeDrop, EdgeProfile

# column of the file: field of CertificationDetails
_NUMBERS = {
    "rise_ratio": "pile_up_ratio",
    "rise_ratio_std": "pile_up_ratio_std",
    "lean_std_mm": "tilt_std_mm",
    "touch_std_s": "contact_std_s",
    "touch_shared_std_mm": "contact_shared_std_mm",
    "touch_sigmas": "contact_sigmas",
    "reconstructed_depth_mm": "reconstructed_depth_mm",
    "reconstructed_std_mm": "reconstructed_std_mm",
    "ruler_std": "travel_scale_std",
    "touches_late_mm": "contact_delay_mm",
    "touches_late_std_mm": "contact_delay_std_mm",
    "centre_x_mm": "centre_x_mm",
    "centre_y_mm": "centre_y_mm",
    "face_radius_mm": "face_radius_mm",
    "tilt_x": "tilt_x",
    "tilt_y": "tilt_y",
}
_WORDS = {"touch_channel": "contact_channel", "findings": "findings"}
_READINGS, _DWELL = "force_readings", "force_dwell"
_PROFILE = ("slope_gain_std", "ball_slope")
_DROP = re.compile(r"fall_(\d+)_([\d.]+)_([\d.]+)_mm")


def point_columns(point: CertifiedPoint) -> dict[str, Any]:
    """Cells of one point by column: details, edge profile (fall_AZIMUTH_FROM_TO_mm) and extra."""
    details = point.details
    cells: dict[str, Any] = {column: getattr(details, name) for column, name in (_NUMBERS | _WORDS).items()}
    cells[_READINGS] = details.force_readings
    cells[_DWELL] = None if details.force_dwell is None else int(details.force_dwell)
    if point.edge_profile is not None:
        for drop in point.edge_profile.drops:
            cells[f"fall_{drop.azimuth_deg:.0f}_{drop.from_mm:.2f}_{drop.to_mm:.2f}_mm"] = drop.drop_mm
        cells |= {name: getattr(point.edge_profile, name) for name in _PROFILE}
    return cells | dict(point.extra)


def split_columns(cells: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments `details`, `edge_profile` and `extra` of CertifiedPoint from the further cells of one row."""
    numbers: dict[str, Any] = {name: _number(cells, column) for column, name in _NUMBERS.items()}
    words: dict[str, Any] = {name: _word(cells, column) for column, name in _WORDS.items()}
    readings, dwell = _number(cells, _READINGS), _number(cells, _DWELL)
    details = CertificationDetails(
        **numbers,
        **words,
        force_readings=int(readings) if np.isfinite(readings) else None,
        force_dwell=bool(dwell) if np.isfinite(dwell) else None,
    )
    drops = tuple(_drop(name, _number(cells, name)) for name in cells if _DROP.fullmatch(name))
    drops = tuple(drop for drop in drops if np.isfinite(drop.drop_mm))
    profile = EdgeProfile(drops, *(_number(cells, name) for name in _PROFILE)) if drops else None
    known = {*_NUMBERS, *_WORDS, _READINGS, _DWELL, *_PROFILE}
    extra = {name: cell for name, cell in cells.items() if name not in known and not _DROP.fullmatch(name)}
    return {"details": details, "edge_profile": profile, "extra": extra}


def _drop(column: str, drop_mm: float) -> EdgeDrop:
    azimuth_deg, from_mm, to_mm = (float(text) for text in _DROP.findall(column)[0])
    return EdgeDrop(azimuth_deg, from_mm, to_mm, drop_mm)


def _number(cells: Mapping[str, Any], name: str) -> float:
    """The number of a cell; NaN where it holds none, for these columns are for the reader's information."""
    try:
        return float(cells.get(name, np.nan))
    except (TypeError, ValueError):
        return float("nan")


def _word(cells: Mapping[str, Any], name: str) -> str:
    cell = cells.get(name, "")
    return cell if isinstance(cell, str) else "" if np.isnan(cell) else f"{cell:g}"
