"""Constitutive laws: a distortional energy a law, and one volumetric energy for all.

W(F, p) = W_d(F) + p g(J) - p²/(2K): p is the pressure unknown (positive in tension), K the bulk modulus;
eliminating p gives W_d + (K/2) g(J)². For the laws in I1 here g = J - 1, which is the (J - 1)²/D1 of Abaqus and
CalculiX with D1 = 2/K; Hencky's law has g = ln J. All tend to the linear solid of the same Material.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_fem.kinematics import Deformation, outer
from tactilevision.records import Floats, Material


class Law(Protocol):
    """What the solver asks of a law. Stress is dW_d/dF (N, 5), tangent d²W_d/dF² (N, 5, 5), both in MPa."""

    @property
    def name(self) -> str: ...

    def distortion(self, state: Deformation, shear_MPa: float) -> tuple[Floats, Floats]:
        """Stress (N, 5) and tangent (N, 5, 5) of the distortion, MPa."""
        ...

    def energy(self, state: Deformation, shear_MPa: float) -> Floats:
        """Energy of distortion per volume (N,), MPa."""
        ...

    def volume(self, J: Floats) -> tuple[Floats, Floats, Floats]:
        """Volumetric measure g(J) (N,), with g' and g''."""
        ...


def shear_modulus_MPa(material: Material) -> float:
    """mu = E / (2 (1 + nu))."""
    return material.youngs_modulus_MPa / (2 * (1 + material.poisson_ratio))


def bulk_modulus_MPa(material: Material) -> float:
    """K = E / (3 (1 - 2 nu))."""
    return material.youngs_modulus_MPa / (3 * (1 - 2 * material.poisson_ratio))


def linear_volume(J: Floats) -> tuple[Floats, Floats, Floats]:
    """g = J - 1 (N,), with g' and g''."""
    return J - 1, np.ones_like(J), np.zeros_like(J)


@dataclass(frozen=True, slots=True)
class NeoHooke:
    """W_d = (mu/2) (I1' - 3), I1' = J^(-2/3) I1. C10 = mu/2 and D1 = 2/K in Abaqus' words.

    Source: Treloar (1943); Abaqus Theory Guide 4.6.1.
    """

    name: str = "neo-hooke"

    def energy(self, state: Deformation, shear_MPa: float) -> Floats:
        """Energy of distortion per volume (N,), MPa."""
        return shear_MPa / 2 * (first_invariant(state) - 3)

    def distortion(self, state: Deformation, shear_MPa: float) -> tuple[Floats, Floats]:
        """Stress (N, 5) and tangent (N, 5, 5) of the distortion, MPa."""
        return from_first_invariant(state, lambda i: (np.full_like(i, shear_MPa / 2), np.zeros_like(i)))

    def volume(self, J: Floats) -> tuple[Floats, Floats, Floats]:
        """Volumetric measure g(J) (N,), with g' and g''."""
        return linear_volume(J)


@dataclass(frozen=True, slots=True)
class Yeoh:
    """W_d = (mu/2) [(I1' - 3) + c2 (I1' - 3)² + c3 (I1' - 3)³].

    c2 = C20/C10 and c3 = C30/C10 are pure numbers; both 0 is NeoHooke.
    Source: Yeoh, Rubber Chem. Technol. 66 (1993) 754.
    """

    c2: float = 0.0
    c3: float = 0.0
    name: str = "yeoh"

    def energy(self, state: Deformation, shear_MPa: float) -> Floats:
        """Energy of distortion per volume (N,), MPa."""
        x = first_invariant(state) - 3
        return shear_MPa / 2 * (x + self.c2 * x**2 + self.c3 * x**3)

    def distortion(self, state: Deformation, shear_MPa: float) -> tuple[Floats, Floats]:
        """Stress (N, 5) and tangent (N, 5, 5) of the distortion, MPa."""

        def slope(i: Floats) -> tuple[Floats, Floats]:
            x = i - 3
            first = 1 + 2 * self.c2 * x + 3 * self.c3 * x**2
            return shear_MPa / 2 * first, shear_MPa / 2 * (2 * self.c2 + 6 * self.c3 * x)

        return from_first_invariant(state, slope)

    def volume(self, J: Floats) -> tuple[Floats, Floats, Floats]:
        """Volumetric measure g(J) (N,), with g' and g''."""
        return linear_volume(J)


@dataclass(frozen=True, slots=True)
class Gent:
    """W_d = -(mu/2) Jm ln(1 - (I1' - 3)/Jm), defined while I1' - 3 < Jm; Jm -> infinity is NeoHooke.

    Beyond the limit the energy is infinite: the solver meets NaN there and cuts its step.
    Source: Gent, Rubber Chem. Technol. 69 (1996) 59.
    """

    limit: float = 30.0
    name: str = "gent"

    def __post_init__(self) -> None:
        if not self.limit > 0:
            raise InputError("Gent's limit Jm of I1 - 3 lies above 0", where="Gent", value=self.limit)

    def energy(self, state: Deformation, shear_MPa: float) -> Floats:
        """Energy of distortion per volume (N,), MPa."""
        room = 1 - (first_invariant(state) - 3) / self.limit
        return -shear_MPa / 2 * self.limit * np.log(np.where(room > 0, room, np.nan))

    def distortion(self, state: Deformation, shear_MPa: float) -> tuple[Floats, Floats]:
        """Stress (N, 5) and tangent (N, 5, 5) of the distortion, MPa."""

        def slope(i: Floats) -> tuple[Floats, Floats]:
            room = 1 - (i - 3) / self.limit
            first = shear_MPa / 2 / np.where(room > 0, room, np.nan)
            return first, first / (self.limit * room)

        return from_first_invariant(state, slope)

    def volume(self, J: Floats) -> tuple[Floats, Floats, Floats]:
        """Volumetric measure g(J) (N,), with g' and g''."""
        return linear_volume(J)


def first_invariant(state: Deformation) -> Floats:
    """I1' = J^(-2/3) F:F, 3 in any pure dilatation (N,)."""
    value: Floats = state.volume ** (-2 / 3) * np.einsum("ni,ni->n", state.F, state.F)
    return value


def from_first_invariant(
    state: Deformation, slope: Callable[[Floats], tuple[Floats, Floats]]
) -> tuple[Floats, Floats]:
    """Stress (N, 5) and tangent (N, 5, 5), MPa, of an energy f(I1'); `slope` gives f' and f''."""
    F, J, G = state.F, state.volume, state.volume_gradient
    scale = J ** (-2 / 3)
    length = np.einsum("ni,ni->n", F, F)
    first, second = slope(scale * length)
    gradient = scale[:, None] * (2 * F - (2 / 3 * length / J)[:, None] * G)
    cross = outer(F, G)
    hessian = -(4 / 3 / J)[:, None, None] * (cross + cross.transpose(0, 2, 1))
    hessian += (10 / 9 * length / J**2)[:, None, None] * outer(G, G)
    hessian -= (2 / 3 * length / J)[:, None, None] * state.volume_hessian
    hessian[:, range(5), range(5)] += 2
    tangent = (first * scale)[:, None, None] * hessian + second[:, None, None] * outer(gradient, gradient)
    return first[:, None] * gradient, tangent
