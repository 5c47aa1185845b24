"""Compare the resultants with the readings of the force/torque sensor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.files.cache import kept_array
from tactilevision.force.field import CUT, ForceField
from tactilevision.force.frame import FrameForce, nothing_touches
from tactilevision.recording.model import Recording
from tactilevision.recording.write import write_recording
from tactilevision.records.constants import Z95
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Curve, Floats
from tactilevision.records.rig import Indenter, Press

# Resultants compared with the force/torque sensor's.
#
#     residual = force from the picture - reading;   pull = residual / standard deviation of both
#
# Frames without contact are excluded. With correct deviations 95 % of the pulls are within 1.96. A ratio that
# changes with depth indicates the height map or the gel's law, with the place the gel's sides or the light, with
# the press the F/T sensor's zero.

AXES = ("x", "y", "z")
MIN_N = 0.05  # N: the least force of a ratio
NO_READING = "the force sensor has no reading at their time"
AT_ITS_END = "the force sensor was at the end of its range in their press"


@dataclass(frozen=True, slots=True)
class Residuals:
    """Frames with both forces: `force_N`, `measured_N` and `std_N` of their difference (N, 3), NaN: unknown;
    `depth_mm`, `press` (N,), `place_mm` (N, 2); `usable` (N,): compared. `left_out`: how many of the `touched`
    frames are not compared, by reason."""

    force_N: Floats
    std_N: Floats
    measured_N: Floats
    depth_mm: Floats
    place_mm: Floats
    press: npt.NDArray[np.str_]
    usable: npt.NDArray[np.bool_]
    touched: int
    left_out: Mapping[str, int]

    @property
    def residual_N(self) -> Floats:
        """(N, 3)."""
        return self.force_N - self.measured_N

    @property
    def ratio(self) -> Floats:
        """Force from the picture over the reading along z (N,); NaN where the reading is small."""
        read = self.measured_N[:, 2]
        found = np.divide(self.force_N[:, 2], read, out=np.full(len(read), np.nan), where=read > MIN_N)
        return np.asarray(found)

    @property
    def direction_deg(self) -> Floats:
        """Direction of the tangential reading (N,), clockwise from x in the picture; NaN where it is small."""
        x, y = self.measured_N[:, 0], self.measured_N[:, 1]
        return np.where(np.hypot(x, y) > MIN_N, np.degrees(np.arctan2(y, x)), np.nan)


def residuals(rows: Sequence[FrameForce], reading_std_N: Sequence[float] | None = None) -> Residuals | None:
    """Return what can be compared, without contacts cut by the border unless there are no others.

    None if nothing can; `reading_std_N` (3,) of one reading, None if unknown.
    """
    touched = [row for row in rows if touches(row)]
    both = [row for row in touched if np.isfinite(row.measured_N[2])]
    if not both:
        return None
    why = [AT_ITS_END if row.reading_clipped else CUT if CUT in row.flags else "" for row in both]
    if all(why):
        why = [AT_ITS_END if row.reading_clipped else "" for row in both]
    columns = {"force_N": "resultant_N"} | {name: name for name in ("measured_N", "depth_mm", "place_mm", "press")}
    return Residuals(
        **{name: np.array([getattr(row, field) for row in both]) for name, field in columns.items()},
        std_N=np.hypot([row.resultant_std_N for row in both], reading_std_N or 0.0),
        usable=np.array([not one for one in why]),
        touched=len(touched),
        left_out=Counter([NO_READING] * (len(touched) - len(both)) + [one for one in why if one]),
    )


def touches(row: FrameForce) -> bool:
    """Return whether the frame was read, and something touches in it."""
    return row.read and not nothing_touches(row) and bool(np.isfinite(row.resultant_N[2]))


def summary(found: Residuals) -> dict[str, dict[str, float | int | None]]:
    """Summarise by axis: frames, rms and median residual in N, and the share of readings inside the 95 % interval.

    Along z the ratio over all and over the deepest third.
    """
    by_axis: dict[str, dict[str, float | int | None]] = {}
    for k, name in enumerate(AXES):
        residual, std = found.residual_N[found.usable, k], found.std_N[found.usable, k]
        known = np.isfinite(residual)
        some = bool(known.any())
        by_axis[name] = {
            "frames": int(known.sum()),
            "rms_N": float(np.sqrt(np.mean(residual[known] ** 2))) if some else None,
            "median_N": _median(residual),
            "inside_interval95": float(np.mean(np.abs(residual[known]) < Z95 * std[known])) if some else None,
        }
    ratio, deep = found.ratio, found.depth_mm >= np.quantile(found.depth_mm, 2 / 3)
    by_axis["z"] |= {
        "ratio": _median(ratio[found.usable]),
        "ratio_deepest_third": _median(ratio[deep & found.usable]),
    }
    return by_axis


def strength_N(rows: Sequence[FrameForce]) -> list[float]:
    """Return fz of each frame, NaN for none, without contacts cut by the border unless there are no others."""
    every = [row.resultant_N[2] if row.read else float("nan") for row in rows]
    whole = [float("nan") if CUT in row.flags else force for row, force in zip(rows, every, strict=True)]
    return whole if any(force > 0 for force in whole) else every


def shear_summary(rows: Sequence[FrameForce]) -> dict[str, int | str]:
    """Return how many touching frames there are, in how many fx and fy are known, and the usual reason else."""
    touched = [row for row in rows if touches(row)]
    unknown = [row for row in touched if not np.isfinite(row.resultant_N[0])]
    why = Counter(words for row in unknown for words in row.flags.split("; "))
    reason = next((words for words, _ in why.most_common() if "follow" in words or "shear" in words), "")
    return {"touched": len(touched), "known": len(touched) - len(unknown), "why": reason}


def _median(values: Floats) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else None


# The comparison as a recording of curves for `tactilevision diagnose` and `workbench`: of each press the contact's
# depth in the height map against the sensor's force, and the place of the pressure if the protocol states none.
# Columns: `picture_fz_N`, its standard deviation and the solver's part of it, `picture_fz_of_thickness` (d ln fz/d
# ln h, by the inverse step on a thicker layer for some frames of each press) and `picture_cut`. E and nu are
# those of the forces.

MIN_COUNT = 4  # frames of a curve
THICKER = 1.1  # times the thickness: on a thinner gel further cells seem to touch
SOLVED_AGAIN = 48  # frames that are solved again on a thicker gel, one a press at least
A_PRESS = 3  # of them in a press, at most
BODY_MM = 1.0  # mm: stands for the size of what touches, which no part of the comparison uses
UNKNOWN = "contact"  # name of what touches where no press is listed


def write_comparison(
    recording: Recording,
    rows: Sequence[FrameForce],
    field: ForceField,
    *,
    folder: Path,
    maps: Callable[[int], tuple[HeightMap, ShearMap | None]],
    depends_on: object = None,
    material_std: float = 0.0,
) -> Path | None:
    """Write the recording of curves into `folder`; return None if no press has enough frames with both forces.

    `rows`, one a frame, are forces by `field`; `maps` returns depth and shear (H, W) mm of a frame by its number,
    and `depends_on` states what determines these maps and the field: by it, the sensitivity of each force to the
    gel's thickness is kept in the cache. None: it is not kept.
    `material_std` is the relative std of a force by the calibration. Where no presses are listed, each run of
    frames with contact is one.
    """
    if not recording.presses:
        recording, rows = _contacts(recording, rows)
    number = {row.frame: k for k, row in enumerate(rows)}
    seen = {
        one.press: [row for row in rows if row.press == one.press and _whole(row)] for one in recording.presses
    }
    presses = [one for one in recording.presses if len(seen[one.press]) >= MIN_COUNT]
    if not presses:
        return None
    most = min(A_PRESS, max(1, SOLVED_AGAIN // len(presses)))
    chosen = {}
    for press in presses:
        deep = sorted(seen[press.press], key=lambda row: row.depth_mm)
        chosen[press.press] = [deep[k] for k in np.unique(np.linspace(len(deep) - 1, 0, most).astype(int))]
    numbers = [number[row.frame] for some in chosen.values() for row in some]
    make = partial(_of_thickness, map(maps, numbers), field)
    powers = make() if depends_on is None else kept_array("thickness", (depends_on, numbers), make=make)
    curves, power = [], dict(zip(numbers, powers, strict=True))
    for press in presses:
        depths_mm, known_mm = ([row.depth_mm for row in some[press.press]] for some in (seen, chosen))
        here = [power[number[row.frame]] for row in chosen[press.press]]
        curves.append(_curve(press.press, seen[press.press], np.interp(depths_mm, known_mm, here)))
    material, E = field.material, field.material.youngs_modulus_MPa
    known: dict[str, Any] = {"youngs_modulus_std_MPa": material_std * E, "poisson_ratio": material.poisson_ratio}
    gel = replace(field.gel, youngs_modulus_MPa=E, poisson_ratio_std=0.0, **known)
    write_recording(
        replace(recording, path=folder, name=f"{recording.name}, picture and sensor",
                sensor=replace(recording.sensor, gel=gel),
                presses=tuple(_placed(press, seen[press.press]) for press in presses),
                curves=tuple(curves), points=(), forces=None, stage=None, frames_path=None, frame_names=(),
                frame_times_s=np.zeros(0), flats=(), balls=(), extra={}, depth_source="vision", depth_std_mm=None)
    )  # fmt: skip
    return folder


def _layer(field: ForceField, times: float) -> ForceField:
    """Return the same field on a layer `times` as thick, without deviations, and without sides: they take long."""
    gel = replace(field.gel, thickness_mm=times * field.gel.thickness_mm)
    settings = replace(field.settings, cell_std=False, sides=False)
    return ForceField(gel, replace(field.material, covariance=None), field.mm_per_px, settings=settings)


def _of_thickness(maps: Iterable[tuple[HeightMap, ShearMap | None]], field: ForceField) -> Floats:
    """Return d ln fz/d ln h (N,) of N frames; 0 where nothing touches on the thicker layer."""
    layers = [_layer(field, times) for times in (1.0, THICKER)]
    forces = [[layer(*one).resultant_N[2] for layer in layers] for one in maps]
    return np.array([np.log(b / a) / np.log(THICKER) if min(a, b) > 0 else 0.0 for a, b in forces])


def _contacts(recording: Recording, rows: Sequence[FrameForce]) -> tuple[Recording, list[FrameForce]]:
    """Return the recording with a press for each run of frames with contact, and the frames of each."""
    touching = np.array([touches(row) for row in rows], dtype=bool)
    number = np.cumsum(np.diff(touching.astype(int), prepend=0) == 1)
    named = [
        replace(row, press=f"{UNKNOWN}{k}" if on else "")
        for row, k, on in zip(rows, number, touching, strict=True)
    ]
    times = {
        k: [row.time_s for row, n in zip(rows, number * touching, strict=True) if n == k] for k in set(number)
    }
    body = next(iter(recording.indenters), UNKNOWN)
    presses = tuple(Press(f"{UNKNOWN}{k}", body, min(t), max(t)) for k, t in times.items() if k and t)
    indenters = recording.indenters or {UNKNOWN: Indenter(UNKNOWN, "sphere", BODY_MM)}
    return replace(recording, presses=presses, indenters=indenters), named


def _whole(row: FrameForce) -> bool:
    """Return whether both forces are known, and the reading is inside its range."""
    known = bool(np.isfinite([row.depth_mm, *row.measured_N]).all())
    return touches(row) and known and not row.reading_clipped and row.resultant_N[2] > 0


def _curve(press: str, seen: Sequence[FrameForce], of_thickness: Floats) -> Curve:
    return Curve(
        press=press,
        time_s=np.array([row.time_s for row in seen]),
        depth_mm=np.array([row.depth_mm for row in seen]),
        force_N=np.array([row.measured_N for row in seen]),
        phase=np.full(len(seen), "", dtype=np.str_),
        extra={
            "picture_fz_N": np.array([row.resultant_N[2] for row in seen]),
            "picture_fz_std_N": np.array([row.resultant_std_N[2] for row in seen]),
            "picture_fz_model_std_N": np.array([row.model_std_N for row in seen]),
            "picture_fz_of_thickness": of_thickness,
            "picture_cut": np.array([row.cut for row in seen]),
        },
    )


def _placed(press: Press, seen: Sequence[FrameForce]) -> Press:
    if np.isfinite([press.x_mm, press.y_mm]).all():
        return press
    x, y = np.median([row.place_mm for row in seen], axis=0)
    return replace(press, x_mm=float(x), y_mm=float(y))
