"""Pile-up at the bevel's edge for every press: seen in all presses of its bevel, computed for its own depth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tactilevision.certificate.depth.pile_up import (
    PileUp,
    blur_place,
    combine,
    computed_ratio,
    map_error,
    press_pile_up,
    seen_ratio,
    unknown_pile_up,
)
from tactilevision.certificate.touch.bevel_contact_depth import DETECTION_CHI2
from tactilevision.certificate.touch.contact_times import ContactTimes
from tactilevision.contact.bevel import mean_distance_mm
from tactilevision.records import Floats, Gel, Pair

_MAX_GROWTH = 1.25  # of the rise over the depth, between depths up to a quarter of the gel; mechanics.touch
UNKNOWN_SCALE_STD = 0.25  # relative std of the map's scale where no event tells it


def press_pile_ups(events: Mapping[str, ContactTimes], gel: Gel | None) -> dict[str, PileUp]:
    """Pile-up of each press that was searched, by label.

    The rise over the depth changes with the depth. Beside a punch of 2.5 mm with its bevel at 5 mm on 3 mm of gel
    it grows by 8 to 9 % of itself from .15 to .6 mm; elsewhere by less, or it falls. What presses of one radius
    show together is carried to the depth of each by the computed ratio.
    """
    computed = {name: _computed(one, gel) for name, one in events.items()}
    seen, scale_std, map_std = _seen(events)
    pile_ups = {}
    for name, one in events.items():
        distance, indenter = one.bevel_contact.distance_mm, one.bevel_contact.press_signal.track.indenter
        if distance is None or not indenter.height_mm:
            pile_ups[name] = unknown_pile_up()
            continue
        at_depth = [
            (ratio * _growth(computed[name], computed[other]), std)
            for other, (ratio, std) in seen.get((distance, indenter.radius_mm), {}).items()
        ]
        pile_up = combine(seen_ratio(at_depth, scale_std=scale_std, map_std=map_std), computed[name])
        given, beside = one.bevel_contact.distance_given, mean_distance_mm(distance)
        pile_ups[name] = pile_up if given else blur_place(pile_up, gel, indenter=indenter, distance_mm=beside)
    return pile_ups


def _computed(one: ContactTimes, gel: Gel | None) -> Pair | None:
    """The computed rise over the depth of a press and its std; None where the gel or the bevel is not known."""
    distance = one.bevel_contact.distance_mm
    if distance is None:
        return None
    indenter = one.bevel_contact.press_signal.track.indenter
    return computed_ratio(gel, indenter, distance_mm=mean_distance_mm(distance))


def _growth(here: Pair | None, there: Pair | None) -> float:
    """The rise over the depth of one press over another's, as computed; 1 where that is not known.

    A ratio beyond _MAX_GROWTH is of two models, or lies near the place where the gel neither rises nor sinks: it
    tells nothing, and 1 is taken.
    """
    if here is None or there is None or there[0] == 0:
        return 1.0
    growth = here[0] / there[0]
    return growth if 1 / _MAX_GROWTH <= growth <= _MAX_GROWTH else 1.0


def _seen(
    events: Mapping[str, ContactTimes],
) -> tuple[dict[Pair, dict[str, tuple[Floats, Floats]]], float, float]:
    """Ratios (4,) and stds (4,) of single presses by the bevel's distance and the punch's radius (mm) and by
    label, std of the scale, error of the map.
    """
    ratios: dict[Pair, dict[str, tuple[Floats, Floats]]] = {}
    scales, errors = [], []
    for name, one in events.items():
        distance, press_signal = one.bevel_contact.distance_mm, one.bevel_contact.press_signal
        if one.touch is None or one.touch.onset.gain <= DETECTION_CHI2 or distance is None:
            continue
        indenter = press_signal.track.indenter
        scales += [one.touch.depth_seen_mm / indenter.height_mm] if indenter.height_mm else []
        beside = mean_distance_mm(distance)
        before = press_signal.use & (press_signal.drive < one.touch.onset.at)
        single = press_pile_up(press_signal.track, press_signal.drive, before=before, distance_mm=beside)
        if single is not None:
            ratios.setdefault((distance, indenter.radius_mm), {})[name] = single
            errors.append(map_error(press_signal.track, press_signal.drive, distance_mm=beside))
    scale_std = float(np.sqrt(np.mean((np.array(scales) - 1) ** 2))) if scales else UNKNOWN_SCALE_STD
    known = [error for error in errors if np.isfinite(error)]
    return ratios, scale_std, float(np.median(known)) if known else 0.0
