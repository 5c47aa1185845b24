"""Gel that rose beside a contact in the reference is none; a dent with a larger share of the hill is one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from each import each

from tactilevision.errors import InputError
from tactilevision.heightmap.reference_match import pressed_beside
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Bytes

SIZE = (16, 20)  # blocks (h, w), here pixels
PICTURE: Bytes = np.zeros((*SIZE, 3), np.uint8)
HILL, BESIDE, ELSEWHERE, FEW = np.s_[3:7, 3:7], np.s_[3:7, 7:10], np.s_[10:14, 12:16], np.s_[10:12, 12:14]


def method(changed: np.ndarray) -> Any:
    tracker = SimpleNamespace(
        size=SIZE[::-1],
        measure=lambda picture: SimpleNamespace(untouched=~changed),
        usable=np.ones(SIZE, bool).ravel(),
    )
    return SimpleNamespace(change=SimpleNamespace(tracker=tracker))


@each(
    "where, dent, pressed",
    [
        (BESIDE, 0.3, False),
        (BESIDE, 0.5, True),
        (ELSEWHERE, 0.3, True),
        (ELSEWHERE, 0.05, False),
        (FEW, 0.3, False),
    ],
)
def test_a_dent_is_held_against_the_hill_of_its_patch(
    where: tuple[slice, slice], dent: float, pressed: bool
) -> None:
    depth, changed = np.zeros(SIZE), np.zeros(SIZE, bool)
    depth[HILL], depth[where] = -1.0, dent
    changed[HILL] = changed[where] = True
    height = HeightMap(depth, np.ones(SIZE, bool), (1.0, 1.0), std_mm=np.full(SIZE, 0.02))
    assert pressed_beside(method(changed), lambda picture: height, picture=PICTURE) == pressed


def test_a_picture_that_cannot_be_read_counts_as_pressed() -> None:
    def refuse(picture: Bytes) -> HeightMap:
        raise InputError("no", where="", value="", remedy="")

    assert pressed_beside(method(np.zeros(SIZE, bool)), refuse, picture=PICTURE)
