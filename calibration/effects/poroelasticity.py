"""Poroelastic drainage under a flat punch: liquid leaves the gel in a time that goes as the radius squared.

    P(t) = Int G((t - s)/a^2) dP_e(s),    G = 1 - f + f g(D t/a^2)
    g(x) = 1.304 exp(-sqrt(x)) - .304 exp(-.254 x)

f is the fraction of the force that drains, 1 - 1/(2 (1 - nu_s)) for the drained network's nu_s; D in mm^2/s is the
diffusivity, a the punch's radius; P_e is the force at once, with nu 1/2. g is entered as five Prony terms, within
.0034 of it for x > .001; a later g (Lai, Hu, 2017) differs from it by up to .04.

g is that of a half-space. A layer drains a larger share, and its time is a^2 times a function of a/h, which is not
used here: D is that of a half-space which drains like the layer. Where a/h differs by much between the punches, D
then depends on the radius, which is tested. Range: flat punches, f up to .5, D .001 to 20 mm^2/s; vanishes at f =
0. Confused with viscoelasticity, whose time is the same for all radii; holds with several radii distinguish them.
Sources: Hu, Zhao, Vlassak, Suo, Appl. Phys. Lett. 96 (2010) 121904; Hu, Chan, Vlassak, Suo, J. Appl. Phys. 110
(2011) 086103 (layers).
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from calibration.effects.viscoelasticity import KEPT, relaxed
from calibration.inputs.conditions import missing_course
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

# g as a sum of exponentials in x = D t/a^2, by least squares over x from .001 to 200
WEIGHTS = (0.0543, 0.1258, 0.2803, 0.4524, 0.0872)  # of the terms, 1 in sum
TIMES = (0.00128, 0.02156, 0.17587, 1.00097, 9.83891)  # time constants of the terms, dimensionless
DIFFUSIVITIES = (0.01, 0.1, 0.4, 2)  # mm^2/s, where fits begin


class Poroelasticity(EffectBase):
    """The fraction that drains and the diffusivity."""

    key = "poroelasticity"
    title = "liquid drains from the gel under load, slower under a larger punch"
    stage = Stage.HISTORY
    seen_in = ("t", "log rate", "load/unload", "a")
    confused_with = ("viscoelasticity", "stiffening", "clock_offset")
    separated_by = ("holds of 25 s with several radii",)
    source = "Hu, Zhao, Vlassak, Suo, Appl. Phys. Lett. 96 (2010) 121904"
    same_over = ("a", "log rate", "order")
    order = 165
    largest = 0.3
    check = ManualCheck("hold a press for 25 s with the smallest punch and with the largest", 6)
    parameters = (
        Parameter("fraction", "1", 0.0, (0, 0.5), "fraction of the force that drains", 0.1),
        Parameter("diffusivity_mm2_s", "mm^2/s", 0.4, (0.001, 20), "diffusivity of the liquid in the gel", 0.4),
    )
    start_values = tuple((0.1, diffusivity) for diffusivity in DIFFUSIVITIES)

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show drainage; empty where they can."""
        if why := missing_course(data):
            return why
        flat = all(indenter.shape == "flat_cylinder" for indenter in data.indenters)
        return "" if flat else "its function of time is that of a flat punch"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the drained part subtracted, down to 0, from a force in contact."""
        elastic, (fraction, diffusivity) = state.force_N, values
        if fraction == 0:
            return state
        over_area = _over_radius_squared(data)
        terms = zip(WEIGHTS, TIMES, strict=True)
        lost = sum(
            (weight * relaxed(elastic, time / diffusivity, data=over_area) for weight, time in terms),
            np.zeros(data.size),
        )
        left = np.maximum(elastic - fraction * lost, 0)
        return replace(state, force_N=np.where(elastic > 0, left, elastic))


@lru_cache(maxsize=KEPT)
def _over_radius_squared(data: Observations) -> Observations:
    """Return the data with t/a^2 in s/mm^2 for the time."""
    return replace(data, time_s=data.time_s / data.radius_mm**2)
