"""Presses that share a bevel and a punch radius, searched for their touches together.

The driving depth is read from the force; its law w(P) is anchored to the machined heights by the touches
themselves, so search and law are found in turns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tactilevision.certificate.force.contact_point import contact_point, moving_s
from tactilevision.certificate.force.phases import find_phases
from tactilevision.certificate.force.window import ForceWindow
from tactilevision.certificate.touch.bevel_contact_depth import (
    DETECTION_CHI2,
    PILE_UP,
    DepthOfForce,
    PressSignal,
    depth_of_force,
    find_bevel_contacts,
    find_distance,
    find_in_pictures,
)
from tactilevision.certificate.touch.force_crossing import force_crossing
from tactilevision.certificate.touch.press_track import PressTrack
from tactilevision.contact.bevel_onset import Onset
from tactilevision.records import Bools, Floats

_MAX_ITERATIONS = 3  # of search and law, which know each other; benchmarks.certificate
_MAX_UNEVEN = 0.02  # of the depth: a ramp less even does not tell how it goes on; benchmarks.certificate


@dataclass(frozen=True, slots=True, eq=False)
class BevelContact:
    """What the search found for one press: the case, the onset (in driving depth) in the more certain channel, the
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
    """The touches of all presses that can be searched; `before` spares a search for the place of the bevel.

    `unseen_mm` (one sigma): by how much all are seen late together, since the pictures swallow faint dents.
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
    """The touch with a part more of std that all presses share."""
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
    """One onset from both channels by their variances; where they contradict each other, the surer one."""
    if abs(height.at - picture.at) > 3 * np.hypot(height.std, picture.std):
        sure, name = (height, "height map") if height.gain >= picture.gain else (picture, "picture")
        return replace(height, at=sure.at, std=sure.std, shared_std=sure.shared_std), name
    shared = np.array([height.shared_std, picture.shared_std])
    own = np.sqrt(
        np.maximum(np.array([height.std, picture.std]) ** 2 - [height.shared_std**2, picture.shared_std**2], 0)
    )
    weights = 1 / (own**2 + shared**2)
    weights /= weights.sum()
    # both see one dent: what its shape leaves open does not average out between them
    together, apart = float(weights @ shared), float(np.linalg.norm(weights * own))
    at = float(weights @ [height.at, picture.at])
    return replace(
        height, at=at, std=float(np.hypot(together, apart)), shared_std=together
    ), "height map and picture"


def _press_signal(frames: _Frames, law: DepthOfForce, level_N: float | None = None) -> PressSignal:
    """A press as driven by its force; beyond the force of a touch that is known already, by its ramp's pace."""
    depth = law.depth(frames.force_N) if level_N is None else _at_pace(frames, law, level_N)
    return PressSignal(frames.track, depth, frames.use)


def _at_pace(frames: _Frames, law: DepthOfForce, level_N: float) -> Floats:
    """Depth (N,) by the force, and beyond the touch at the pace of the way up to it.

    The bevel carries part of the force from there on, which would pass for depth. By the force throughout where
    the rig did not come at one pace.
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
    """Straight line from the depths that the camera reads."""
    ratios = []
    for frames in group.values():
        deep = frames.use & (frames.track.depth_mm > 0.5 * np.nanmax(frames.track.depth_mm))
        ratio = frames.force_N[deep] / frames.track.depth_mm[deep]
        ratios += [float(r) for r in ratio if np.isfinite(r) and r > 0]
    return DepthOfForce(float(np.median(ratios)) if ratios else 1.0, 0.0)
