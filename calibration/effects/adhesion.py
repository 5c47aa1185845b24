"""The gel clings to the face while it is drawn off: the line of unloading goes on into tension down to pull-off.

    P = K0 w for -w_c < w < 0 in unloading,    (w_c^2/2) dK0/da = 2 pi a W

W work of adhesion in N/mm (1 J/m^2 = .001 N/mm): the face lets go where the energy that a shrinking contact
releases pays for it. dK0/da is the bonded layer's, which for a/h near 1 is far above the half-space's 2 E*; there
w_c gives Kendall's pull-off sqrt(8 pi a^3 E* W). A flat punch's contact does not shrink before, so loading shows
nothing. The depth at which one press lets go is known to a tenth of w_c (std), no better than the zero. Over a
wide range about w_c (OPEN) the reading itself says whether the face still held: it pulls as no air does, or, where
no air was read, by more than half of K0 w. It had let go where it does not and K0 w would show. A share (LAW)
keeps W in the middle of what was read. So faces that let go by another law of the radius are followed,
too. Vanishes at W = 0.
Sources: Kendall, J. Phys. D 4 (1971) 1186; Johnson, Kendall, Roberts, Proc. R. Soc. A 324 (1971) 301.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.inputs.checks import pull_level_N
from calibration.inputs.denoised_depth import drawn_off
from calibration.inputs.observations import Observations
from calibration.laws.theory import punch_stiffness
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

SPREAD = 0.1  # std of the depth at which the face lets go, over w_c
OPEN = 16.0  # of these std in ln w about w_c: from a fifth to five times it the reading says what holds
LAW = 0.05  # share of the tension that follows the law alone
LEAST_MM = 1e-6  # mm of being drawn off: no face lets go before
STEP = 0.01  # of the radius, for the slope of the stiffness


@dataclass(frozen=True, slots=True)
class Adhesion(EffectBase):
    """One work of adhesion."""

    key = "adhesion"
    title = "the gel clings to the punch"
    stage = Stage.HISTORY
    seen_in = ("load/unload",)
    confused_with = ("force_bias", "depth_zero")
    separated_by = ("unloading to pull-off",)
    source = "Kendall, J. Phys. D 4 (1971) 1186"
    threshold = True
    asks_readings = True
    order = 150
    largest = 0.002
    check = ManualCheck("unload slowly until the punch lets go", 4.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """W."""
        return (Parameter("work_N_per_mm", "N/mm", 0.0, (0.0, 0.005), "work of adhesion", 0.0003),)

    def missing(self, data: Observations) -> str:
        """What these data would need."""
        if not (drawn_off(data) & (data.depth_mm < 0)).any():
            return "needs unloading beyond the first touch, down to pull-off"
        return ""

    def starts(self, data: Observations) -> Floats:
        """Where to look and to begin."""
        return np.array([[1e-5], [5e-5], [2e-4], [1e-3]])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Tension before pull-off."""
        if values[0] <= 0:
            return state
        pulled = drawn_off(data) & (state.depth_mm < 0)
        growth = np.maximum(_growth(state, data), 1e-12)  # a search may pass where the gel has no stiffness left
        limit = np.sqrt(4 * np.pi * state.radius_mm * values[0] / growth)
        tension = state.stiffness_N_per_mm * np.minimum(state.depth_mm, 0)
        held = _held(tension, data)
        over = np.log(np.maximum(-state.depth_mm, LEAST_MM) / limit) / SPREAD
        clings = (1 - LAW) * _holds(over - OPEN * held) + LAW * _holds(over)
        return replace(state, force_N=state.force_N + pulled * clings * tension)


def _held(tension_N: Floats, data: Observations) -> Floats:
    """1 where a reading (N,) says that the face holds, -1 where it says that it has let go, else 0."""
    read, level = data.normal_N, pull_level_N(data)
    pulls = np.full(data.size, level) if np.isfinite(level) else tension_N / 2
    told = [read == 0, read < pulls, tension_N <= 2 * pulls]  # 0 N sharp: nothing was read
    return np.select(told, [0.0, 1.0, -1.0], default=0.0)


def _holds(over: Floats) -> Floats:
    """1 where the face holds, 0 where it has let go, smooth so that a fit sees a slope."""
    return np.asarray(1 / (1 + np.exp(np.clip(2 * over, -50, 50))))


def _growth(state: State, data: Observations) -> Floats:
    """dK0/da (N,), N/mm^2: the slope of the layer's stiffness over its radius, at this state's own stiffness."""
    nu = 0.48 if data.gel.poisson_ratio is None else data.gel.poisson_ratio
    a, h = state.radius_mm, state.thickness_mm
    inner, outer = (punch_stiffness(1.0, nu, radius_mm=a * (1 + side), thickness_mm=h) for side in (-STEP, STEP))
    return np.asarray(state.stiffness_N_per_mm * (outer - inner) / (outer + inner) / (STEP * a))
