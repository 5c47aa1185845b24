"""How a camera answers to light and its picture to slope: what drift is told from contact with.

Lamps add up in light, not in grey levels: cameras write either the light itself (power 1) or about its root (power
2: sRGB and video, 1.8 to 2.4). Balls tell which (`gamma.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactilevision.records import Floats

DEFAULT_POWER = 2  # of a grey level, which is light: sRGB and video write about its root
SOFTENING_GREY = 20.0  # added to brightness where a change of it is divided by it (`colour_change.py`)
LINEAR_TERMS = np.array([(a, 1 - a, i, n - i) for a in range(2) for n in range(3) for i in range(n + 1)])


@dataclass(frozen=True, slots=True)
class Response:
    """`power` of the grey level that is light, 1 or 2.

    `answers` (12, 3): colour change of the channels to gentle slopes, by the terms LINEAR_TERMS, powers of slope
    in x and y and of place; None where no ball has told it.
    """

    power: int = DEFAULT_POWER
    answers: Floats | None = None

    def to_slope(self, x: Floats, y: Floats) -> Floats | None:
        """Colour changes (3, 2, N) for a unit of slope in x and in y, at places x, y (N,) from -1 to 1."""
        if self.answers is None:
            return None
        changes = np.zeros((3, 2, len(x)))
        for (along_x, _, i, j), row in zip(LINEAR_TERMS, self.answers, strict=True):
            changes[:, 1 - along_x] += row[:, None] * (x**i * y**j)
        return changes

    def to_card(self) -> dict[str, Any]:
        """The entry of a card."""
        answers = None if self.answers is None else np.round(self.answers, 5).tolist()
        return {"power": self.power, "answers": answers}


def response_from_card(entry: Mapping[str, Any] | None) -> Response:
    """The response of the card's `entry` (power, answers); that of most cameras for None."""
    if entry is None:
        return Response()
    answers = entry["answers"]
    return Response(int(entry["power"]), None if answers is None else np.array(answers, np.float64))
