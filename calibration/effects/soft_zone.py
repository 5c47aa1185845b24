"""A part of the pad that is softer: debonded, or above a bubble.

    P -> P [1 - s/(1 + exp(-(x cos u + y sin u - d)/(a/4)))]

The zone lies beyond a straight edge at the distance d from the origin of the places, in the direction u; a punch
of radius a is half over it at the edge. Range: s up to .6; vanishes at s = 0. E is that of the stiffer part, also
where that is a stiff inclusion. The fit begins at several directions and at edges between presses, and the number
of these counts as parameters do (`searched`). Source: definition.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State, amplitude
from tactilevision.records.measured import Floats

DIRECTIONS = 8  # of the edge at which the fits begin
EDGES = 6  # places of the edge in each direction, at most
LEAST = 2  # presses on either side of an edge


class SoftZone(EffectBase):
    """Share that is lost, and distance and direction of the edge."""

    key = "soft_zone"
    title = "a part of the pad is softer: debonded, or above a bubble"
    stage = Stage.GEOMETRY
    seen_in = ("x", "y", "azimuth")
    confused_with = ("lateral_boundary", "thickness_wedge")
    separated_by = ("presses on either side of the edge", "a look at the pad against the light")
    source = "definition"
    order = 105
    searched = DIRECTIONS * EDGES
    check = ManualCheck("look at the pad against the light there, and press again on both sides of the edge", 5)
    parameters = (
        Parameter("softer", "1", 0.0, (0, 0.6), "share of the stiffness that is lost in the zone", 0.1),
        amplitude("edge_mm", "mm", 100, "distance of the zone's edge from the origin", 1),
        amplitude("direction_rad", "rad", 7, "direction in which the zone lies, from the x axis", 0.3),
    )

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        placed = np.isfinite(data.presses.x_mm) & np.isfinite(data.presses.y_mm)
        return "" if placed.all() and len(self.starts(data)) else "needs presses at four places or more"

    def starts(self, data: Observations) -> Floats:
        """Return starts with edges between presses, in all directions in which places differ."""
        table = []
        for direction in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS - np.pi:
            places = np.sort(_along(data.presses.x_mm, data.presses.y_mm, direction))
            middle = (places[1:] + places[:-1]) / 2
            apart = np.flatnonzero(np.diff(places) > np.min(data.presses.radius_mm) / 2)
            kept = apart[(apart >= places.size // 3) & (apart < places.size - LEAST)]
            table += [[0.1, middle[k], direction] for k in _few(kept)]
        return np.array(table).reshape(-1, 3)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the stiffness of the zone."""
        from scipy.special import expit

        beyond = _along(data.presses.x_mm, data.presses.y_mm, values[2])[data.press] - values[1]
        return state.times(factor=1 - values[0] * expit(beyond / (data.radius_mm / 4)))


def _along(x_mm: Floats, y_mm: Floats, direction_rad: float) -> Floats:
    along: Floats = np.cos(direction_rad) * x_mm + np.sin(direction_rad) * y_mm
    return along


def _few(places: np.ndarray[tuple[int], np.dtype[np.int64]]) -> list[int]:
    """Return at most EDGES of the places, evenly spread."""
    chosen = np.linspace(0, places.size - 1, min(places.size, EDGES)).round().astype(int)
    return [int(k) for k in places[chosen]]
