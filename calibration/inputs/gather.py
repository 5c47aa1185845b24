"""Build observations from the certified points or the curves of recordings."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.inputs.observations import (
    DAY_S,
    OF_SAMPLES,
    TYPICAL_FORCE_N,
    TYPICAL_ZERO_MM,
    DepthSource,
    EdgeDrop,
    Measured,
    Observations,
    Presses,
    Resultants,
    Shared,
    as_sets,
    stand_still,
)
from calibration.inputs.rounded_depth import rounding_mm
from calibration.inputs.wild_samples import without_wild
from tactilevision.errors import InputError
from tactilevision.recording.layout import CURVES, POINTS, some
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Curve, Floats
from tactilevision.records.rig import Gel, Indenter, Press

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording

NAN = float("nan")
# columns that `force` adds to curves
OF_PICTURE = ("picture_fz_N", "picture_fz_model_std_N", "picture_fz_of_thickness", "picture_cut")
MOST_STD = 0.1  # largest relative std of the inverse step: near the touch a contact has a few cells
POWERS = (1.0, 2.0)  # of the depth in a contact's force: from a flat face to a cone
LEAST_RANGE = 0.2  # of ln w in a press, from which its own slope of ln R is taken


def own_depth_std(point: CertifiedPoint, indenter: Indenter, *, recording: Recording) -> float:
    """Return the depth's std without what other presses share: the machined height's and the rise's."""
    whole = point.depth_std_mm
    if not np.isfinite(whole):
        return finite_or(recording.depth_std_mm, NAN)
    height = (
        0.0 if on_travel_scale(point) else indenter.height_std_mm / (1 + finite_or(point.details.pile_up_ratio))
    )
    shared = math.hypot(height, relative_shared_std(point) * point.depth_mm)
    if is_certified(point):  # consists of these parts
        return math.sqrt(max(whole**2 - shared**2, 0.0))
    return math.sqrt(whole**2 - shared**2) if whole > shared > 0 else whole


def on_travel_scale(point: CertifiedPoint) -> bool:
    """Return whether the contact event was placed by the recording's travel scale."""
    return bool(np.isfinite(point.details.travel_scale_std))


def relative_shared_std(point: CertifiedPoint) -> float:
    """Return the relative std shared by all depths: of the gel's rise at the bevel and of the ruler."""
    rise = finite_or(point.details.pile_up_ratio_std) / (1 + finite_or(point.details.pile_up_ratio))
    return math.hypot(rise, finite_or(point.details.travel_scale_std))


def shared_errors(sets: Sequence[Measured]) -> Shared:
    """Return the errors that certified depths share by their certification."""
    points = [p for m in sets for p in m.points if p.accepted]
    touch = [finite_or(p.details.contact_shared_std_mm) for p in points]
    rise = [relative_shared_std(p) for p in points]
    if not points:
        return Shared()
    return Shared(
        float(np.median(touch)), float(np.median(rise)), heights=not all(on_travel_scale(p) for p in points)
    )


def depth_source(sets: Sequence[Measured]) -> DepthSource:
    """Return the source of the depths: "gauge" for certified points without curves, else as recorded."""
    certified = [is_certified(p) for m in sets for p in m.points if p.accepted]
    if certified and all(certified) and not any(m.curves for m in sets):
        return "gauge"
    return sets[0].recording.depth_source


def is_certified(point: CertifiedPoint) -> bool:
    """Return whether a certificate of this library subtracted the gel's rise and states its std."""
    return bool(np.isfinite(point.details.pile_up_ratio_std))


def finite_or(value: float | None, instead: float = 0.0) -> float:
    """Return the value; `instead` where it is not stated or not finite."""
    return float(value) if value is not None and np.isfinite(value) else instead


@dataclass(frozen=True, slots=True)
class _Touch:
    """One press before it enters the flat arrays."""

    recording: Recording
    number: int  # of the recording
    protocol: Press
    arrays: Mapping[str, Any]  # of its samples, by their names in Observations
    falls: tuple[EdgeDrop, ...] = ()

    @property
    def indenter(self) -> Indenter:
        """The indenter, as the recording describes it."""
        return self.recording.indenters[self.protocol.indenter]

    @property
    def time_s(self) -> Floats:
        """Times of the samples, since the epoch where the recording is dated."""
        return np.asarray(self.arrays["time_s"] + _days_since_epoch(self.recording.date) * DAY_S)

    @property
    def begin_s(self) -> float:
        """Begin by its clock; by its date where there is no clock or one without days; else NaN."""
        clock, date = float(self.time_s[0]), self.protocol.date or self.recording.date
        dated = _days_since_epoch(date) * DAY_S + finite_or(self.protocol.time_of_day_s) if date else NAN
        right = np.isfinite(clock) and not (self.protocol.date and abs(clock - dated) > 1.5 * DAY_S)
        return clock if right else dated


