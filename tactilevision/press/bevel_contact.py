"""Find the first contact of the bevel in every press of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.contact.bevel import (
    EDGE_MM,
    Growth,
    Onset,
    find_onset,
    height_signal,
    onset_of,
    onset_sums,
    picture_signal,
)
from tactilevision.press.event_force import force_crossing
from tactilevision.press.force_readings import ForceWindow, contact_point, find_phases, moving_s, noise_of
from tactilevision.press.track import PressTrack
from tactilevision.records.measured import Bools, Floats, Pair
from tactilevision.records.rig import Indenter
from tactilevision.robust import MAD_TO_STD, mad_std

# The contact event: first touch of the bevel, as it was certified.


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """First touch of the bevel: camera time and std, the depth that the camera read then, channel, onset.

    `seen_s`: when frames showed it, if the travel scale has moved it since; else NaN.
    """

    time_s: float
    std_s: float
    depth_seen_mm: float
    channel: str
    onset: Onset
    seen_s: float = float("nan")


# First touch of the bevel in every press of a recording, by a joint search.
#
# The presses share the bevel and hence the shape of the growing dent (its amplitude per depth, its share k); each
# has its own depth of touch. The depth that drives the signal is read from the force, P = c w (1 + b w), c and b
# from the touches themselves at the machined heights: a height map's own depth is too nonlinear where walls are
# steep.

DETECTION_CHI2 = 25.0  # fall of chi-square that counts as a contact event: five sigma
# An edge drags gel along from the start: a wedge on a bonded layer (plane strain, 5 to 20 degrees) begins with .6
# to .3 of its final growth; less where a camera or compression suppresses the faintest dents.
# Initial share of the growth, dimensionless.
_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
# of fill_mm: lengths over which blur and gel smooth the growth, not known beforehand
_FILLS = (0.25, 0.5, 1.0, 2.0)
SHAPE_STD = 0.1  # of fill_mm: uncertainty by the family of shapes; benchmarks.certificate
_TYPICAL = 0.4  # initial share of the growth, for a first search
_MAX_GAIN = 400.0  # of chi-square: limit on a press's weight in the bevel's place
PILE_UP = 0.09  # of the depth, for a first estimate: a common factor, which does not affect the search
# of the depth at which the law of all presses has a touch, one sigma; test_bevel_contact_depth
_DUE_STD = 0.03
_ANGLE_DEG = 10.0  # degrees, of a bevel without stated angle
# of the amplitude, by which presses of one bevel differ, one sigma: at least, at most
_AMPLITUDE_STD = (0.03, 0.15)
_MIN_COUNT = 4  # presses that determine their amplitudes' scatter; benchmarks.certificate


@dataclass(frozen=True, slots=True, eq=False)
class PressSignal:
    """A press to be searched: its frames up to the end of the hold (`use`), driving depth or force (N,)."""

    track: PressTrack
    drive: Floats
    use: Bools

    def signal(self, distance_mm: float) -> Floats | None:
        """Return the bevel signal (N,) mm of the height map, for the edge at `distance_mm`; None out of view."""
        track = self.track
        radius = track.footprint.radius_mm if track.footprint else track.indenter.radius_mm
        return height_signal(track.strips, track.s_mm, distance_mm=distance_mm, radius_mm=radius)


@dataclass(frozen=True, slots=True)
class DepthOfForce:
    """w(P) of P = c w (1 + b w)."""

    c_N_per_mm: float
    b_per_mm: float

    def depth(self, force_N: Floats) -> Floats:
        """Return the depth (mm) at forces (N) of any shape."""
        force = np.asarray(force_N, dtype=np.float64)
        if self.b_per_mm == 0:
            return force / self.c_N_per_mm
        root = np.sqrt(np.maximum(1 + 4 * self.b_per_mm * force / self.c_N_per_mm, 1e-6))
        return np.asarray((root - 1) / (2 * self.b_per_mm), dtype=np.float64)

    def force(self, depth_mm: Floats | float) -> Floats:
        """Return the force (N) at depths (mm) of any shape."""
        w = np.asarray(depth_mm, dtype=np.float64)
        return np.asarray(self.c_N_per_mm * w * (1 + self.b_per_mm * w), dtype=np.float64)


def depth_of_force(anchors: Sequence[Pair]) -> DepthOfForce | None:
    """Return c and b by a robust fit to (depth, force) anchors; b is 0 where all depths are similar."""
    usable = np.array([a for a in anchors if a[0] > 0 and a[1] > 0])
    if not len(usable):
        return None
    depth, stiffness = usable[:, 0], usable[:, 1] / usable[:, 0]
    if np.ptp(depth) < 0.25 * depth.max():
        return DepthOfForce(float(np.median(stiffness)), 0.0)
    keep = np.ones(depth.size, dtype=bool)
    slope, start = 0.0, float(np.median(stiffness))
    for _ in range(5):  # touches that are seen late by compression lie on one side: no median slope
        slope, start = (float(v) for v in np.polyfit(depth[keep], stiffness[keep], 1))
        residual = np.abs(stiffness - start - slope * depth)
        keep = residual <= max(3 * MAD_TO_STD * float(np.median(residual)), 1e-9)
        if keep.sum() < 3:
            break
    return DepthOfForce(start, max(slope / start, 0.0)) if start > 0 else None


def find_bevel_contacts(signals: Sequence[PressSignal], distance_mm: float) -> list[Onset | None]:
    """Return the onset of each press; None where its bevel is out of view or its signal never rises."""
    traces = [press_signal.signal(distance_mm) for press_signal in signals]
    known = [
        (press_signal.drive[press_signal.use], trace[press_signal.use])
        for press_signal, trace in zip(signals, traces, strict=True)
        if trace is not None
    ]
    found = iter(_joint_onsets(known, max(fill_mm(press_signal.track.indenter) for press_signal in signals)))
    return [None if trace is None else next(found) for trace in traces]


def fill_mm(indenter: Indenter) -> float:
    """Return the depth (mm) beyond the touch at which the bevel's wedge fills the window at its edge."""
    angle = indenter.bevel_angle_deg if indenter.bevel_angle_deg is not None else _ANGLE_DEG
    return EDGE_MM * float(np.tan(np.radians(np.clip(angle, 1.0, 60.0))))


