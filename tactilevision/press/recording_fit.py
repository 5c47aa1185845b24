"""Set up the forward model for a recording, fit it, and read the contact event of every press from it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.contact.bevel import (
    EDGE_MM,
    SIDES,
    Growth,
    find_onset,
    height_signal,
)
from tactilevision.press.clock import smooth_force
from tactilevision.press.contact_event import DETECTION_CHI2
from tactilevision.press.fit import OWN, ModelFit, Prior, fit_model
from tactilevision.press.force_readings import (
    ForceWindow,
    contact_point,
    find_phases,
    moving_s,
    noise_of,
    top_s,
)
from tactilevision.press.model import SHARE, Own, PressData, PressModel, Whole
from tactilevision.press.track import PressTrack, face_tilt
from tactilevision.recording.model import StageSeries
from tactilevision.records.measured import Floats, ForceSeries
from tactilevision.records.rig import Indenter

BINS = 48  # means of readings along a ramp
RAMP_BEFORE = 0.3  # of the ramp's length: readings before first contact
EARLY = 0.85  # of the depth of touch, as the camera reads it to a tenth: before the touch
BEND = 0.02  # one sigma of the change of a bevel signal's slope over the depths of a press
SHAPE_STD = 0.1  # of the fill: a touch's uncertainty by the shape of the growing dent, common to all presses
RIG_COMPLIANCE = 0.005  # mm/N, one sigma: rigs with their F/T sensors stand at 200 N/mm or so
STAGE_STD = 0.005  # of 1, one sigma of a motion stage's scale
ANGLE_DEG = 10.0  # of a bevel without stated angle
POWERS = {"flat_cylinder": 1.0, "sphere": 1.5, "cone": 2.0}
MAX_GAIN = 400.0  # of chi-square: limit on a press's weight in the search for a start
ROUNDS = 12  # of new noise and weights, from a start
ROUNDS_AGAIN = 6  # from a fit of more presses


@dataclass(frozen=True, slots=True)
class Tracked:
    """A press with a face and a force: H/(1 + rho), and the bevel's place where it is given or found (mm)."""

    track: PressTrack
    window: ForceWindow
    nominal_mm: float
    distance_mm: float | None


def fill_mm(indenter: Indenter) -> float:
    """Return the depth (mm) beyond the touch at which the bevel's wedge fills the window at its edge."""
    angle = indenter.bevel_angle_deg if indenter.bevel_angle_deg is not None else ANGLE_DEG
    return EDGE_MM * float(np.tan(np.radians(np.clip(angle, 1.0, 60.0))))


def kind_of(indenter: Indenter) -> tuple[object, ...]:
    """Return what presses must share for one contact law and one bevel."""
    return indenter.shape, indenter.radius_mm, indenter.half_angle_deg, indenter.bevel, indenter.bevel_distance_mm


def fit_recording(
    presses: Sequence[Tracked],
    forces: ForceSeries,
    *,
    offset_s: float,
    thickness_mm: float,
    stage: StageSeries | None = None,
    offset_std_s: float = np.inf,
    delay_std_mm: float = 0.0,
) -> ModelFit:
    """Fit the forward model to presses; `forces` without their zeros.

    `offset_std_s`: 0 for stated clocks. `delay_std_mm`: common delay of detection, since pictures suppress faint
    dents.
    """
    model = _model(presses, forces, offset_s, thickness_mm, stage)
    prior = _prior(model, presses, stage, offset_s, offset_std_s, delay_std_mm)
    shared, own = _start(model, prior, offset_s)
    return fit_model(model, shared, own, prior, rounds=ROUNDS)


def fit_again(first: ModelFit, names: Collection[str]) -> ModelFit:
    """Fit the presses of these `names` alone, from a fit of more presses."""
    chosen = [k for k, one in enumerate(first.model.presses) if one.name in names]
    return fit_model(*_part(first, chosen), rounds=ROUNDS_AGAIN)


def fit_others(first: ModelFit, final: ModelFit) -> ModelFit:
    """Fit the presses of `first` that `final` excludes, with the contact law and the clocks of `final`."""
    names = {one.name for one in final.model.presses}
    chosen = [k for k, one in enumerate(first.model.presses) if one.name not in names]
    model, _, own, prior = _part(first, chosen)
    return fit_model(model, final.shared, own, prior, rounds=2, frozen=True)


