"""Presses by name, and measurements without some of them: what a person judges to be an accident."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from calibration.inputs.observations import Observations
from tactilevision.errors import InputError


def press_names(data: Observations) -> tuple[str, ...]:
    """One name a press: its label, with the recording's name before it where the label comes twice.

    Of recordings of one name the later ones have their number behind it.
    """
    labels, numbers = data.presses.label, data.presses.recording
    twice = {label for label, count in Counter(labels).items() if count > 1}
    folders = [
        name if name not in data.recordings[:k] else f"{name} {k + 1}" for k, name in enumerate(data.recordings)
    ]
    return tuple(
        f"{folders[int(k)]}/{label}" if label in twice else label for label, k in zip(labels, numbers, strict=True)
    )


def leave_out(data: Observations, presses: Sequence[str]) -> Observations:
    """The measurements without these presses. Raises InputError for a press that is not there, and for all."""
    names = press_names(data)
    unknown = [press for press in presses if press not in names]
    if unknown:
        raise InputError(
            "there is no such press to leave out",
            where="--leave-out",
            value=unknown[0],
            remedy=f"There are {', '.join(names[:12])}{' ...' if len(names) > 12 else ''}.",
        )
    kept = np.array([name not in presses for name in names])
    if not kept.any():
        raise InputError("no press is left", where="--leave-out", remedy="Keep some.")
    return data if kept.all() else data.take(kept)
