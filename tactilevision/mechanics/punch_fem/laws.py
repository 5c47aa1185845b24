"""Kinematics of an axisymmetric solid and its constitutive laws: Neo-Hooke, Yeoh, Gent and Hencky."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.records.measured import Floats, Material

# Deformation of an axisymmetric solid, as five numbers a point, and the invariants built from them.
#
# F = (F_rr, F_rz, F_zr, F_zz, F_tt): row the component, column the reference direction, t the hoop. All
# arrays are (N, 5), first derivatives (N, 5), second derivatives (N, 5, 5), for N points. In memory the points are
# contiguous (Fortran's order): sums and products then run along them.
# Source: Holzapfel, Nonlinear Solid Mechanics (2000), chapter 6.

IDENTITY = np.array([1.0, 0.0, 0.0, 1.0, 1.0])  # deformation gradient at rest: F_rr, F_rz, F_zr, F_zz, F_tt

# The in-plane determinant j = F_rr F_zz - F_rz F_zr is quadratic: its second derivative is this constant.
PLANE_HESSIAN = np.pad(np.fliplr(np.diag([1.0, -1.0, -1.0, 1.0])), (0, 1))


@dataclass(frozen=True, slots=True)
class Deformation:
    """F (N, 5); `plane` (N,) in-plane determinant and its gradient (N, 5); `volume` J (N,) with gradient and
    hessian."""

    F: Floats
    plane: Floats
    plane_gradient: Floats
    volume: Floats
    volume_gradient: Floats
    volume_hessian: Floats


def deformation(F: Floats) -> Deformation:
    """Return the determinants of F (N, 5) and their derivatives: J = (F_rr F_zz - F_rz F_zr) F_tt."""
    F = np.asfortranarray(F)
    hoop = F[:, 4]
    plane = F[:, 0] * F[:, 3] - F[:, 1] * F[:, 2]
    plane_gradient = np.zeros_like(F)
    plane_gradient[:, 0], plane_gradient[:, 1] = F[:, 3], -F[:, 2]
    plane_gradient[:, 2], plane_gradient[:, 3] = -F[:, 1], F[:, 0]
    gradient = plane_gradient * hoop[:, None]
    gradient[:, 4] = plane
    hessian = scaled(hoop, PLANE_HESSIAN)
    hessian[:, 4, :4] = hessian[:, :4, 4] = plane_gradient[:, :4]
    return Deformation(F, plane, plane_gradient, plane * hoop, gradient, hessian)


def outer(left: Floats, right: Floats) -> Floats:
    """Return the dyad of two (N, 5) fields: (N, 5, 5)."""
    product: Floats = left.T[:, None] * right.T
    return product.transpose(2, 0, 1)


def scaled(weight: Floats, constant: Floats) -> Floats:
    """Return a `constant` (5, 5) times `weight` (N,): (N, 5, 5)."""
    product: Floats = constant[:, :, None] * weight
    return product.transpose(2, 0, 1)


# Constitutive laws: a distortional energy a law, and one volumetric energy for all.
#
# W(F, p) = W_d(F) + p g(J) - p²/(2K): p is the pressure unknown (positive in tension), K the bulk modulus;
# eliminating p gives W_d + (K/2) g(J)². For the laws in I1 here g = J - 1, which is the (J - 1)²/D1 of Abaqus and
# CalculiX with D1 = 2/K; Hencky's law has g = ln J. All tend to the linear solid of the same Material.


class Law:
    """A constitutive law: energy, stress dW_d/dF (N, 5) and tangent d²W_d/dF² (N, 5, 5) of distortion, in MPa.

    Unless overridden, its energy is a function of I1' = J^(-2/3) I1 and its volumetric measure g = J - 1.
    """

    name: str

    def of_invariant(self, x: Floats, shear_MPa: float) -> tuple[Floats, Floats, Floats]:
        """Return the energy of distortion per volume at I1' - 3 = `x` and its first two derivatives (N,), MPa."""
        raise NotImplementedError

    def energy(self, state: Deformation, shear_MPa: float) -> Floats:
        """Return the energy of distortion per volume (N,), MPa."""
        return self.of_invariant(first_invariant(state) - 3, shear_MPa)[0]

    def distortion(self, state: Deformation, shear_MPa: float) -> tuple[Floats, Floats]:
        """Return the stress (N, 5) and tangent (N, 5, 5) of the distortion, MPa."""
        F, J, G = state.F, state.volume, state.volume_gradient
        scale = J ** (-2 / 3)
        length = np.einsum("ni,ni->n", F, F)
        _, first, second = self.of_invariant(scale * length - 3, shear_MPa)
        gradient = scale[:, None] * (2 * F - (2 / 3 * length / J)[:, None] * G)
        by_length = -(4 / 3 / J)[:, None] * F
        hessian = outer(G, by_length + (10 / 9 * length / J**2)[:, None] * G) + outer(by_length, G)
        hessian -= (2 / 3 * length / J)[:, None, None] * state.volume_hessian
        hessian[:, range(5), range(5)] += 2
        hessian *= (first * scale)[:, None, None]
        return first[:, None] * gradient, hessian + outer(second[:, None] * gradient, gradient)

    def volume(self, J: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the volumetric measure g(J) (N,), with g' and g''."""
        return J - 1, np.ones_like(J), np.zeros_like(J)


@dataclass(frozen=True, slots=True)
class Yeoh(Law):
    """W_d = (mu/2) [(I1' - 3) + c2 (I1' - 3)² + c3 (I1' - 3)³].

    c2 = C20/C10 and c3 = C30/C10 are pure numbers; both 0 is NeoHooke.
    Source: Yeoh, Rubber Chem. Technol. 66 (1993) 754.
    """

    c2: float = 0.0
    c3: float = 0.0
    name: str = "yeoh"

    def of_invariant(self, x: Floats, shear_MPa: float) -> tuple[Floats, Floats, Floats]:
        """Return the energy of distortion per volume at I1' - 3 = `x` and its first two derivatives (N,), MPa."""
        half, c2, c3 = shear_MPa / 2, self.c2, self.c3
        first, second = 1 + 2 * c2 * x + 3 * c3 * x**2, 2 * c2 + 6 * c3 * x
        return half * (x + c2 * x**2 + c3 * x**3), half * first, half * second


@dataclass(frozen=True, slots=True)
class NeoHooke(Yeoh):
    """W_d = (mu/2) (I1' - 3), I1' = J^(-2/3) I1. C10 = mu/2 and D1 = 2/K in Abaqus' words.

    Source: Treloar (1943); Abaqus Theory Guide 4.6.1.
    """

    name: str = "neo-hooke"


@dataclass(frozen=True, slots=True)
class Gent(Law):
    """W_d = -(mu/2) Jm ln(1 - (I1' - 3)/Jm), defined while I1' - 3 < Jm; Jm -> infinity is NeoHooke.

    Beyond the limit the energy is infinite: the solver meets NaN there and cuts its step.
    Source: Gent, Rubber Chem. Technol. 69 (1996) 59.
    """

    limit: float = 30
    name: str = "gent"

    def __post_init__(self) -> None:
        if not self.limit > 0:
            raise InputError("Gent's limit Jm of I1 - 3 must be above 0", where="Gent", value=self.limit)

    def of_invariant(self, x: Floats, shear_MPa: float) -> tuple[Floats, Floats, Floats]:
        """Return the energy of distortion per volume at I1' - 3 = `x` and its first two derivatives (N,), MPa."""
        room = np.where(x < self.limit, 1 - x / self.limit, np.nan)
        first = shear_MPa / 2 / room
        return -shear_MPa / 2 * self.limit * np.log(room), first, first / (self.limit * room)


def first_invariant(state: Deformation) -> Floats:
    """Return I1' = J^(-2/3) F:F, 3 in any pure dilatation (N,)."""
    value: Floats = state.volume ** (-2 / 3) * np.einsum("ni,ni->n", state.F, state.F)
    return value


# Hencky's law: linear elasticity between Kirchhoff stress and logarithmic strain.

# |F_plane|² - 2 j = (F_rr - F_zz)² + (F_rz + F_zr)², free of cancellation; half its second derivative:
_SHAPE = np.diag([1.0, 1.0, 1.0, 1.0, 0.0]) - PLANE_HESSIAN

_SERIES_BELOW = 1e-3  # of the excess, below which the logarithm comes from its series


@dataclass(frozen=True, slots=True)
class Hencky(Law):
    """W_d = mu dev(ln V):dev(ln V), with volumetric measure g = ln J.

    In closed form, without eigenvectors: e1² + e2² + e3² = (ln j)²/2 + (arccosh x)²/2 + (ln F_tt)², where
    j is the in-plane determinant and x = |F_plane|²/(2 j). Stable to stretches of about 2 (its shear modulus
    softens beyond). Source: Hencky (1928); Anand, J. Appl. Mech. 46 (1979) 78.
    """

    name: str = "hencky"

    def energy(self, state: Deformation, shear_MPa: float) -> Floats:
        """Return the energy of distortion per volume (N,), MPa."""
        square = _arccosh_square(_excess(state))[0]
        plane, hoop = np.log(state.plane), np.log(state.F[:, 4])
        energy: Floats = shear_MPa * (plane**2 / 2 + square / 2 + hoop**2 - (plane + hoop) ** 2 / 3)
        return energy

    def distortion(self, state: Deformation, shear_MPa: float) -> tuple[Floats, Floats]:
        """Return the stress (N, 5) and tangent (N, 5, 5) of the distortion, MPa."""
        j, hoop, grad_j = state.plane, state.F[:, 4], state.plane_gradient
        log_j, log_hoop = np.log(j), np.log(hoop)
        # W_d/mu = (ln j)²/6 + (2/3)(ln F_tt)² - (2/3) ln j ln F_tt + q(x)/2
        first = (log_j / 3 - 2 / 3 * log_hoop) / j
        second = (1 / 3) / j**2 - first / j
        excess = _excess(state)
        _, slope, curvature = _arccosh_square(excess)
        shape = np.asfortranarray(state.F @ _SHAPE)
        # grad x = (shape - excess grad j)/j and its slope, sorted by their dyads
        mixed = -(slope + curvature * excess)[:, None] / (2 * j**2)[:, None]
        stress = (first - slope * excess / (2 * j))[:, None] * grad_j + (slope / (2 * j))[:, None] * shape
        of_j = second + excess / j**2 * (slope + curvature * excess / 2)
        tangent = outer(grad_j, of_j[:, None] * grad_j + mixed * shape)
        tangent += outer(shape, (curvature / (2 * j**2))[:, None] * shape + mixed * grad_j)
        tangent += scaled(slope / (2 * j), _SHAPE) + scaled(first - slope * excess / (2 * j), PLANE_HESSIAN)
        across = -(2 / 3) / (j * hoop)
        tangent[:, 4, :] += across[:, None] * grad_j
        tangent[:, :, 4] += across[:, None] * grad_j
        stress[:, 4] += (4 / 3 * log_hoop - 2 / 3 * log_j) / hoop
        tangent[:, 4, 4] += (4 / 3 - (4 / 3 * log_hoop - 2 / 3 * log_j)) / hoop**2
        return shear_MPa * stress, shear_MPa * tangent

    def volume(self, J: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the volumetric measure g(J) (N,), with g' and g''."""
        return np.log(J), 1 / J, -1 / J**2


def _excess(state: Deformation) -> Floats:
    """Return x - 1 = ((F_rr - F_zz)² + (F_rz + F_zr)²) / (2 j) >= 0 (N,)."""
    F = state.F
    value: Floats = ((F[:, 0] - F[:, 3]) ** 2 + (F[:, 1] + F[:, 2]) ** 2) / (2 * state.plane)
    return value


def _arccosh_square(excess: Floats) -> tuple[Floats, Floats, Floats]:
    """Return q(x) = arccosh(x)² and its first two derivatives at x = 1 + excess; a series where they cancel."""
    y = np.maximum(excess, _SERIES_BELOW)
    angle = 2 * np.arcsinh(np.sqrt(y / 2))  # arccosh(1 + y) without its cancellation
    root = np.sqrt(y * (2 + y))
    first = 2 * angle / root
    second = 2 / root**2 - (1 + y) * first / root**2
    z = excess
    small = excess < _SERIES_BELOW
    # arccosh(1 + z)² = 2z - z²/3 + 4z³/45 - z⁴/35 + ...
    return (
        np.where(small, z * (2 + z * (-1 / 3 + z * (4 / 45 - z / 35))), angle**2),
        np.where(small, 2 + z * (-2 / 3 + z * (4 / 15 - z * 4 / 35)), first),
        np.where(small, -2 / 3 + z * (8 / 15 - z * 12 / 35), second),
    )


# Loss of ellipticity, beyond which shear bands of any width cost no energy.
#
#     Q_ik(n) = d²W/dF_ij dF_kl n_j n_l,      elliptic while Q is positive definite for all directions n.
#
# Beyond, an equilibrium depends on its mesh. Neo-Hooke never gets there; Hencky's law does in shear,
# incompressible and in plane strain at ln(stretch) tanh(ln(stretch)) ... = 1, a stretch of 3.32, compressible
# sooner. Directions in the plane (r, z) only: bands round the axis. Source: Knowles, Sternberg, J. Elasticity 8
# (1978) 329; for Hencky's law Bruhns, Xiao, Meyers, Proc. R. Soc. A 457 (2001) 2207.

DIRECTIONS = 180  # of the acoustic tensor


def least_acoustic(law: Law, material: Material, *, state: Deformation) -> Floats:
    """Return the smallest eigenvalue of Q over all directions, in shear moduli (N,): below 0 ellipticity is
    lost.
    """
    shear, bulk, gradient = material.shear_modulus_MPa, material.bulk_modulus_MPa, state.volume_gradient
    g, dg, ddg = law.volume(state.volume)
    tangent = law.distortion(state, shear)[1]
    tangent += (bulk * (dg**2 + g * ddg))[:, None, None] * outer(gradient, gradient)
    tangent += (bulk * g * dg)[:, None, None] * state.volume_hessian
    angle = np.arange(DIRECTIONS) * (np.pi / DIRECTIONS)
    plane = tangent[:, :4, :4].reshape(-1, 2, 2, 2, 2).transpose(1, 3, 0, 2, 4).reshape(2, 2, -1, 4)
    mean, half = (plane[0, 0] + plane[1, 1]) / 2, (plane[0, 0] - plane[1, 1]) / 2
    least = np.full(len(tangent), np.inf)
    for n in np.stack([np.cos(angle), np.sin(angle)], axis=-1):
        dyad = np.outer(n, n).ravel()
        least = np.minimum(least, mean @ dyad - np.hypot(half @ dyad, plane[0, 1] @ dyad))
    return np.asarray(least / shear)