def observe_points(measured: Sequence[Measured] | Measured) -> Observations:
    """Return the accepted points of one or several recordings, one sample a press.

    Without those at the touch within a depth's zero and a force's noise, as (0, 0): they do not depend on the gel.
    A warning names them.
    """
    sets = as_sets(measured)
    kept, warnings = zip(*map(_pressed, sets), strict=True)
    data = _gather(sets, [t for k, m in enumerate(kept) for t in _point_touches(m, k)])
    return data.warned(*filter(None, warnings))


def _pressed(measured: Measured) -> tuple[Measured, str]:
    """Return the recording without accepted points at the touch, and a warning that names them."""
    at = [p for p in measured.points if p.accepted and _at_touch(p)]
    if not at:
        return measured, ""
    named = some(list(dict.fromkeys(p.press for p in at)))
    said = f"{len(at)} rows are excluded, whose depth and force are 0 within their noise (press {named})"
    kept = tuple(p for p in measured.points if not (p.accepted and _at_touch(p)))
    return replace(measured, points=kept), f"{_file(measured, POINTS)}: {said}"


def _at_touch(point: CertifiedPoint) -> bool:
    noise = finite_or(point.depth_std_mm, TYPICAL_ZERO_MM), finite_or(point.fz_std_N, TYPICAL_FORCE_N)
    return abs(point.depth_mm) <= noise[0] and abs(point.fz_N) <= noise[1]


def _file(measured: Measured, name: str) -> str:
    return f"{measured.recording.name}: {name}" if measured.recording.name else name


def observe_curves(measured: Sequence[Measured] | Measured) -> Observations:
    """Return every finite sample of the curves of one or several recordings, without wild ones.

    Warnings name these, and presses whose times are too coarse. Raises InputError where a press is not listed or
    holds no finite sample, and where more than a few samples are wild.
    """
    sets = as_sets(measured)
    used = [replace(m, curves=tuple(map(_finite, m.curves))) for m in sets]
    wild = [without_wild(m.curves, where=_file(m, CURVES)) for m in used]
    kept = [replace(m, curves=curves) for m, (curves, _) in zip(used, wild, strict=True)]
    data = _gather(sets, [t for k, m in enumerate(kept) for t in _curve_touches(m, k)])
    data = replace(data, rounded_mm=rounding_mm(data))
    return data.warned(*filter(None, (*(warning for _, warning in wild), *map(_coarse, kept))))


def _finite(curve: Curve) -> Curve:
    use = np.isfinite(curve.time_s) & np.isfinite(curve.depth_mm) & np.isfinite(curve.force_N[:, 2])
    if not use.any():
        raise InputError("a curve has no sample with time, depth and force", where=f"press {curve.press}")
    return curve.samples(use)


def _coarse(measured: Measured) -> str:
    """Return a warning that names the presses whose times do not grow with their samples."""
    named = [curve.press for curve in measured.curves if stand_still(curve.time_s)]
    said = (
        f"{_file(measured, CURVES)}: time_s stays the same over several samples of press {some(named)}, so that "
        "relaxation, a clock offset and whatever else acts within a press cannot be determined. Record finer "
        "times, or exclude these presses"
    )
    return said if named else ""


def _point_touches(measured: Measured, number: int) -> Iterator[_Touch]:
    recording = measured.recording
    protocol = {p.press: p for p in recording.presses}
    for point in (one for one in measured.points if one.accepted):
        row = _merge(protocol.get(point.press), point)
        samples = {
            "time_s": [point.time_s],
            "depth_mm": [point.depth_mm],
            "force_N": [[finite_or(point.fx_N), finite_or(point.fy_N), point.fz_N]],
            "phase": ["load"],
            "temperature_C": [row.temperature_C],
            "depth_std_mm": [own_depth_std(point, recording.indenters[row.indenter], recording=recording)],
            "force_std_N": [point.fz_std_N],
            "reconstructed_mm": [point.details.reconstructed_depth_mm],
            "reconstructed_std_mm": [point.details.reconstructed_std_mm],
        }
        arrays = {name: np.array(values) for name, values in samples.items()}
        yield _Touch(recording, number, row, arrays, tuple(_falls(point, number)))


