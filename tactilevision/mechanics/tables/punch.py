"""Force and surface of a flat punch from the finite-element table, in microseconds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.boundary import rim_share
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.profile import LINEAR, SHAPE_PLACES, ProfileModel, PunchCase, linear_profile
from tactilevision.mechanics.punch_equation import check_within
from tactilevision.mechanics.tables import table as tables
from tactilevision.mechanics.tables.blocks import hayes_stiffness
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, REACH, USUAL
from tactilevision.mechanics.tables.table import shipped_table
from tactilevision.records.measured import Bools, Floats, Material


def punch_force(depth_mm: npt.ArrayLike, contact: FlatContact, *, material: Material) -> Floats:
    """Return the force in N of a flat punch pressed `depth_mm` (any shape) into a bonded gel on its first loading.

    P = E h w x Hayes' P/(E w h) of the flat part x the tabulated ratio x (1 - s). Below the first depth solved
    (.002 h) the force is proportional to depth. s is the effect of a near rim (boundary.py: within 10 % of s); 0
    for a pad of five thicknesses and more. Frictions and edge radii are interpolated; sharper than the smallest
    radius is its limit, with the error on the card. Raises InputError beyond the table in any direction. Source:
    punch_fem.
    """
    depth = np.asarray(depth_mm, dtype=float)
    ratio, known = force_ratio(depth.ravel(), contact, material=material)
    _demand(known, depth, contact, material)
    h, nu = contact.thickness_mm, material.poisson_ratio
    scale = (
        material.youngs_modulus_MPa * h * hayes_stiffness(nu, contact.a_over_h, edge_over_h=contact.edge_over_h)
    )
    return np.asarray(
        scale * (1 - rim_share(depth, contact, poisson_ratio=nu)) * depth * ratio.reshape(depth.shape)
    )


def force_ratio(
    depth_mm: Floats, contact: FlatContact, *, material: Material, table: tables.Table | None = None
) -> tuple[Floats, Bools]:
    """Return P/w over Hayes' for the flat part (N,) at `depth_mm` (N,), and where it is known."""
    there = table or shipped_table()
    mixture = there.mixture(contact.law, contact.friction, edge_over_h=contact.edge_over_h)
    nu, alpha = np.array(material.poisson_ratio), np.array(contact.a_over_h)
    places = there.axes.places(nu, alpha, depth_mm / contact.thickness_mm)
    ratio, known = tables.mixed(mixture, "stiffness", places)
    return ratio, known & (depth_mm >= 0)


def punch_reach(contact: FlatContact, material: Material) -> float:
    """Return the greatest depth (mm) that the table holds for this contact and material; 0 where it holds none."""
    mixture = shipped_table().mixture(contact.law, contact.friction, edge_over_h=contact.edge_over_h)
    return contact.thickness_mm * tables.reach(mixture, material.poisson_ratio, a_over_h=contact.a_over_h)


def surface_over_depth(r_over_a: Floats, case: PunchCase, *, mixture: tables.Mixture) -> Floats:
    """Return the rise and u_r over w (2, ...) at r/a >= 1, which of several depths are (depths, ...).

    Linear theory plus the tabulated excess, a spline in the root of the distance from the punch; from 3.5
    thicknesses on the excess fades like the profile.
    """
    from scipy.interpolate import PPoly

    axes = mixture[0][1].blocks[0].axes
    place = axes.places(np.array(case.poisson_ratio), np.array(case.a_over_h), np.ravel(case.w_over_h))
    excess, beyond = tables.blended(mixture, "surface", place), (r_over_a - 1) * case.a_over_h
    roots = np.sqrt(np.clip(beyond, 0, REACH)).reshape(len(excess), -1)
    lines = [
        PPoly.construct_fast(_splines() @ one.T, np.sqrt(BESIDE))(root)
        for one, root in zip(excess, roots, strict=True)
    ]
    line = np.moveaxis(np.stack(lines), -1, 0).reshape(2, *r_over_a.shape)
    fading = np.exp(-np.maximum(beyond - REACH, 0))
    return np.asarray(np.stack(linear_profile(r_over_a, case)) + fading * line)


