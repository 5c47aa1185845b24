"""Error of the gel's thickness.

    h -> h (1 + d),    d ~ N(0, s^2)

It changes kappa(nu, a/h) and the strain w/h. The stated thickness is itself a measurement: s is thickness_std_mm
over the thickness, or 10 % where none is stated (a judgement: a gel that is cast and glued by hand). Without this
prior other misfits are taken up by an impossible thickness. Range: |d| up to .4; vanishes at d = 0. On one radius
it is confused with E and beta; several radii or a gauge distinguish it. Source: the law's own h.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.inputs.observations import Observations
from calibration.model.stages import THICKNESS, EffectBase, ManualCheck, Parameter, Prior, Stage, State, amplitude
from tactilevision.records.measured import Floats


@dataclass(frozen=True, slots=True)
class Thickness(EffectBase):
    """One relative error of the thickness; `held`: with its prior."""

    held: bool = True

    key = "thickness"
    title = "the gel is not as thick as stated"
    stage = Stage.GEOMETRY
    seen_in = ("a",)
    confused_with = ("youngs_modulus", "edge_fillet", "stiffening")
    separated_by = ("several radii", "a gauge")
    source = "the law"
    order = 110
    largest = 0.3
    check = ManualCheck("measure the gel's thickness at its rim", 5, 0.02)
    condition = THICKNESS
    instead_of_beta = 1
    parameters = (amplitude("relative", "1", 0.4, "thickness over the stated one, less 1", 0.1),)

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return d with the prior that is stated or judged."""
        (relative,) = self.parameters
        if not self.held:
            return (relative,)
        gel = data.gel
        if gel.thickness_std_mm > 0:
            prior = Prior(0.0, gel.thickness_std_mm / gel.thickness_mm, "thickness_std_mm as stated")
        else:
            prior = Prior(0.0, relative.scale, "no thickness_std_mm is stated: a judgement")
        return (replace(relative, prior=prior),)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the thickness scaled."""
        return state.times(thickness_mm=1 + values[0])

    def freed(self) -> Thickness:
        """Return the effect without its prior."""
        return Thickness(held=False)