def _part(fit: ModelFit, chosen: Sequence[int]) -> tuple[PressModel, Floats, Floats, Prior]:
    """Return model, unknowns and prior of some presses of a fit; kinds and heights keep their numbers."""
    model = replace(fit.model, presses=[fit.model.presses[k] for k in chosen])
    prior = replace(fit.prior, own=fit.prior.own[chosen], own_std=fit.prior.own_std[chosen])
    return model, fit.shared, fit.own[chosen], prior


def _model(
    presses: Sequence[Tracked],
    forces: ForceSeries,
    offset_s: float,
    thickness_mm: float,
    stage: StageSeries | None,
) -> PressModel:
    kinds, heights = [], []
    data = []
    stated = any(np.isfinite(one.track.press.speed_mm_s) for one in presses)
    tilts = [_tilt_mm(one) for one in presses]
    usual_tilt = float(np.nanmedian(tilts)) if np.isfinite(tilts).any() else 0.0
    for one, tilt in zip(presses, tilts, strict=True):
        track, window, indenter = one.track, one.window, one.track.indenter
        assert window.phases is not None
        kinds.append(kind_of(indenter))
        bevel = np.isfinite(one.nominal_mm) and one.distance_mm is not None
        end = top_s(window)
        signal = np.full(track.time_s.size, np.nan)
        if bevel and track.footprint is not None and one.distance_mm is not None:
            read = height_signal(
                track.strips, track.s_mm, distance_mm=one.distance_mm, radius_mm=track.footprint.radius_mm
            )
            if read is not None:
                signal = read
        heights.append(indenter.name if bevel else "")
        contact = contact_point(window, _before_touch_s(one, offset_s))
        start = None if contact is None else contact.time_s
        speed = track.press.speed_mm_s if stated else 1.0
        way = None if start is None else _way(window, start, stage, speed)
        ramp = np.zeros((3, 0)) if way is None or start is None else _ramp(window, start, end)
        data.append(
            PressData(
                track=track,
                window=window,
                kind=0,
                height=-1,
                nominal_mm=one.nominal_mm if bevel else np.inf,
                distance_mm=one.distance_mm,
                tilt_mm=tilt - usual_tilt if np.isfinite(tilt) else 0.0,
                signal_mm=signal,
                way=way,
                top_s=end,
                released_s=float(window.time_s[window.phases.release]),
                ramp_s=ramp[0],
                ramp_N=ramp[1],
                ramp_std_N=ramp[2],
                start_s=float(window.time_s[window.phases.onset]) if start is None else start,
            )
        )
    order, machined = list(dict.fromkeys(kinds)), [name for name in dict.fromkeys(heights) if name]
    data = [
        replace(one, kind=order.index(kind), height=machined.index(name) if name else -1)
        for one, kind, name in zip(data, kinds, heights, strict=True)
    ]
    return PressModel(
        presses=data,
        powers=np.array([POWERS[str(kind[0])] for kind in order]),
        heights=len(machined),
        force_time_s=forces.time_s,
        force_N=smooth_force(forces),
        thickness_mm=thickness_mm,
        fill_mm=max(fill_mm(one.track.indenter) for one in presses),
    )


def _tilt_mm(one: Tracked) -> float:
    return float(face_tilt(one.track) @ np.array(SIDES[one.track.side])) * (one.distance_mm or 0.0)


def _before_touch_s(one: Tracked, offset_s: float) -> float:
    """Return a time before the bevel touches, by the camera's depth; the end of the ramp without a bevel."""
    window, track = one.window, one.track
    assert window.phases is not None
    end = float(window.time_s[window.phases.hold])
    if not np.isfinite(one.nominal_mm):
        return end
    deep = np.flatnonzero(track.depth_mm > EARLY * one.nominal_mm)
    return min(float(track.time_s[deep[0]]) + offset_s, end) if deep.size else end


def _way(window: ForceWindow, start_s: float, stage: StageSeries | None, speed_mm_s: float) -> Floats | None:
    """Return m (T,) at the window's readings: stage, or speed times the time in motion; None: not known."""
    if stage is not None:
        end = top_s(window)
        if stage.time_s[0] > start_s or end > stage.time_s[-1] or _still_approaching(stage, start_s, end):
            return None
        place = np.interp(np.minimum(window.time_s, end), stage.time_s, stage.z_mm)
        return np.asarray(np.maximum.accumulate(place))
    if not np.isfinite(speed_mm_s):
        return None
    return speed_mm_s * moving_s(window, float(window.time_s[0]), time_s=window.time_s)


