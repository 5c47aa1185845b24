"""Adhesion: the gel sticks to the punch while it is retracted, so the force becomes tensile before pull-off.

    P = K0 w for -w_c < w < 0 in unloading,    (w_c^2/2) dK0/da = 2 pi a W

W is the work of adhesion in N/mm (1 J/m^2 = .001 N/mm), K0 the stiffness of the bonded layer, a the radius of the
punch. Pull-off comes at the depth -w_c at which the energy released by a shrinking contact equals W. Near a/h = 1
dK0/da lies far above the half-space's 2 E*; for a thick gel the pull-off force is Kendall's sqrt(8 pi a^3 E* W).
The contact of a flat punch does not shrink before, so loading is not changed. The depth of pull-off of one press
has a relative standard deviation of .1. Within OPEN of these about w_c the reading itself shows whether contact
still holds: it lies below the scatter of the forces in air or, where no air was read, below K0 w / 2. A share LAW
of the tension follows the law alone, so that W stays inside the range that was read.

Range: W up to .005 N/mm; vanishes at W = 0. Confused with a force bias or a depth zero, which also act in loading;
unloading to pull-off distinguishes them.
Sources: Kendall, J. Phys. D 4 (1971) 1186; Johnson, Kendall, Roberts, Proc. R. Soc. A 324 (1971) 301.
"""

from __future__ import annotations

import numpy as np

from calibration.inputs.checks import pull_level_N
from calibration.inputs.denoised_depth import after_deepest
from calibration.inputs.observations import Observations
from calibration.laws.theory import nominal_nu, punch_stiffness
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Floats

SPREAD = 0.1  # std of the depth of pull-off over w_c
OPEN = 16  # of these std in ln w about w_c, a fifth to five times it: there the reading decides
LAW = 0.05  # share of the tension that follows the law alone
STEP = 0.01  # of the radius, for the derivative of the stiffness


class Adhesion(EffectBase):
    """Adhesion with one work of adhesion."""

    key = "adhesion"
    title = "the gel clings to the punch"
    acts_on = "punch"
    stage = Stage.HISTORY
    seen_in = ("load/unload",)
    confused_with = ("force_bias", "depth_zero")
    separated_by = ("unloading to pull-off",)
    source = "Kendall, J. Phys. D 4 (1971) 1186"
    threshold = True
    asks_readings = True
    order = 150
    largest = 0.002
    check = ManualCheck("unload slowly until the punch lets go", 4)
    parameters = (Parameter("work_N_per_mm", "N/mm", 0.0, (0, 0.005), "work of adhesion", 3e-4),)
    start_values = ((1e-5,), (5e-5,), (2e-4,), (1e-3,))

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show adhesion; empty where they can."""
        if not (after_deepest(data) & (data.depth_mm < 0)).any():
            return "needs unloading beyond the first touch, down to pull-off"
        return ""

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the tension before pull-off."""
        if values[0] <= 0:
            return state
        retracted = after_deepest(data) & (state.depth_mm < 0)
        growth = np.maximum(_stiffness_growth(state, data), TINY)  # a search may pass where the stiffness is 0
        limit = np.sqrt(4 * np.pi * state.radius_mm * values[0] / growth)
        tension = state.stiffness_N_per_mm * np.minimum(state.depth_mm, 0)
        over = np.log(np.maximum(-state.depth_mm, TINY) / limit) / SPREAD
        shift = OPEN * _contact_read(tension, data)
        share = (1 - LAW) * _in_contact(over - shift) + LAW * _in_contact(over)
        return state.plus(force_N=retracted * share * tension)


def _contact_read(tension_N: Floats, data: Observations) -> Floats:
    """Return 1 where a reading (N,) shows contact, -1 where it shows release, else 0."""
    read, level = data.normal_N, pull_level_N(data)
    pulls = np.full(data.size, level) if np.isfinite(level) else tension_N / 2
    cases = [read == 0, read < pulls, tension_N <= 2 * pulls]  # exactly 0 N: nothing was read
    return np.select(cases, [0.0, 1.0, -1.0], default=0.0)


def _in_contact(over: Floats) -> Floats:
    """Return 1 in contact and 0 after release, smooth so that a fit has a gradient."""
    share: Floats = 1 / (1 + np.exp(np.clip(2 * over, -50, 50)))
    return share


def _stiffness_growth(state: State, data: Observations) -> Floats:
    """Return dK0/da (N,) in N/mm^2, scaled to this state's stiffness."""
    a, h, nu = state.radius_mm, state.thickness_mm, nominal_nu(data.gel)
    inner, outer = (punch_stiffness(1.0, nu, radius_mm=a * (1 + side), thickness_mm=h) for side in (-STEP, STEP))
    growth: Floats = state.stiffness_N_per_mm * (outer - inner) / (outer + inner) / (STEP * a)
    return growth