def _joint_onsets(traces: Sequence[tuple[Floats, Floats]], fill: float) -> list[Onset | None]:
    """Return onsets of signals (x, y) of one shape: the mean over shares k and lengths L, by their likelihood."""
    first = [find_onset(x, y, growth=Growth(_TYPICAL, fill)) for x, y in traces]
    sure = [onset for onset in first if onset is not None and onset.gain > DETECTION_CHI2]
    if not sure:
        return first
    noise = float(np.median([onset.noise for onset in sure]))
    trials, misfit = [], []
    for length in (part * fill for part in _FILLS):
        sums = [onset_sums(x, y, length) for x, y in traces]
        for growth in (Growth(share, length) for share in _SHARES):
            free = [onset_of(one, growth, noise=noise) for one in sums]
            seen = [o for o in free if o is not None and o.gain > DETECTION_CHI2]
            alike = _shared_amplitude(seen)
            trial = [onset_of(one, growth, noise=noise, amplitude=alike) for one in sums]
            trials.append(trial)
            misfit.append(float(np.sum([o.chi2 for o in trial if o is not None])) if alike else np.inf)
    count = sum(len(x) for x, _ in traces)
    scale = max(float(np.min(misfit)) / max(count - 4 * len(traces), 1), 1.0)
    weights = np.exp(-0.5 * (np.array(misfit) - np.min(misfit)) / scale)
    return [
        _mixture([trial[k] for trial in trials], weights, scale=scale, shape_mm=SHAPE_STD * fill)
        for k in range(len(traces))
    ]


def _shared_amplitude(onsets: Sequence[Onset]) -> Pair | None:
    """Return the mean amplitude, and the scatter of the presses' beyond their own errors; None without any."""
    if not onsets:
        return None
    amplitude = np.array([onset.amplitude for onset in onsets])
    own = np.array([onset.amplitude_std for onset in onsets])
    middle = float(np.median(amplitude))
    if len(onsets) < _MIN_COUNT:
        return middle, _AMPLITUDE_STD[1] * middle
    apart = mad_std(amplitude, centre=middle)
    beyond = float(np.sqrt(max(apart**2 - float(np.median(own**2)), 0.0)))
    return middle, float(np.clip(beyond, _AMPLITUDE_STD[0] * middle, _AMPLITUDE_STD[1] * middle))