def _still_approaching(stage: StageSeries, start_s: float, end_s: float) -> bool:
    """Return whether the stage moves farther between two readings about first contact than ever on the way in.

    The zero of the travel then lies anywhere between those readings.
    """
    step = np.abs(np.diff(stage.z_mm))
    first = int(np.searchsorted(stage.time_s, start_s))
    last = int(np.searchsorted(stage.time_s, end_s))
    about, later = step[max(first - 2, 0) : first + 1], step[first + 1 : last]
    return bool(later.size and about.size and about.max() > 2 * later.max())


def _ramp(window: ForceWindow, begun_s: float, end_s: float) -> Floats:
    """Return times, means and stds (3, R) of the normal force along the ramp."""
    time, force = window.time_s, window.force_N[:, 2]
    inside = (time >= begun_s - RAMP_BEFORE * (end_s - begun_s)) & (time <= end_s) & np.isfinite(force)
    time, force = time[inside], force[inside]
    each = max(time.size // BINS, 1)
    count = time.size // each
    mean = [part[: count * each].reshape(count, each).mean(axis=1) for part in (time, force)]
    return np.array([*mean, np.full(count, max(noise_of(window.force_N[:, 2]), 1e-9) / np.sqrt(each))])


def _prior(
    model: PressModel,
    presses: Sequence[Tracked],
    stage: StageSeries | None,
    offset_s: float,
    offset_std_s: float,
    delay_std_mm: float,
) -> Prior:
    """Return what is known of the unknowns before the fit."""
    mean, std = np.zeros(model.shared), np.full(model.shared, np.inf)

    def state(name: str, column: int, value: float, sigma: float) -> None:
        model.block(mean, name)[..., column] = value
        model.block(std, name)[..., column] = sigma

    deepest = max(float(np.nanmax(one.track.depth_mm)) for one in model.presses)
    delay = float(np.hypot(SHAPE_STD * model.fill_mm, delay_std_mm))
    if any(one.track.indenter.bevel_distance_mm is None for one in model.presses if np.isfinite(one.nominal_mm)):
        delay = float(np.hypot(delay, 0.5 * model.fill_mm))  # an edge that was found lies anywhere in its window
    priors = {
        Whole.OFFSET: (offset_s, max(offset_std_s, 1e-9)),
        Whole.PACE: (1.0, STAGE_STD if stage is not None else np.inf),
        Whole.COMPLIANCE: (0.0, RIG_COMPLIANCE),
        Whole.SHIFT: (0.0, 0.01 * deepest),
        Whole.SHARE_1: (0.0, 0.3),
        Whole.SHARE_2: (0.0, 0.3),
        Whole.DELAY: (0.0, delay),
        Whole.TILT: (0.0, 1.0),
        Whole.FILL: (-0.35, 0.7),
    }
    for unknown, (value, sigma) in priors.items():
        state("recording", unknown, value, sigma)
    for column, (value, sigma) in enumerate(((0.0, np.inf), (0.8, 1.0), (0.0, 5.0), (0.0, 0.15))):
        state("law", column, value, sigma)
    for column, (value, sigma) in enumerate(((1.0, 0.1), (0.0, 1.0), (0.0, 5.0))):
        state("camera", column, value, sigma)
    state("amplitude", 0, float(np.log(0.3)), 2.0)
    heights = {one.height: one for one in model.presses if one.height >= 0}
    for place, one in heights.items():
        model.block(std, "height")[place] = max(one.track.indenter.height_std_mm, 1e-6)
    count = len(model.presses)
    own_mean, own = np.zeros((count, OWN)), np.full((count, OWN), np.inf)
    own_mean[:, [Own.GAIN, Own.CAMERA_GAIN, Own.DENT]] = 1.0
    own[:, [Own.GAIN, Own.CAMERA_GAIN, Own.TOUCH, Own.DENT]] = 0.01, 0.1, 0.003, 0.15
    for k, one in enumerate(model.presses):
        tare = float(one.window.tare.std_N[2])
        own[k, Own.ZERO] = max(tare, 1e-5) if np.isfinite(tare) else 1e-5
        own[k, Own.BEND] = BEND / float(np.nanmax(one.track.depth_mm))
    return Prior(mean, std, own_mean, own)


def _start(model: PressModel, prior: Prior, offset_s: float) -> tuple[Floats, Floats]:
    """Return unknowns near the solution: the pace (or the camera's scale) at which the dents begin together."""
    shared, own = prior.shared.copy(), prior.own.copy()
    model.block(shared, "recording")[Whole.OFFSET] = offset_s
    ways = [
        None
        if one.way is None
        else np.maximum(np.interp(one.track.time_s + offset_s, one.window.time_s, one.way)
                        - np.interp(one.start_s, one.window.time_s, one.way), 0.0)
        for one in model.presses
    ]  # fmt: skip
    paced = [k for k, way in enumerate(ways) if way is not None]
    drives = [one.track.depth_mm if way is None else way for one, way in zip(model.presses, ways, strict=True)]
    pace = 1.0
    if paced:
        depth = np.median([np.nanmax(model.presses[k].track.depth_mm) for k in paced])
        pace = float(depth / max(np.median([np.nanmax(drives[k]) for k in paced]), 1e-9))
    chosen = paced or list(range(len(model.presses)))
    scale = pace * _depth_over_onset(model, {k: pace * drives[k] for k in chosen}, offset_s)
    if paced:
        model.block(shared, "recording")[Whole.PACE] = scale
    force = np.interp(
        np.concatenate([one.track.time_s for one in model.presses]) + offset_s, model.force_time_s, model.force_N
    )
    parts = np.split(force, np.cumsum([one.track.time_s.size for one in model.presses])[:-1])
    for kind, power in enumerate(model.powers):
        ratios, seen = [], []
        for k in np.flatnonzero(model.kinds == kind).tolist():
            one, drive = model.presses[k], (scale if k in chosen else 1.0) * drives[k]
            deep = (one.track.depth_mm > 0.3 * np.nanmax(one.track.depth_mm)) & (drive > 0) & (parts[k] > 0)
            u = drive[deep] / model.thickness_mm
            ratios += list(parts[k][deep] / (drive[deep] ** power * (1 + 0.8 * u)))
            seen += list(one.track.depth_mm[deep] / drive[deep])
        model.block(shared, "law")[kind] = [np.log(np.median(ratios)) if ratios else 0.0, 0.8, 0.0, 0.0]
        model.block(shared, "camera")[kind, 0] = np.median(seen) if seen else 1.0
    return shared, own


def _depth_over_onset(model: PressModel, depths_mm: Mapping[int, Floats], offset_s: float) -> float:
    """Return the machined depth over the one at which the bevel's dent begins: the presses' weighted median."""
    ratios, weights = [0.0], [0.0]
    for k, depth_mm in depths_mm.items():
        one = model.presses[k]
        way_in = one.track.time_s + offset_s <= one.top_s
        growth = Growth(SHARE, 0.7 * model.fill_mm)
        onset = find_onset(depth_mm[way_in], one.signal_mm[way_in], growth=growth) if one.height >= 0 else None
        if onset is not None and onset.gain > DETECTION_CHI2 and onset.at > 0:
            ratios.append(one.nominal_mm / onset.at)
            weights.append(onset.at / onset.std)
    order = np.argsort(ratios)
    total = np.cumsum(np.array(weights)[order])
    return float(np.array(ratios)[order][np.searchsorted(total, 0.5 * total[-1])]) if total[-1] > 0 else 1.0


def find_distance(tracks: Sequence[PressTrack]) -> float | None:
    """Return the distance (mm) from the axis at which the dent of a bevel is most significant; None: nowhere."""
    near = max(one.indenter.radius_mm for one in tracks) + 0.8
    far = max(float(one.s_mm[-1]) for one in tracks)
    coarse = _surest_place(tracks, np.arange(near, far, 2 * EDGE_MM))
    return None if coarse is None else _surest_place(tracks, coarse + np.linspace(-2 * EDGE_MM, 2 * EDGE_MM, 7))


def _surest_place(tracks: Sequence[PressTrack], places: Floats) -> float | None:
    totals = np.zeros(places.size)
    for one in tracks:
        growth = Growth(SHARE, 0.7 * fill_mm(one.indenter))
        seen = find_phases(one.depth_mm)
        loaded = slice(0, None if seen is None else seen.release + 1)
        radius = one.footprint.radius_mm if one.footprint is not None else one.indenter.radius_mm
        for k, place in enumerate(places):
            signal = height_signal(one.strips, one.s_mm, distance_mm=float(place), radius_mm=radius)
            if signal is None:
                continue
            signal = signal[loaded]
            onset = find_onset(one.depth_mm[loaded], signal, growth=growth, noise=max(noise_of(signal), 1e-6))
            totals[k] += 0.0 if onset is None else min(onset.gain, MAX_GAIN) / len(tracks)
    if not places.size or totals.max() < DETECTION_CHI2:
        return None
    best = int(totals.argmax())
    around = slice(max(best - 1, 0), best + 2)
    return float(np.average(places[around], weights=totals[around]))
