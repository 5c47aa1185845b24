"""The surface beside a flat punch with friction and finite deformation: linear theory plus a tabulated correction.

    rise, u_r (per unit of depth) = exact_profile + d0 + d1 (w/h) + d2 (w/h)^2,    d_k (r; nu, a/h, friction)

The corrections d_k come from finite elements (mechanics/punch_fem: neo-Hooke, punch with an edge radius of .02 a
in true contact, pad of radius 5 h with a free side), minus the exact linear profile of the same case. What is left
is small and smooth: polynomials in nu and a/h, and between no friction and mu = .3, beyond which friction changes
no more than a few parts in ten thousand of the depth.

Range: nu in [.40, .4999] (solved to .497), a/h in [.6, 1.1], w/h up to .21; InputError beyond. From r = a + 3.6 h
outward, where a correction of some .003 is left, it fades with exp(-r/h), as the profile itself does. Solved to
w/h = .125 and continued by the quadratic from there: where finite elements went on to .2, it is met within .002 of
the depth with friction, from .6 mm beside the edge on; without friction within .006, and .014 at w/h = .2. A fresh
solution between the nodes (nu .475, a/h .75, friction .3) is met within .002 from h/4 beside the edge on, and .005
nearer. A sharp edge raises the profile by some 2 %, another solver lies 2 % below, a pad of another radius moves
it by less than 2 % (R > 4 h): this is the model's relative error.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.errors import InputError
from tactilevision.mechanics.profile import (
    FULL_FRICTION,
    ProfileModel,
    PunchCase,
    exact_profile,
    friction_share,
    linear_profile,
)
from tactilevision.records import Floats, Material

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

TABLE = Path(__file__).with_name("profile_table.npz")
POISSON_NODES = (0.40, 0.44, 0.465, 0.485, 0.497)
A_OVER_H_NODES = (0.6, 2.5 / 3, 1.1)
DEPTHS = (0.02, 0.05, 0.075, 0.1, 0.125)  # w/h of the finite element solutions
DEEPEST = 0.21
REACH = 3.6  # thicknesses from the punch's edge
S_GRID = np.linspace(0, np.sqrt(REACH), 61)  # sqrt((r - a)/h), as in profile.py
PAD_RADIUS, EDGE_RADIUS, THICKNESS_MM = 5.0, 0.02, 3.0


@dataclass(frozen=True, slots=True)
class FemProfile:
    """Finite elements: `r_mm` (n,) of the surface's nodes; `w_over_h` (m,) and the force over Young's modulus;
    `rise` and `outward` displacement over the depth, (m, n) each."""

    r_mm: Floats
    w_over_h: Floats
    force_over_E_mm2: Floats
    rise: Floats
    outward: Floats


def table_profile(r_over_a: Floats, case: PunchCase, /) -> tuple[Floats, Floats]:
    """A ProfileSource: rise and u_r per unit of depth at r/a >= 1 (any shape). InputError outside the range."""
    _check(case)
    beyond = (r_over_a - 1) * case.a_over_h  # thicknesses from the punch's edge
    if not (beyond >= 0).all():
        raise InputError("the profile beside the punch begins at r = a", where="table_profile")
    rise, outward = linear_profile(r_over_a, case)
    fading = np.exp(-np.maximum(beyond - REACH, 0))[..., None]
    correction = fading * _correction(case)(np.sqrt(np.minimum(beyond, REACH)))
    return rise + correction[..., 0], outward + correction[..., 1]


TABULATED = ProfileModel(
    table_profile,
    "finite elements: neo-Hooke, friction 0 to stick, edge radius .02 a",
    relative_error=0.03,
    frictional=True,
    poisson_range=(POISSON_NODES[0], 0.4999),
    a_over_h_range=(A_OVER_H_NODES[0], A_OVER_H_NODES[-1]),
    deepest=DEEPEST,
    shape_error=((0.1, 0.01), (0.25, 0.007), (0.5, 0.004), (0.9, 0.0025), (1.6, 0.0015)),
    single_depth_std=0.005,
)


def solve_case(poisson_ratio: float, a_over_h: float, friction: float) -> FemProfile:
    """The finite element solution behind one entry of the table; some ten seconds."""
    from tactilevision.mechanics.punch_fem.contact import RoundedPunch
    from tactilevision.mechanics.punch_fem.march import march
    from tactilevision.mechanics.punch_fem.newton import equations
    from tactilevision.mechanics.punch_fem.problem import PunchProblem, build

    h = THICKNESS_MM
    punch = RoundedPunch(a_over_h * h, EDGE_RADIUS * a_over_h * h, friction)
    model = build(PunchProblem(Material(1.0, poisson_ratio), punch, h, PAD_RADIUS * h))
    r, z = model.mesh.nodes_mm.T
    top = np.flatnonzero(z > h * (1 - 1e-9))
    top = top[np.argsort(r[top])]
    states = list(march(equations(model, by_force=False), [w * h for w in DEPTHS], []))
    rise, outward = (np.array([s.u[2 * top + row] / s.depth_mm for s in states]) for row in (1, 0))
    return FemProfile(r[top], np.array(DEPTHS), np.array([s.force_N for s in states]), rise, outward)


def correction_of(solution: FemProfile, poisson_ratio: float, a_over_h: float) -> Floats:
    """(3, len(S_GRID), 2): d0, d1, d2 of rise and u_r by least squares over the depths."""
    from scipy.interpolate import CubicSpline

    r = (a_over_h + S_GRID**2) * THICKNESS_MM
    linear = np.stack(exact_profile(r / (a_over_h * THICKNESS_MM), poisson_ratio, a_over_h), axis=-1)
    found = np.stack(
        [CubicSpline(solution.r_mm, part, axis=1)(r) for part in (solution.rise, solution.outward)], -1
    )
    powers = np.vander(solution.w_over_h, 3, increasing=True)
    excess = (found - linear).reshape(len(powers), -1)
    return np.asarray(np.linalg.lstsq(powers, excess, rcond=None)[0].reshape(3, len(r), 2))


def write_table(corrections: Floats, path: Path = TABLE) -> None:
    """Write corrections (nu, a/h, frictionless or full, 3, s, 2) with their card."""
    from tactilevision.files import replacing, write_json

    rounded = corrections.astype("<f4")
    with replacing(path) as temporary:
        np.savez_compressed(temporary, corrections=rounded)
    write_json(path.with_suffix(".json"), {
        "what": "d0, d1, d2 of rise and u_r over the depth, beyond linear theory, on s = sqrt((r - a)/h)",
        "axes": {"poisson_ratio": POISSON_NODES, "a_over_h": A_OVER_H_NODES, "friction": [0.0, FULL_FRICTION],
                 "power_of_w_over_h": [0, 1, 2], "s": S_GRID, "field": ["rise", "u_r"]},
        "source": "mechanics/punch_fem: neo-Hooke, penalty contact, default mesh",
        "settings": {"edge_radius_over_a": EDGE_RADIUS, "pad_radius_over_h": PAD_RADIUS, "w_over_h": DEPTHS},
        "made_by": "tactilevision.mechanics.profile_table: solve_case, correction_of, write_table",
        "held_out_error": "within .002 of the depth from h/4 beside the edge (nu .475, a/h .75, friction .3)",
        "licence": "MIT",
        "sha256": hashlib.sha256(rounded.tobytes()).hexdigest(),
    })  # fmt: skip


def _check(case: PunchCase) -> None:
    for what, value, low, high in (
        ("Poisson's ratio", case.poisson_ratio, POISSON_NODES[0], 0.4999),
        ("a/h", case.a_over_h, A_OVER_H_NODES[0], A_OVER_H_NODES[-1]),
        ("w/h", case.w_over_h, 0.0, DEEPEST),
    ):
        if not low - 1e-9 <= value <= high + 1e-9:
            raise InputError(f"the table of profiles has {what} in [{low:g}, {high:g}]", where="table_profile",
                             value=value)  # fmt: skip


@lru_cache(maxsize=1)
def _table() -> Floats:
    with np.load(TABLE, allow_pickle=False) as content:
        corrections = content["corrections"]
    card = json.loads(TABLE.with_suffix(".json").read_text(encoding="utf-8"))
    if hashlib.sha256(corrections.tobytes()).hexdigest() != card["sha256"]:
        raise InputError("the table differs from its card", where=TABLE, remedy="Reinstall tactilevision.")
    return np.asarray(corrections, dtype=float)


def _correction(case: PunchCase) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    share = friction_share(case.friction)
    powers = case.w_over_h ** np.arange(3)
    values = np.einsum(
        "nafksc,n,a,f,k->sc",
        _table(),
        _lagrange(POISSON_NODES, case.poisson_ratio),
        _lagrange(A_OVER_H_NODES, case.a_over_h),
        np.array([1 - share, share]),
        powers,
        optimize=True,
    )
    return CubicSpline(S_GRID, values)


def _lagrange(nodes: Sequence[float], at: float) -> Floats:
    """Weights of the polynomial through `nodes` at one place."""
    x = np.array(nodes)
    return np.array([np.prod((at - np.delete(x, i)) / (x[i] - np.delete(x, i))) for i in range(len(x))])
