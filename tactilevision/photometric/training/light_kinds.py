"""How the lamps, gel and camera of a kind of sensor are drawn for training: one record a kind.

Azimuths count from x to the picture's top, and are those of the lamps; what leaks into another colour turns it.
GelSlim 3.0: one real sensor at its centre. GelSight Mini: one real sensor, 49 balls over its picture; lamps stand
above, right and below, as long bars. DIGIT: three lamps about the gel, as facebookresearch/tacto states in its
config_digit.yml (30, 150 and 270 degrees), turned and bounded as 14 balls of one real sensor ask; each shines
across the gel. Which real frames did not choose these numbers stands on the networks' cards.
"""

from __future__ import annotations

from dataclasses import dataclass

from tactilevision.records import Pair

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class LightKind:
    """Bounds of uniform draws; triples are of the red, green and blue lamp."""

    size_mm: Pair  # what the picture shows
    azimuth_deg: Triple
    far_mm: Pair = (20.0, 60.0)  # a lamp from the middle
    lowest_deg: Triple = (6.0, 7.0, 9.0)  # elevation of a lamp
    highest_deg: Triple = (22.0, 27.0, 33.0)
    half_length_mm: float = 5.0  # of a strip of lamps, at most
    aim_mm: Pair = (0.0, 10.0)  # where a beam meets the gel, from the middle towards its lamp
    beam_mm: Pair = (8.0, 20.0)  # one sigma of a beam
    leak: Pair = (0.0, 0.08)  # share of a lamp that other colours see
    green_in_blue: Pair = (0.2, 0.7)
    blue_in_green: Pair = (0.0, 0.3)
    thrown_back: float = 0.5  # by the wall opposite, of a lamp's light, at most
    stray: float = 0.04  # of white, at most
    bulge: float = 0.0  # slope of the untouched gel at the border, at most
    shaded: float = 0.0  # share of pressed samples from which a lamp is kept, in part or whole


LIGHT_KINDS = {
    "gelslim3": LightKind(size_mm=(27.1, 20.3), azimuth_deg=(-55.0, 180.0, 42.0)),
    "gelsight_mini": LightKind(
        size_mm=(20.3, 15.2),
        azimuth_deg=(98.0, -2.0, -82.0),
        far_mm=(25.0, 70.0),
        lowest_deg=(8.0, 8.0, 8.0),
        highest_deg=(30.0, 30.0, 30.0),
        half_length_mm=14.0,
        aim_mm=(-8.0, 2.0),
        beam_mm=(6.0, 15.0),
        leak=(0.0, 0.12),
        green_in_blue=(0.0, 0.3),
        thrown_back=0.4,
        stray=0.15,
        bulge=0.1,
        shaded=0.05,
    ),
    "digit": LightKind(
        size_mm=(15.4, 19.2),
        azimuth_deg=(45.0, 152.0, -76.0),
        far_mm=(18.0, 40.0),
        lowest_deg=(10.0, 10.0, 10.0),
        highest_deg=(30.0, 30.0, 30.0),
        half_length_mm=2.0,
        aim_mm=(-10.0, 0.0),
        beam_mm=(5.0, 10.0),
        leak=(0.05, 0.25),
        green_in_blue=(0.05, 0.25),
        blue_in_green=(0.05, 0.25),
        thrown_back=0.3,
        stray=0.1,
        bulge=0.15,
        shaded=0.05,
    ),
}
