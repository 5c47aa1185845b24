"""The touches of the sound presses put on their ramps' ruler, and the force read there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tactilevision.press.event import event_force
from tactilevision.press.ramp import FirstContact, first_contact
from tactilevision.press.rise import Rise
from tactilevision.press.ruler import Mark, Ruler, fit_ruler
from tactilevision.press.timed import Chain, Timed
from tactilevision.press.touch import SURE, fill_mm
from tactilevision.records import Indenter


def on_ruler(
    chain: Chain, timed: Mapping[str, Timed], rises: Mapping[str, Rise], sound: Sequence[str]
) -> dict[str, Timed]:
    """`timed` with the touches of the `sound` presses where the ruler of their bevel puts them.

    As they were: presses that stopped at the touch, whose pace is not known, or whose bevel's ruler does not fit.
    """
    ruled = dict(timed)
    groups: dict[tuple[object, ...], dict[str, tuple[Timed, FirstContact]]] = {}
    for name in sound:
        begun = _begun(chain, timed.get(name))
        if begun is not None:
            indenter = timed[name].touched.case.watch.indenter
            key = indenter.bevel, timed[name].touched.distance_mm, indenter.radius_mm
            groups.setdefault(key, {})[name] = timed[name], begun
    for group in groups.values():
        pace = _paces(chain, list(group))
        marks = {name: _mark(chain, *found, pace_mm_s=pace[name], rise=rises[name])
                 for name, found in group.items() if np.isfinite(pace[name])}  # fmt: skip
        ruler = fit_ruler(list(marks.values()))
        if ruler is None:
            continue
        for (name, mark), use in zip(marks.items(), ruler.used, strict=True):
            if use:
                one, begun = group[name]
                after_s = ruler.travel_mm(mark.depth_mm, mark.force_N) / pace[name]
                ruled[name] = _moved(chain, one, ruler, FirstContact(begun.time_s + after_s, begun.std_s))
    return ruled


def _begun(chain: Chain, one: Timed | None) -> FirstContact | None:
    """First contact of a press that came to a sure touch without a stop."""
    if one is None or one.touch is None or one.event is None or one.crossed is None or one.event.dwell:
        return None
    watch = one.touched.case.watch
    window = chain.windows[watch.press.press]
    if one.touch.onset.gain <= SURE or one.touched.distance_mm is None or not watch.indenter.height_mm:
        return None
    return None if window is None else first_contact(window, one.crossed.time_s)


def _paces(chain: Chain, names: Sequence[str]) -> dict[str, float]:
    """Stated speeds; 1 for all where none is stated, which asks for presses that come alike."""
    stated = {press.press: press.speed_mm_s for press in chain.recording.presses if press.press in names}
    if not any(np.isfinite(speed) for speed in stated.values()):
        return dict.fromkeys(stated, 1.0)
    return stated


def _mark(chain: Chain, one: Timed, begun: FirstContact, *, pace_mm_s: float, rise: Rise) -> Mark:
    assert one.crossed is not None
    assert one.touch is not None
    assert one.event is not None
    indenter, onset = one.touched.case.watch.indenter, one.touch.onset
    travel = pace_mm_s * (one.crossed.time_s - begun.time_s)
    scale = travel / onset.at
    own = scale**2 * max(onset.std**2 - onset.shared_std**2, 0.0) + (pace_mm_s * begun.std_s) ** 2
    # an edge that was found lies anywhere in its window: seen beyond it, the touch comes by the bevel's fall later
    shape = 0.0 if one.touched.distance_given else 0.5 * fill_mm(indenter)
    shared = scale**2 * (onset.shared_std**2 + shape**2) + (pace_mm_s * (chain.offset.std or 0.0)) ** 2
    return Mark(
        depth_mm=_height(indenter) / (1 + rise.ratio), travel_mm=travel, own_std_mm=float(np.sqrt(own)),
        shared_std_mm=float(np.sqrt(shared)), force_N=float(one.event.force_N[2]), height=indenter.name,
        height_std_mm=indenter.height_std_mm / (1 + rise.ratio),
    )  # fmt: skip


def _height(indenter: Indenter) -> float:
    assert indenter.height_mm is not None
    return indenter.height_mm


def _moved(chain: Chain, one: Timed, ruler: Ruler, at: FirstContact) -> Timed:
    """The press with its touch at another time (F/T clock), and the force read there."""
    assert one.crossed is not None
    assert one.touch is not None
    watch = one.touched.case.watch
    window = chain.windows[watch.press.press]
    assert window is not None
    crossed = replace(one.crossed, time_s=at.time_s, std_s=at.std_s)
    event = event_force(window, chain.forces, crossed)
    if event is None:
        return one
    time_s = at.time_s - chain.offset_s
    touch = replace(
        one.touch, time_s=time_s, std_s=float(np.hypot(at.std_s, chain.offset.std or 0.0)),
        depth_seen_mm=float(np.interp(time_s, watch.time_s, watch.depth_mm)),
    )  # fmt: skip
    return replace(one, crossed=crossed, touch=touch, event=event, ruler=ruler)