def _falls(point: CertifiedPoint, number: int) -> Iterator[EdgeDrop]:
    """Yield the falls next to the face of one press, where their slopes are sound."""
    profile = point.edge_profile
    if profile is None or not (np.isfinite(profile.slope_gain_std) and profile.ball_slope > 0):
        return
    for drop in profile.drops:
        place = (drop.azimuth_deg, drop.from_mm, drop.to_mm)
        yield EdgeDrop(number, point.press, *place, drop.drop_mm, profile.slope_gain_std, profile.ball_slope)


def _curve_touches(measured: Measured, number: int) -> Iterator[_Touch]:
    recording = measured.recording
    protocol = {p.press: p for p in recording.presses}
    for curve in measured.curves:
        row = protocol.get(curve.press) or _only_indenter(recording, curve.press)

        def recorded(name: str, otherwise: float, curve: Curve = curve) -> Floats:
            found = curve.extra.get(name)
            return np.full(curve.time_s.size, otherwise) if found is None else np.asarray(found, dtype=float)

        whole = {name: recorded(name, NAN) for name in OF_PICTURE}
        of_picture = bool(np.isfinite([*whole.values()]).all())
        if of_picture:  # its own errors are larger than the sensors'
            recording = replace(recording, depth_std_mm=None, force_std_N=None)
        arrays: dict[str, Any] = {
            "time_s": curve.time_s,
            "depth_mm": curve.depth_mm,
            "force_N": np.nan_to_num(curve.force_N),
            "phase": curve.phase,
            "temperature_C": recorded("temperature_C", row.temperature_C),
            "depth_std_mm": recorded("", finite_or(recording.depth_std_mm, NAN)),
            "force_std_N": recorded("", NAN if recording.force_std_N is None else recording.force_std_N[2]),
            "reconstructed_mm": recorded("reconstructed_depth_mm", NAN),
            "reconstructed_std_mm": recorded("", NAN),
        }
        if of_picture:
            arrays["resultants"] = _resultants(whole, curve.depth_mm)
        yield _Touch(recording, number, row, arrays)


def _resultants(columns: Mapping[str, Floats], depth_mm: Floats) -> Resultants:
    """Return the resultants (N,) of one press's pictures, with the slope of ln R over ln w through all of them."""
    force, inside = columns["picture_fz_N"], (depth_mm > 0) & (columns["picture_fz_N"] > 0)
    w, R = np.log(np.where(inside, depth_mm, 1.0)), np.log(np.where(inside, force, 1.0))
    off = np.where(inside, w - np.mean(w, where=inside), 0.0) if inside.any() else np.zeros(w.size)
    slope = float(off @ R / max(off @ off, TINY))
    known = np.ptp(w[inside]) > LEAST_RANGE if inside.any() else False
    power = np.full(force.size, np.clip(slope, *POWERS) if known else 1.0)
    std = np.minimum(columns["picture_fz_model_std_N"] / np.maximum(force, TINY), MOST_STD)
    return Resultants(force, std, depth_mm, power, columns["picture_fz_of_thickness"], columns["picture_cut"])


def _gather(sets: Sequence[Measured], touches: Sequence[_Touch]) -> Observations:
    if not touches:
        raise InputError("there is no press to fit", remedy="Hand in accepted points, or curves.")
    gel = _one_gel([m.recording for m in sets])
    touches = sorted(
        touches, key=lambda t: (finite_or(t.begin_s, math.inf), t.number, finite_or(t.time_s[0], math.inf))
    )
    origin = math.floor(touches[0].begin_s / DAY_S) * DAY_S if np.isfinite(touches[0].begin_s) else 0.0
    indenters = list(dict.fromkeys(t.indenter for t in touches))
    sizes = [t.time_s.size for t in touches]

    def joined(name: str) -> Any:
        return np.concatenate([t.arrays[name] for t in touches])

    seen, seen_std = joined("reconstructed_mm"), joined("reconstructed_std_mm")
    of_picture = [t.arrays["resultants"] for t in touches if "resultants" in t.arrays]
    if 0 < len(of_picture) < len(touches):
        raise InputError(
            "some presses have resultants of pictures and others have none",
            where=touches[0].recording.name,
            remedy="Name recordings of one kind: what `force` wrote, or depth and force.",
        )
    return Observations(
        gel=gel,
        indenters=tuple(indenters),
        presses=_presses(touches, indenters, origin),
        press=np.repeat(np.arange(len(touches)), sizes),
        **{name: joined(name) for name in OF_SAMPLES if name != "time_s"},
        time_s=np.concatenate([t.time_s for t in touches]) - origin,
        depth_source=depth_source(sets),
        reconstructed_mm=seen if np.isfinite(seen).any() else None,
        reconstructed_std_mm=seen_std if np.isfinite(seen_std).any() else None,
        falls=tuple(fall for t in touches for fall in t.falls),
        resultants=Resultants.joined(of_picture) if of_picture else None,
        recordings=tuple(m.recording.name for m in sets),
        shared=shared_errors(sets),
    )


