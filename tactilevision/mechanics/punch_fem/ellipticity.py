"""Where a law stops being one: the loss of ellipticity, beyond which shear bands of any width cost no energy.

    Q_ik(n) = d²W/dF_ij dF_kl n_j n_l,      elliptic while Q is positive definite for all directions n.

Beyond, an equilibrium hangs on its mesh. Neo-Hooke never gets there; Hencky's law does in shear, incompressible
and in plane strain at ln(stretch) tanh(ln(stretch)) ... = 1, a stretch of 3.32, compressible sooner.
Directions in the plane (r, z) only: bands round the axis. Source: Knowles, Sternberg, J. Elasticity 8 (1978) 329;
for Hencky's law Bruhns, Xiao, Meyers, Proc. R. Soc. A 457 (2001) 2207.
"""

from __future__ import annotations

import numpy as np

from tactilevision.mechanics.punch_fem.kinematics import Deformation, outer
from tactilevision.mechanics.punch_fem.laws import Law, bulk_modulus_MPa, shear_modulus_MPa
from tactilevision.records import Floats, Material

DIRECTIONS = 180  # of the acoustic tensor


def least_acoustic(law: Law, material: Material, *, state: Deformation) -> Floats:
    """The smallest eigenvalue of Q over all directions, in shear moduli (N,): below 0 ellipticity is lost."""
    shear = shear_modulus_MPa(material)
    g, dg, ddg = law.volume(state.volume)
    bulk, gradient = bulk_modulus_MPa(material), state.volume_gradient
    tangent = law.distortion(state, shear)[1]
    tangent += (bulk * (dg**2 + g * ddg))[:, None, None] * outer(gradient, gradient)
    tangent += (bulk * g * dg)[:, None, None] * state.volume_hessian
    plane = tangent[:, :4, :4].reshape(-1, 2, 2, 2, 2)
    angle = np.arange(DIRECTIONS) * (np.pi / DIRECTIONS)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    least = np.full(len(plane), np.inf)
    for n in normals:
        Q = np.einsum("pijkl,j,l->pik", plane, n, n)
        mean, half = (Q[:, 0, 0] + Q[:, 1, 1]) / 2, (Q[:, 0, 0] - Q[:, 1, 1]) / 2
        least = np.minimum(least, mean - np.hypot(half, Q[:, 0, 1]))
    return np.asarray(least / shear)
