"""Presses that are no measurements of their own, and times in another unit.

A press whose samples are all those of another one, but for its times, was copied: in a table, or from another
recording. Two presses differ by their noise. As a repeat it would claim that presses scatter less than they do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibration.inputs.observations import Observations
from tactilevision.errors import InputError
from tactilevision.recording.names import some
from tactilevision.records import Floats

MIN_SAMPLES = 5  # of a press: fewer may be equal by rounding
SLOWEST_MM_S = 5e-4  # mm/s: motion stages press a hundred times as fast, and motors stick below
NEARLY_IN = 0.9  # of the largest depth: the rest may be a hold, which noise makes deeper at its end
WHOLE_WAY = 0.5  # of the largest depth: presses begin in air, so that the way in is longer
OFF = (100.0, 10000.0)  # times: a stated speed over the one that depths show, where times are in ms


def without_copies(data: Observations) -> Observations:
    """Curves without presses that are copies of earlier ones; a warning names each.

    A point that equals an earlier one stays, since rounded numbers may agree: a warning names it.
    """
    if not data.is_curves:
        return _with_equal_points_named(data)
    first: dict[bytes, int] = {}
    keep, said = np.ones(data.count, bool), []
    for k, (start, end) in enumerate(_spans(data)):
        if end - start < MIN_SAMPLES:
            continue
        samples = np.column_stack([data.depth_mm[start:end], data.normal_N[start:end]]).tobytes()
        if samples in first:
            keep[k] = False
            said.append(
                f"press {_named(data, k)} has the samples of press {_named(data, first[samples])}: left out"
            )
        first.setdefault(samples, k)
    return data if keep.all() else replace(data.take(keep), warnings=(*data.warnings, *said))


def _with_equal_points_named(data: Observations) -> Observations:
    first: dict[tuple[float, ...], int] = {}
    said = []
    numbers = np.column_stack([data.presses.radius_mm[data.press], data.depth_mm, data.normal_N]).tolist()
    for k, point in zip(data.press.tolist(), numbers, strict=True):
        earlier = first.setdefault(tuple(point), k)
        if earlier != k:
            said.append(f"{_named(data, k)} of {_named(data, earlier)}")
    if not said:
        return data
    warning = f"presses with the very depth and force of another, copies if not rounded alike: {some(said)}"
    return replace(data, warnings=(*data.warnings, warning))


def check_times(data: Observations) -> None:
    """Raise InputError where depths grow so slowly that times are in ms: beside the stated speed, or by far."""
    if not data.is_curves:
        return
    seen, stated = (_median(column) for column in np.reshape(list(_speeds(data)), (-1, 2)).T)
    if OFF[0] < stated / seen < OFF[1] or seen < SLOWEST_MM_S:
        raise InputError(
            "presses go deeper too slowly for times in seconds",
            where="time_s",
            value=f"{1e3 * seen:.2g} um/s",
            remedy="Times are in s: are these in ms? Divide them by 1000.",
        )


def _speeds(data: Observations) -> Iterator[tuple[float, float]]:
    """Of each press how fast its depth grows until it is nearly in, and the speed that is stated.

    A press that is caught deeper than half way in has no such speed: a clock may have cut the way short.
    """
    for k, (start, end) in enumerate(_spans(data)):
        depth, deepest = data.depth_mm[start:end], float(np.max(data.depth_mm[start:end]))
        top = int(np.argmax(depth >= NEARLY_IN * deepest))
        time, way = data.time_s[start + top] - data.time_s[start], depth[top] - depth[0]
        if time > 0 and way > WHOLE_WAY * max(deepest, 0.0):
            yield float(way / time), float(data.presses.speed_mm_s[k])


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else np.nan


def _spans(data: Observations) -> Iterator[tuple[int, int]]:
    return zip(data.first.tolist(), [*data.first[1:].tolist(), data.size], strict=True)


def _named(data: Observations, press: int) -> str:
    label, number = data.presses.label[press], int(data.presses.recording[press])
    return label if len(data.recordings) == 1 else f"{label} of {data.recordings[number]}"