def _presses(touches: Sequence[_Touch], indenters: Sequence[Indenter], origin: float) -> Presses:
    def column(name: str) -> Floats:
        return np.array([float(getattr(t.protocol, name)) for t in touches])

    begin = np.array([t.time_s[0] for t in touches]) - origin
    end = np.array([t.time_s[-1] for t in touches]) - origin
    rest = column("rest_s")
    if any(t.time_s.size > 1 for t in touches):  # curves show the rest themselves
        gap = np.concatenate([[NAN], begin[1:] - end[:-1]])
        rest = np.where(np.isfinite(rest), rest, gap)
    speed = column("speed_mm_s")
    speed = np.where(np.isfinite(speed), speed, [_speed(t) for t in touches])
    return Presses(
        label=tuple(t.protocol.press for t in touches),
        recording=np.array([t.number for t in touches]),
        indenter=np.array([indenters.index(t.indenter) for t in touches]),
        radius_mm=np.array([t.indenter.radius_mm for t in touches]),
        rest_s=rest,
        speed_mm_s=speed,
        **{name: column(name) for name in ("x_mm", "y_mm", "hold_s", "temperature_C", "lubricated")},
        day=np.array([_day(t, origin) for t in touches]),
        order=np.arange(len(touches), dtype=float),
    )


def _speed(touch: _Touch) -> float:
    """Return the median speed of loading, mm/s; NaN for a single sample."""
    phase = touch.arrays["phase"]
    loading = phase == "load" if (phase == "load").any() else phase != "free"
    time, depth = touch.time_s[loading], touch.arrays["depth_mm"][loading]
    ticks = np.diff(time, prepend=-math.inf) > 0  # the first sample of several with one time
    if ticks.sum() < 2:
        return NAN
    rate = np.diff(depth[ticks]) / np.diff(time[ticks])
    return float(np.median(rate[rate > 0])) if (rate > 0).any() else NAN


def _day(touch: _Touch, origin: float) -> float:
    if np.isfinite(touch.begin_s):
        return (touch.begin_s - origin) / DAY_S
    return 0.0 if touch.number == 0 else NAN


def _days_since_epoch(date: object) -> float:
    """Return the days of a date, a datetime or an ISO text; 0 where there is none."""
    if isinstance(date, str) and date:
        date = datetime.date.fromisoformat(date[:10])
    return float(date.toordinal()) if isinstance(date, datetime.date) else 0.0


def _one_gel(recordings: Sequence[Recording]) -> Gel:
    gels = [r.sensor.gel for r in recordings]
    first = gels[0]
    if first is None:
        raise InputError(
            "the gel's thickness is needed to fit a material",
            where=recordings[0].name,
            remedy="Add [sensor.gel] thickness_mm to recording.toml.",
        )
    if not first.is_flat:
        raise InputError(
            "the laws of a flat layer do not fit a gel of this shape",
            where=recordings[0].name,
            value=first.shape,
            remedy="`tactilevision force` finds E of its own mesh, by the readings of the force sensor.",
        )
    for recording, gel in zip(recordings, gels, strict=True):
        if gel is None or gel.thickness_mm != first.thickness_mm:
            raise InputError(
                "recordings that are fitted together must be of one gel",
                where=recording.name,
                value=None if gel is None else gel.thickness_mm,
                remedy=f"The first one states thickness_mm = {first.thickness_mm:g}.",
            )
    return first


def _only_indenter(recording: Recording, press: str) -> Press:
    if len(recording.indenters) != 1:
        raise InputError(
            "a curve's press is not listed, so its indenter is unknown",
            where=f"press {press}",
            remedy="Add the press to presses.csv.",
        )
    return Press(press, next(iter(recording.indenters)), NAN, NAN)


def _merge(protocol: Press | None, point: CertifiedPoint) -> Press:
    """Return the protocol's row, with the point's own values where it has them."""
    row = protocol or Press(point.press, point.indenter, NAN, NAN)
    stated = ("rest_s", "speed_mm_s", "x_mm", "y_mm", "temperature_C", "lubricated", "hold_s")
    own = {name: getattr(point, name) for name in stated}
    return replace(row, **{name: value for name, value in own.items() if np.isfinite(value)})
