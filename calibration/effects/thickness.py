"""The gel's thickness is h (1 + d) instead of h.

Changes kappa(nu, a/h) and the strain w/h. On one radius it is E and beta; several radii show it. The stated
thickness is a measurement too: d ~ N(0, s^2), s from thickness_std_mm, else 10 %, what a gel that is cast and
glued by hand may be off. Without it other misfits run into a thickness that no gel has.
Vanishes at d = 0. Source: the law's own h; s is a judgement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.inputs.observations import Observations
from calibration.model.stages import THICKNESS, EffectBase, ManualCheck, Parameter, Prior, Stage, State
from tactilevision.records.measured import Floats

JUDGED = 0.1  # of the thickness, its std where nobody stated one


@dataclass(frozen=True, slots=True)
class Thickness(EffectBase):
    """One relative error of the thickness; not `held`, nothing is taken to be known of it."""

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
    check = ManualCheck("measure the gel's thickness at its rim", 5.0, 0.02)
    condition = THICKNESS
    instead_of_beta = 1

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """d."""
        return (Parameter("relative", "1", 0.0, (-0.4, 0.4), "thickness over the stated one, less 1", 0.1),)

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """d held by what is stated or judged of the thickness."""
        if not self.held:
            return self.parameters
        gel = data.gel
        if gel.thickness_std_mm > 0:
            prior = Prior(0.0, gel.thickness_std_mm / gel.thickness_mm, "thickness_std_mm as stated")
        else:
            prior = Prior(0.0, JUDGED, "no thickness_std_mm is stated: a judgement")
        return tuple(replace(p, prior=prior) for p in self.parameters)

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Scale the thickness."""
        return replace(state, thickness_mm=state.thickness_mm * (1 + values[0]))

    def freed(self) -> Thickness:
        """The same, held by nothing."""
        return Thickness(held=False)