def _mixture(onsets: Sequence[Onset | None], weights: Floats, *, scale: float, shape_mm: float) -> Onset | None:
    """Return the weighted mean of one onset's estimates under several shapes.

    `scale` is the best shape's chi-square per degree of freedom, `shape_mm` the common error of all shapes.
    """
    kept = [(onset, float(weight)) for onset, weight in zip(onsets, weights, strict=True) if onset is not None]
    if not kept or sum(weight for _, weight in kept) <= 0:
        return None
    share_out = np.array([weight for _, weight in kept])
    at = np.array([onset.at for onset, _ in kept])
    variance = scale * np.array([onset.std**2 for onset, _ in kept])
    mean = float(np.average(at, weights=share_out))
    best = kept[int(share_out.argmax())][0]
    shared = float(np.average((at - mean) ** 2, weights=share_out)) + shape_mm**2
    return replace(
        best,
        at=mean,
        std=float(np.sqrt(np.average(variance, weights=share_out) + shared)),
        shared_std=float(np.sqrt(shared)),
    )


def find_distance(signals: Sequence[PressSignal]) -> float | None:
    """Return the bevel edge's distance, where touches are most significant; None where none is."""
    near = max(press_signal.track.indenter.radius_mm for press_signal in signals) + 0.8
    far = max(float(press_signal.track.s_mm[-1]) for press_signal in signals)
    coarse = _surest_place(signals, np.arange(near, far, 2 * EDGE_MM))
    return None if coarse is None else _surest_place(signals, coarse + np.linspace(-2 * EDGE_MM, 2 * EDGE_MM, 7))


def _surest_place(signals: Sequence[PressSignal], places: Floats) -> float | None:
    totals = np.zeros(places.size)
    for k, place in enumerate(places):
        for press_signal in signals:
            trace = press_signal.signal(float(place))
            if trace is None:
                continue
            drive, trace = press_signal.drive[press_signal.use], trace[press_signal.use]
            growth = Growth(_TYPICAL, fill_mm(press_signal.track.indenter))
            onset = find_onset(drive, trace, growth=growth, noise=max(noise_of(trace), 1e-6))
            totals[k] += 0.0 if onset is None else min(onset.gain, _MAX_GAIN) / len(signals)
    if not places.size or totals.max() < DETECTION_CHI2:
        return None
    best = int(totals.argmax())
    around = slice(max(best - 1, 0), best + 2)
    return float(np.average(places[around], weights=totals[around]))


def find_in_pictures(
    signals: Sequence[PressSignal], onsets: Sequence[Onset | None], *, distance_mm: float
) -> list[Onset | None]:
    """Return the same touches from the change of the pictures' colours; None where they are not visible there.

    The search covers the touch of the height map, or its expected position where that is uncertain.
    """
    known: list[int] = []
    traces = []
    for k, (press_signal, onset) in enumerate(zip(signals, onsets, strict=True)):
        if onset is None or onset.gain <= DETECTION_CHI2:
            continue
        colours, drive = press_signal.track.colours[press_signal.use], press_signal.drive[press_signal.use]
        trace = picture_signal(
            colours,
            press_signal.track.s_mm,
            depth_mm=drive,
            distance_mm=distance_mm,
            onset=_with_due(onset, press_signal.track.indenter.height_mm),
        )
        if trace is not None:
            known.append(k)
            traces.append((drive, trace))
    found: list[Onset | None] = [None] * len(signals)
    if traces:
        fill = max(fill_mm(press_signal.track.indenter) for press_signal in signals)
        for k, onset in zip(known, _joint_onsets(traces, fill), strict=True):
            found[k] = onset
    return found


