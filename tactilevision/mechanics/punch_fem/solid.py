"""Element forces and stiffness of the mixed form, the pressure condensed but kept as an unknown.

Stationarity of the integral of W(F, p) (see laws) gives, by Newton's method for one element,
[K_uu K_up; K_pu K_pp] [du; dp] = -[R_u; R_p]. The pressure is discontinuous, so dp = -K_pp^-1 (R_p + K_pu du) is
eliminated element by element (K_pp is diagonal) and recovered afterwards: p is an unknown of Newton's method,
never a function of u, and the iteration count does not depend on nu.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.mechanics.punch_fem.discretisation import Discretisation
from tactilevision.mechanics.punch_fem.laws import (
    IDENTITY,
    Deformation,
    Law,
    deformation,
    outer,
)
from tactilevision.records.measured import Floats, Material


@dataclass(frozen=True, slots=True)
class ElementSystem:
    """One linearisation: `force` (E, 18) with the pressure condensed, and what recovers it,
    dp = `recover_constant` (E, 3) - `recover_slope` (E, 3, 18) du. `internal` (E, 18) is the force before that;
    `tangent` (E Q, 5, 5) of the stress, `coupling` (E, 3, 18) of pressure and motion."""

    mesh: Discretisation
    tangent: Floats
    coupling: Floats
    force: Floats
    internal: Floats
    recover_constant: Floats
    recover_slope: Floats
    pressure_residual: Floats

    @property
    def stiffness(self) -> Floats:
        """The stiffness (E, 18, 18), N per mm, with the pressure condensed; computed at each call."""
        elements, points, gradient = *self.mesh.weight_mm3.shape, self.mesh.gradient
        weighted = np.multiply(self.tangent, self.mesh.weight_mm3.reshape(-1, 1, 1), order="C")
        across = gradient.reshape(elements, points * 5, 18).transpose(0, 2, 1)
        matrix: Floats = across @ (weighted @ gradient.reshape(-1, 5, 18)).reshape(elements, points * 5, 18)
        matrix -= self.coupling.transpose(0, 2, 1) @ self.recover_slope
        return matrix


def deform(mesh: Discretisation, u: Floats) -> Deformation:
    """Return the deformation at all quadrature points (E Q) for the unknowns `u` (U,) mm."""
    elements, points = mesh.weight_mm3.shape
    local = u[mesh.dofs][:, :, None]
    strain = mesh.gradient.reshape(elements, points * 5, 18) @ local
    return deformation(strain.reshape(-1, 5) + IDENTITY)


def corner_volumes(mesh: Discretisation, u: Floats) -> Floats:
    """Return the in-plane volume ratio at the elements' corners (E, 4): where one is not above 0, the mesh has
    folded.
    """
    elements = len(mesh.dofs)
    strain = mesh.corner_gradient.reshape(elements, 16, 18) @ u[mesh.dofs][:, :, None]
    F = strain.reshape(elements, 4, 4) + IDENTITY[:4]
    volume: Floats = F[..., 0] * F[..., 3] - F[..., 1] * F[..., 2]
    return volume


def pressure_at_points(mesh: Discretisation, pressure: Floats) -> Floats:
    """Return the pressure unknowns (E, 3), in MPa, as values at all quadrature points (E Q,)."""
    values: Floats = np.einsum("eqm,em->eq", mesh.modes, pressure).ravel()
    return values


def linearise(
    mesh: Discretisation, law: Law, *, material: Material, state: Deformation, pressure: Floats
) -> ElementSystem:
    """Return the forces (N) and what gives the stiffness at `state` and `pressure` (E, 3), in MPa.

    NaN where the law is not defined there.
    """
    elements, points = mesh.weight_mm3.shape
    bulk = material.bulk_modulus_MPa
    p = pressure_at_points(mesh, pressure)
    stress, tangent = law.distortion(state, material.shear_modulus_MPa)
    g, dg, ddg = law.volume(state.volume)
    stress = stress + (p * dg)[:, None] * state.volume_gradient
    tangent += (p * dg)[:, None, None] * state.volume_hessian
    tangent += outer((p * ddg)[:, None] * state.volume_gradient, state.volume_gradient)

    weight = mesh.weight_mm3.ravel()
    flat = mesh.gradient.reshape(elements, points * 5, 18)
    internal = ((weight[:, None] * stress).reshape(elements, 1, -1) @ flat)[:, 0]

    modes = mesh.modes * mesh.weight_mm3[:, :, None]
    by_strain = (dg[:, None] * state.volume_gradient).reshape(elements, points, 5, 1) * modes[:, :, None, :]
    K_pu = by_strain.reshape(elements, points * 5, 3).transpose(0, 2, 1) @ flat
    R_p = np.einsum("eqm,eq->em", modes, (g - p / bulk).reshape(elements, points))
    softness = bulk / mesh.weight_mm3.sum(axis=1)  # K_pp is -1 over it
    constant, slope = softness[:, None] * R_p, -softness[:, None, None] * K_pu
    return ElementSystem(
        mesh=mesh,
        tangent=tangent,
        coupling=K_pu,
        force=internal + (constant[:, None] @ K_pu)[:, 0],
        internal=internal,
        recover_constant=constant,
        recover_slope=slope,
        pressure_residual=R_p,
    )


def stored_energy(mesh: Discretisation, law: Law, *, material: Material, u: Floats, pressure: Floats) -> float:
    """Return the strain energy in N mm for unknowns `u` (U,) mm: the integral of W_d + p g(J) - p²/(2K)."""
    state = deform(mesh, u)
    p = pressure_at_points(mesh, pressure)
    density = law.energy(state, material.shear_modulus_MPa) + p * law.volume(state.volume)[0]
    density = density - p**2 / (2 * material.bulk_modulus_MPa)
    return float(mesh.weight_mm3.ravel() @ density)