@lru_cache(maxsize=1)
def _splines() -> Floats:
    """Return the polynomials (4, places - 1, places) of splines that are 1 at one place, else 0."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(np.sqrt(BESIDE), np.eye(len(BESIDE))).c)


def _demand(known: Bools, depth: Floats, contact: FlatContact, material: Material) -> None:
    """Raise InputError unless all is known, with what the table holds here."""
    if known.all():
        return
    axes, reach = shipped_table().axes, punch_reach(contact, material)
    nu, alpha = axes.poisson_ratios, axes.a_over_h
    raise InputError(
        "this is beyond the table",
        where="punch table",
        value={
            "depth_mm": [float(depth.min()), float(depth.max())],
            "poisson_ratio": material.poisson_ratio,
            "a_over_h": round(contact.a_over_h, 4),
        },
        remedy=f"It holds nu {nu[0]:g} to {nu[-1]:g}, a/h {alpha[0]:g} to {alpha[-1]:g}, and for this contact "
        f"depths to {reach:.3g} mm. Solve it with punch_fem.",
    )


# The tabulated surface as a ProfileModel, for the fits of nu and the certificate. Simulated gels do not use it:
# each is solved anew at its own friction and edge radius (synthetic/punch.py), so that errors of the table do not
# cancel.

EDGE_OVER_H = USUAL.edges_over_h[0]  # edge radius of the table's punch over h
POISSON_RANGE = USUAL.poisson_ratios[0], USUAL.poisson_ratios[-1]  # Poisson's ratio of the table
A_OVER_H_RANGE = USUAL.a_over_h[0], USUAL.a_over_h[-1]  # a/h of the table
DEEPEST = DEPTHS[-1]  # w/h of the table


@dataclass(frozen=True, slots=True)
class TableProfile:
    """A ProfileSource for one law and edge radius; friction comes with the case.

    Beyond the solved depth (w/h of .08 to .25, see the list of cases) the surface over the depth is continued
    linearly from its last two depths. Raises InputError off the grid of nu, a/h and w/h <= .25.
    """

    law: str = "neo-hooke"
    edge_over_h: float = EDGE_OVER_H

    def __call__(self, r_over_a: Floats, case: PunchCase, /) -> tuple[Floats, Floats]:
        """Return rise and u_r per unit of depth at r/a >= 1: of any shape; of several depths (depths, ...)."""
        for what, value, ends in (
            ("Poisson's ratio", case.poisson_ratio, POISSON_RANGE),
            ("a/h", case.a_over_h, A_OVER_H_RANGE),
            ("w/h", case.w_over_h, (0.0, DEEPEST)),
        ):
            check_within(f"the table of profiles is for {what} in", value, ends, where="TableProfile")
        if not (r_over_a >= 1).all():
            raise InputError("the profile around the punch begins at r = a", where="TableProfile")
        mixture = shipped_table().mixture(self.law, case.friction, edge_over_h=self.edge_over_h)
        rise, outward = surface_over_depth(np.asarray(r_over_a, dtype=float), case, mixture=mixture)
        return rise, outward


TABULATED = ProfileModel(
    TableProfile(),
    "finite elements: neo-Hooke, friction 0 to no slip, edge radius h/60",
    relative_error=0.03,
    frictional=True,
    poisson_range=POISSON_RANGE,
    a_over_h_range=A_OVER_H_RANGE,
    deepest=DEEPEST,
    shape_error=tuple(zip(SHAPE_PLACES, (0.01, 0.007, 0.004, 0.0025, 0.0015), strict=True)),
    single_depth_std=0.005,
)


def profile_model(poisson_ratio: float, a_over_h: float, *, deepest: float) -> ProfileModel:
    """Return the tabulated model where it holds this nu, a/h and w/h, else linear theory with its larger error."""
    wanted = (poisson_ratio, POISSON_RANGE), (a_over_h, A_OVER_H_RANGE), (deepest, (0.0, DEEPEST))
    return TABULATED if all(low <= value <= high for value, (low, high) in wanted) else LINEAR
