"""Force and surface of a flat punch from the shipped table: what punch_fem would say, in microseconds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.tables.table import (
    Block,
    find_block,
    hayes_stiffness,
    profile_ratio,
    shipped_table,
    stiffness_ratio,
)
from tactilevision.records import Floats, Material

EDGE_OVER_H = 1 / 60


def punch_force(
    depth_mm: npt.ArrayLike,
    *,
    material: Material,
    radius_mm: float,
    thickness_mm: float,
    friction: float,
    law: str = "neo-hooke",
    edge_radius_mm: float | None = None,
) -> Floats:
    """Force in N of a flat punch pressed `depth_mm` (any shape) into a bonded gel on its first loading.

    P = E h w (P/E h w of Hayes at the flat part's radius) x (tabulated ratio). `friction` is Coulomb's mu, inf
    for no slip; `edge_radius_mm` None takes the tabulated one, 1/60 of the thickness. Below the first depth
    solved (.002 h) the force is proportional to depth. Assumes a pad that reaches five thicknesses from the axis.
    Raises InputError beyond the table in any direction. Source: punch_fem; errors on the card.
    """
    depths = np.asarray(depth_mm, dtype=float)
    block, alpha = _place(law, friction, radius_mm, thickness_mm, edge_radius_mm)
    if depths.size and not depths.min() >= 0:
        raise InputError("depth is 0 or more", where="punch_force", value=float(depths.min()))
    nu = material.poisson_ratio
    edge = block.edge_over_h if edge_radius_mm is None else edge_radius_mm / thickness_mm
    ratio = stiffness_ratio(block, nu, alpha, depths.ravel() / thickness_mm).reshape(depths.shape)
    force: Floats = material.youngs_modulus_MPa * thickness_mm * depths * hayes_stiffness(nu, alpha, edge) * ratio
    return force


def punch_profile(
    depth_mm: float,
    r_mm: npt.ArrayLike,
    *,
    material: Material,
    radius_mm: float,
    thickness_mm: float,
    friction: float,
    law: str = "neo-hooke",
) -> tuple[Floats, Floats]:
    """(u_z, u_r) in mm at the material radii `r_mm` beside the punch: u_z positive out of the gel, u_r outward.

    The camera sees a point at r + u_r. Validity and errors as for punch_force; r from .03 to 3.5 thicknesses
    beyond the punch's side.
    """
    block, alpha = _place(law, friction, radius_mm, thickness_mm, None)
    if not depth_mm >= 0:
        raise InputError("depth is 0 or more", where="punch_profile", value=depth_mm)
    r = np.asarray(r_mm, dtype=float)
    beside = (r.ravel() - radius_mm) / thickness_mm
    u_r, u_z = profile_ratio(block, material.poisson_ratio, alpha, depth_mm / thickness_mm, beside)
    return depth_mm * u_z.reshape(r.shape), depth_mm * u_r.reshape(r.shape)


def _place(
    law: str, friction: float, radius_mm: float, thickness_mm: float, edge_radius_mm: float | None
) -> tuple[Block, float]:
    if not (radius_mm > 0 and thickness_mm > 0):
        raise InputError(
            "radius and thickness lie above 0 mm", where="punch table", value=(radius_mm, thickness_mm)
        )
    edge = EDGE_OVER_H if edge_radius_mm is None else edge_radius_mm / thickness_mm
    block = find_block(shipped_table(), law=law, friction=friction, edge_over_h=edge, pad_over_h=float("inf"))
    return block, radius_mm / thickness_mm
