"""Alike balls whose radius is stated wrong are named by what a usual light of their sensor reads."""

from __future__ import annotations

import numpy as np
from each import each

from tactilevision.heightmap.ball_validation import (
    UsualReading,
    odd_by_usual_light,
    read_balls,
    usual_scale_warnings,
)
from tactilevision.photometric.ball_detection import Ball, ball_slopes
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bytes

BALL_MM, CONTACT_PX, SCALE = 3.8, 20.0, (0.06, 0.06)
CENTRES = [(40.0, 50.0), (70.0, 60.0), (55.0, 35.0)]


class Usual:
    """Reads every picture as a ball of BALL_MM at the place that its first pixels tell.

    `turn_deg` turns the slopes: another light.
    """

    name = "usual"

    def __init__(self, turn_deg: float) -> None:
        self.turn = np.exp(1j * np.radians(turn_deg))

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
        y, x = np.indices(rgb_rectified.shape[:2], dtype=float)
        x, y = ((a - float(b)) * SCALE[0] for a, b in zip((x, y), rgb_rectified[0, :2, 0], strict=True))
        p, q = ball_slopes(x, y, contact_mm=CONTACT_PX * SCALE[0], radius_mm=BALL_MM)
        turned = self.turn * (p + 1j * q)
        return SlopeMap(turned.real, turned.imag, np.ones(p.shape, bool))


@each(
    "stated_mm, turn_deg, grey, said",
    [
        (BALL_MM, 0.0, 90, ""),
        (1.3 * BALL_MM, 0.0, 90, ""),
        (2 * BALL_MM, 0.0, 90, "2 times the stated"),
        (2 * BALL_MM, 35.0, 20, "1.7 times the stated"),
        (2 * BALL_MM, 180.0, 90, ""),
        (BALL_MM / 1.5, 0.0, 90, ""),
        (BALL_MM / 2, 0.0, 90, "stated ones: is ball_radius_mm stated too small"),
        (BALL_MM / 2, 35.0, 90, ""),
        (BALL_MM / 2, 0.0, 20, ""),
    ],
)
def test_a_wrong_radius_of_alike_balls_is_named(stated_mm: float, turn_deg: float, grey: int, said: str) -> None:
    pictures = []
    for centre in CENTRES:
        rgb = np.full((100, 110, 3), grey, np.uint8)
        rgb[0, :2, 0] = centre
        pictures.append(rgb)
    balls = [Ball(centre, CONTACT_PX, stated_mm) for centre in CENTRES]
    read = read_balls(Usual(turn_deg), [*pictures, pictures[0]], balls=[*balls, None], mm_per_px=SCALE)
    assert [*read] == [0, 1, 2]
    warned = usual_scale_warnings([*read.values()], kind="gelslim3")
    assert len(warned) == bool(said)
    assert all(said in one and "ball_radius_mm" in one for one in warned)


def test_pictures_without_a_ball_are_told_nothing() -> None:
    picture = np.zeros((100, 110, 3), np.uint8)
    assert read_balls(Usual(0.0), [picture], balls=[None], mm_per_px=SCALE) == {}
    assert usual_scale_warnings([], kind="gelslim3") == ()
    assert odd_by_usual_light({}, names=[], kind="gelslim3") == ()


SOUND = (1.06, 1.19, 0.99, 1.14, 0.95, 1.08, 1.02, 1.14, 1.05, 1.07)  # scales of ten real balls, set D


@each("number, times, named", [(0, 1.0, ""), (3, 1.5, "d:"), (8, 1 / 1.5, "i:"), (8, 1.2, ""), (4, 2.0, "e:")])
def test_one_ball_of_ten_of_another_radius_is_named(number: int, times: float, named: str) -> None:
    gains = [gain * (times if k == number else 1.0) for k, gain in enumerate(SOUND)]
    read = {k: UsualReading(gain, 0.95, 90.0) for k, gain in enumerate(gains)}
    said = odd_by_usual_light(read, names=[*"abcdefghij"], kind="gelslim3")
    assert [one[:2] for one in said] == ([named] if named else [])
    few = {k: read[k] for k in [*read][-5:]}
    assert odd_by_usual_light(few, names=[*"abcdefghij"], kind="gelslim3") == (), "five do not tell their scatter"


def test_a_ball_whose_directions_differ_is_not_judged_by_its_scale() -> None:
    read = {k: UsualReading(gain, 0.95, 90.0) for k, gain in enumerate(SOUND)}
    read[2] = UsualReading(0.2, 0.85, 90.0)
    assert odd_by_usual_light(read, names=[*"abcdefghij"], kind="gelslim3") == ()


def test_no_ball_is_judged_by_a_light_that_is_another() -> None:
    read = {k: UsualReading(gain, 0.9, 90.0) for k, gain in enumerate(SOUND)}
    read[2] = UsualReading(0.5, 0.9, 90.0)
    assert odd_by_usual_light(read, names=[*"abcdefghij"], kind="gelslim3") == ()
