"""The tabulated surface beside a punch as a ProfileModel: what the fits of nu and the certificate read.

The mechanics under test reads this table; every simulated gel is solved anew at its own friction and edge radius
(synthetic/profile.py), so that no error of the table cancels there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.profile import LINEAR, ProfileModel, PunchCase
from tactilevision.mechanics.tables.punch import surface_over_depth
from tactilevision.mechanics.tables.table import shipped_table
from tactilevision.records import Floats

EDGE_OVER_H = 1 / 60  # edge radius of the table's punch over h
POISSON_RANGE = (0.3, 0.4999)  # Poisson's ratio of the table
A_OVER_H_RANGE = (0.2, 1.5)  # a/h of the table
DEEPEST = 0.25  # w/h of the table


@dataclass(frozen=True, slots=True)
class TableProfile:
    """A ProfileSource for one law and edge radius; friction comes with the case.

    Deeper than the solver got (w/h of .08 to .25, see the list of cases) the surface over the depth goes on along
    the straight line of its last two depths. Raises InputError off the grid of nu, a/h and w/h <= .25.
    """

    law: str = "neo-hooke"
    edge_over_h: float = EDGE_OVER_H

    def __call__(self, r_over_a: Floats, case: PunchCase, /) -> tuple[Floats, Floats]:
        """Rise and u_r per unit of depth at r/a >= 1 (any shape)."""
        for what, value, (low, high) in (
            ("Poisson's ratio", case.poisson_ratio, POISSON_RANGE),
            ("a/h", case.a_over_h, A_OVER_H_RANGE),
            ("w/h", case.w_over_h, (0.0, DEEPEST)),
        ):
            if not low - 1e-9 <= value <= high + 1e-9:
                raise InputError(
                    f"the table of profiles has {what} in [{low:g}, {high:g}]", where="TableProfile", value=value
                )
        if not (r_over_a >= 1).all():
            raise InputError("the profile beside the punch begins at r = a", where="TableProfile")
        mixture = shipped_table().mixture(self.law, case.friction, edge_over_h=self.edge_over_h)
        (rise, outward), _ = surface_over_depth(np.asarray(r_over_a, dtype=float), case, mixture=mixture)
        return rise, outward


TABULATED = ProfileModel(
    TableProfile(),
    "finite elements: neo-Hooke, friction 0 to no slip, edge radius h/60",
    relative_error=0.03,
    frictional=True,
    poisson_range=POISSON_RANGE,
    a_over_h_range=A_OVER_H_RANGE,
    deepest=DEEPEST,
    shape_error=((0.1, 0.01), (0.25, 0.007), (0.5, 0.004), (0.9, 0.0025), (1.6, 0.0015)),
    single_depth_std=0.005,
)


def profile_model(poisson_ratio: float, a_over_h: float, *, deepest: float) -> ProfileModel:
    """The tabulated model where it holds this nu, a/h and w/h; linear theory, with its larger error, elsewhere."""
    wanted = (poisson_ratio, POISSON_RANGE), (a_over_h, A_OVER_H_RANGE), (deepest, (0.0, DEEPEST))
    return TABULATED if all(low <= value <= high for value, (low, high) in wanted) else LINEAR
