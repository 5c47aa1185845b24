"""A fit as it would stand at depths without their readings' noise.

A direction, or a press's own gain, at depths as read is off by just the noise that the residual holds: what it is
compared with. Seen from steady depths the two have nothing in common.
"""

from __future__ import annotations

from dataclasses import replace

from calibration.fit.least_squares import Fit, Problem
from calibration.inputs.denoised_depth import nominal_depth
from calibration.noise.model import Linear, Whitener


def at_denoised_depth(fitted: Fit) -> Fit:
    """The same values and the same residual; model, derivatives and forces at the nominal depths."""
    data = fitted.data.shifted(nominal_depth(fitted.data) - fitted.data.depth_mm)
    force = fitted.model.predict(fitted.values, data)
    about = Linear(force, fitted.model.slope(fitted.values, data), fitted.about.base_N)
    data = data.with_force(force + fitted.residual_N)
    problem = Problem(fitted.model, data, fitted.parameters, Whitener(data, fitted.noise, about))
    return replace(fitted, data=data, force_N=force, about=about, jacobian=problem.jacobian(fitted.values))
