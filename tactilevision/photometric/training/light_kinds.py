"""How the lamps, gel and camera of a kind of sensor are drawn for training: one record a kind.

Azimuths count from x to the picture's top, and are those of the lamps; what leaks into another colour turns it.
GelSlim 3.0 and GelSight Mini: the light of one real sensor each is at the centre, as lamps that were fitted to
what 10 and 49 balls look like there; Minis' stand above, right and below, as long bars. DIGIT: three lamps about
the gel, as facebookresearch/tacto states in its config_digit.yml (30, 150 and 270 degrees), turned and bounded as
14 balls of one real sensor ask; each shines across the gel, and they are spread wide, as no two sensors are alike.
Which real frames did not choose these numbers stands on the networks' cards.
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
    astray_deg: float  # one sigma by which lamps stand off these azimuths; cut at two
    nearest_mm: Triple  # a lamp from the middle
    farthest_mm: Triple
    lowest_deg: Triple  # elevation of a lamp
    highest_deg: Triple
    half_length_mm: float  # of a strip of lamps, at most
    aim_mm: Pair  # where a beam meets the gel, from the middle towards its lamp
    beam_mm: Pair  # one sigma of a beam
    leak: Pair  # share of a lamp that other colours see
    green_in_blue: Pair
    blue_in_green: Pair
    thrown_back: float  # by the wall opposite, of a lamp's light, at most
    stray: float  # of white, at most
    bulge: float  # slope of the untouched gel at the border, at most
    soft_edge: Pair = (0.01, 0.08)  # of attached shadows
    gamma: Pair = (1.0, 2.0)  # of the camera
    upright_mm: Pair = (1.0, 4.0)  # height of a lamp: a taller one has wider penumbrae


LIGHT_KINDS = {
    "gelslim3": LightKind(
        size_mm=(27.1, 20.3),
        azimuth_deg=(-54.0, 179.0, 60.0),
        astray_deg=6.0,
        nearest_mm=(20.0, 38.0, 32.0),
        farthest_mm=(30.0, 70.0, 60.0),
        lowest_deg=(6.0, 11.0, 22.0),
        highest_deg=(10.0, 19.0, 34.0),
        half_length_mm=5.0,
        aim_mm=(-9.0, 0.0),
        beam_mm=(9.0, 16.0),
        leak=(0.0, 0.05),
        green_in_blue=(0.0, 0.1),
        blue_in_green=(0.1, 0.25),
        thrown_back=0.1,
        stray=0.02,
        bulge=0.05,
        soft_edge=(0.005, 0.02),
        gamma=(1.5, 2.4),
    ),
    "gelsight_mini": LightKind(
        size_mm=(20.3, 15.2),
        azimuth_deg=(97.0, -1.0, -97.0),
        astray_deg=6.0,
        nearest_mm=(50.0, 45.0, 45.0),
        farthest_mm=(80.0, 80.0, 80.0),
        lowest_deg=(9.0, 10.0, 11.0),
        highest_deg=(16.0, 18.0, 22.0),
        half_length_mm=8.0,
        aim_mm=(-9.0, 1.0),
        beam_mm=(4.0, 8.0),
        leak=(0.0, 0.08),
        green_in_blue=(0.2, 0.5),
        blue_in_green=(0.05, 0.15),
        thrown_back=0.25,
        stray=0.1,
        bulge=0.1,
        soft_edge=(0.05, 0.1),
        gamma=(1.3, 2.1),
    ),
    "digit": LightKind(
        size_mm=(15.4, 19.2),
        azimuth_deg=(45.0, 152.0, -76.0),
        astray_deg=12.0,
        nearest_mm=(18.0, 18.0, 18.0),
        farthest_mm=(40.0, 40.0, 40.0),
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
    ),
}