def _with_due(onset: Onset, height_mm: float | None) -> Onset:
    """Return an onset less certain than the law of all presses, combined with that law's touch."""
    due_mm = (height_mm or 0.0) / (1 + PILE_UP)
    std = _DUE_STD * due_mm
    if onset.std <= std or not std > 0:
        return onset
    weight = std**2 / (onset.std**2 + std**2)
    return replace(onset, at=weight * onset.at + (1 - weight) * due_mm, std=std)


# Presses with a common bevel and punch radius, searched for their touches together.
#
# The driving depth is read from the force; its law w(P) is anchored to the machined heights by the touches
# themselves, so search and law alternate.

_MAX_ITERATIONS = 3  # of search and law, which depend on each other; benchmarks.certificate
_MAX_UNEVEN = 0.02  # of the depth: a less even ramp cannot be extrapolated; benchmarks.certificate


@dataclass(frozen=True, slots=True, eq=False)
class BevelContact:
    """The search result of one press: the case, the onset (in driving depth) in the more certain channel, the
    bevel's place, the law.
    """

    press_signal: PressSignal
    onset: Onset | None
    channel: str
    distance_mm: float | None
    distance_given: bool
    law: DepthOfForce


@dataclass(frozen=True, slots=True, eq=False)
class _Frames:
    track: PressTrack
    window: ForceWindow
    time_s: Floats  # (N,) of the frames on the F/T sensor's clock
    force_N: Floats  # (N,) at the frames
    use: Bools


def search_bevel_contacts(
    tracks: Mapping[str, PressTrack | None],
    windows: Mapping[str, ForceWindow | None],
    *,
    offset_s: float,
    before: Mapping[str, BevelContact] | None = None,
    unseen_mm: float = 0.0,
) -> dict[str, BevelContact]:
    """Return the touches of all searchable presses; `before` gives the bevel's place without a search.

    `unseen_mm` (one sigma): common delay of detection, since pictures suppress faint dents.
    """
    groups: dict[tuple[object, ...], dict[str, _Frames]] = {}
    for name, track in tracks.items():
        window = windows[name]
        if track is None or track.footprint is None or window is None or track.indenter.bevel is None:
            continue
        indenter = track.indenter
        key = (indenter.bevel, indenter.bevel_distance_mm, indenter.radius_mm)
        groups.setdefault(key, {})[name] = _frames(track, window, offset_s)
    found: dict[str, BevelContact] = {}
    for group in groups.values():
        place = next((before[name].distance_mm for name in group if name in before), None) if before else None
        found |= _search(group, place)
    return {name: _less_sure(one, unseen_mm) for name, one in found.items()} if unseen_mm else found


def _less_sure(one: BevelContact, shared_mm: float) -> BevelContact:
    """Return the touch with additional std common to all presses."""
    onset = one.onset
    if onset is None:
        return one
    std, shared = (float(np.hypot(part, shared_mm)) for part in (onset.std, onset.shared_std))
    return replace(one, onset=replace(onset, std=std, shared_std=shared))


def _frames(track: PressTrack, window: ForceWindow, offset_s: float) -> _Frames:
    time = track.time_s + offset_s
    force = window.at(time)
    if window.phases is not None:
        release = float(window.time_s[window.phases.release])
    else:
        seen = find_phases(track.depth_mm)
        release = float(time[seen.release if seen is not None else -1])
    return _Frames(track, window, time, force, np.asarray((time <= release) & np.isfinite(force)))


def _search(group: Mapping[str, _Frames], place_mm: float | None) -> dict[str, BevelContact]:
    law = _first_law(group)
    indenter = next(iter(group.values())).track.indenter
    distance = indenter.bevel_distance_mm
    if distance is None:
        distance = place_mm or find_distance([_press_signal(frames, law) for frames in group.values()])
    signals = {name: _press_signal(frames, law) for name, frames in group.items()}
    if distance is None:
        return {
            name: BevelContact(press_signal, None, "height map", None, False, law)
            for name, press_signal in signals.items()
        }
    levels: dict[str, float] = {}
    for _ in range(_MAX_ITERATIONS):
        signals = {name: _press_signal(frames, law, levels.get(name)) for name, frames in group.items()}
        onsets = dict(zip(group, find_bevel_contacts(list(signals.values()), distance), strict=True))
        anchors = [
            (press_signal.track.indenter.height_mm / (1 + PILE_UP), float(law.force(onset.at)))
            for press_signal, onset in zip(signals.values(), onsets.values(), strict=True)
            if onset is not None and onset.gain > DETECTION_CHI2 and press_signal.track.indenter.height_mm
        ]
        levels = {
            name: float(law.force(onset.at))
            for name, onset in onsets.items()
            if onset is not None and onset.gain > DETECTION_CHI2
        }
        used, law = law, depth_of_force(anchors) or law
    given = indenter.bevel_distance_mm is not None
    names = dict.fromkeys(group, "height map")
    pictures = find_in_pictures(list(signals.values()), list(onsets.values()), distance_mm=distance)
    for name, seen in zip(group, pictures, strict=True):
        onset = onsets[name]
        if seen is not None and onset is not None and seen.gain > DETECTION_CHI2:
            onsets[name], names[name] = _combine_channels(onset, seen)
    return {name: BevelContact(signals[name], onsets[name], names[name], distance, given, used) for name in group}


def _combine_channels(height: Onset, picture: Onset) -> tuple[Onset, str]:
    """Return one onset from both channels by their variances; where they contradict, the more certain one."""
    if abs(height.at - picture.at) > 3 * np.hypot(height.std, picture.std):
        sure, name = (height, "height map") if height.gain >= picture.gain else (picture, "picture")
        return replace(height, at=sure.at, std=sure.std, shared_std=sure.shared_std), name
    shared = np.array([height.shared_std, picture.shared_std])
    own = np.sqrt(
        np.maximum(np.array([height.std, picture.std]) ** 2 - [height.shared_std**2, picture.shared_std**2], 0)
    )
    weights = 1 / (own**2 + shared**2)
    weights /= weights.sum()
    # both see one dent: the error by its shape does not average out between them
    together, apart = float(weights @ shared), float(np.linalg.norm(weights * own))
    at = float(weights @ [height.at, picture.at])
    return replace(
        height, at=at, std=float(np.hypot(together, apart)), shared_std=together
    ), "height map and picture"


def _press_signal(frames: _Frames, law: DepthOfForce, level_N: float | None = None) -> PressSignal:
    """Return a press as driven by its force; beyond the force of a known touch, by its ramp's pace."""
    depth = law.depth(frames.force_N) if level_N is None else _at_pace(frames, law, level_N)
    return PressSignal(frames.track, depth, frames.use)


def _at_pace(frames: _Frames, law: DepthOfForce, level_N: float) -> Floats:
    """Return depth (N,) by the force, and beyond the touch at the pace of the approach.

    The bevel carries part of the force from there on, which would read as depth. By the force throughout where
    the rig's pace was not even.
    """
    depth, window = law.depth(frames.force_N), frames.window
    touch_mm = float(law.depth(np.array(level_N)))
    crossed = force_crossing(window, level_N, level_std_N=0.0)
    begun = None if crossed is None else contact_point(window, crossed.time_s)
    if crossed is None or begun is None:
        return depth
    pace = touch_mm / (crossed.time_s - begun.time_s)
    way = (window.time_s > begun.time_s) & (window.time_s < crossed.time_s)
    uneven = law.depth(window.drive_N[way]) - pace * (window.time_s[way] - begun.time_s)
    if float(np.median(np.abs(uneven))) > _MAX_UNEVEN * touch_mm:
        return depth
    beyond = touch_mm + pace * moving_s(window, crossed.time_s, time_s=frames.time_s)
    return np.where(frames.time_s > crossed.time_s, beyond, depth)


def _first_law(group: Mapping[str, _Frames]) -> DepthOfForce:
    """Return a straight line fitted to the depths that the camera reads."""
    ratios = []
    for frames in group.values():
        deep = frames.use & (frames.track.depth_mm > 0.5 * np.nanmax(frames.track.depth_mm))
        ratio = frames.force_N[deep] / frames.track.depth_mm[deep]
        ratios += [float(r) for r in ratio if np.isfinite(r) and r > 0]
    return DepthOfForce(float(np.median(ratios)) if ratios else 1.0, 0.0)
