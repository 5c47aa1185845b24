"""How much softer a punch finds the gel near the pad's free side than on a wide layer.

    c(d) = c(infinity) (1 - s),    s = s(d/h; nu, a/h),    d = distance from the punch's edge to the pad's rim.

Tabulated from linear finite elements (mechanics/punch_fem: frictionless sharp punch, pad bonded to its base, side
free) on concentric discs; ln s is interpolated. s falls by a factor of 3 to 6 with each thickness: at nu = .48,
a/h = .83 it is 9 % at d = h, 2 % at 2 h, .1 % at 4 h. Range: d/h from .25 (beyond 5, where s < 5e-4, it is
extended by the last decay), nu in [.30, .499], a/h in [.4, 1.5]; InputError outside. Between nodes
it is within 15 % of s.

Off the centre of the pad the rim is nearer on one side: `off_centre_softening` averages s over the directions.
That is first order in s, an estimate to be checked by presses at several places where it exceeds a few per cent.
"""

from __future__ import annotations

import hashlib
import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.material import positive
from tactilevision.records import Floats, Material, Pair

TABLE = Path(__file__).with_name("boundary_table.npz")
DISTANCES = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)  # d/h
POISSON_NODES = (0.3, 0.45, 0.48, 0.499)
A_OVER_H_NODES = (0.4, 2.5 / 3, 1.5)
FAR = 12.0  # d/h that stands for infinity
DIRECTIONS = 180


def softening(
    distance_mm: npt.ArrayLike, *, radius_mm: float, thickness_mm: float, poisson_ratio: float
) -> Floats:
    """s (any shape) for a punch in the middle of a disc whose rim is `distance_mm` from the punch's edge."""
    d = positive("distance_mm", distance_mm) / float(positive("thickness_mm", thickness_mm))
    alpha = float(positive("radius_mm", radius_mm)) / thickness_mm
    for what, low, high, value in (
        ("the rim lies", DISTANCES[0], np.inf, float(d.min())),
        ("Poisson's ratio lies", POISSON_NODES[0], POISSON_NODES[-1], poisson_ratio),
        ("a/h lies", A_OVER_H_NODES[0], A_OVER_H_NODES[-1], alpha),
    ):
        if not low - 1e-9 <= value <= high + 1e-9:
            raise InputError(f"the table of softening has where {what} in [{low:g}, {high:g}]", where="softening",
                             value=value)  # fmt: skip
    along = np.tensordot(_weights(A_OVER_H_NODES, alpha), _table(), 1)
    line = np.tensordot(_weights(POISSON_NODES, poisson_ratio), along, 1)
    nodes = np.array(DISTANCES)
    decay = (line[-1] - line[-2]) / (nodes[-1] - nodes[-2])
    beyond = line[-1] + decay * (d - nodes[-1])
    return np.asarray(np.exp(np.where(d > nodes[-1], beyond, np.interp(d, nodes, line))))


def off_centre_softening(
    place_mm: Pair, *, pad_radius_mm: float, radius_mm: float, thickness_mm: float, poisson_ratio: float
) -> float:
    """Mean of s over all directions from a punch at `place_mm` (x, y from the pad's centre) to a disc's rim."""
    away = float(np.hypot(*place_mm))
    angle = (np.arange(DIRECTIONS) + 0.5) * (2 * np.pi / DIRECTIONS)
    inside = pad_radius_mm**2 - (away * np.sin(angle)) ** 2
    if not (away + radius_mm < pad_radius_mm and (inside > 0).all()):
        raise InputError("the punch lies on the pad", where="off_centre_softening", value=place_mm)
    rim = np.sqrt(inside) - away * np.cos(angle)
    part = softening(rim - radius_mm, radius_mm=radius_mm, thickness_mm=thickness_mm, poisson_ratio=poisson_ratio)
    return float(part.mean())


def write_table(path: Path = TABLE) -> None:
    """Solve the 120 linear problems behind the table and write it with its card; half a minute."""
    from tactilevision.files import replacing, write_json

    distances = (*DISTANCES, FAR)
    stiffness = np.array(
        [[[_stiffness(nu, a, d) for d in distances] for nu in POISSON_NODES] for a in A_OVER_H_NODES]
    )
    table = np.log(1 - stiffness[..., :-1] / stiffness[..., -1:])
    with replacing(path) as temporary:
        np.savez(temporary, log_softening=table)
    write_json(path.with_suffix(".json"), {
        "what": "ln s, s the loss of a punch's stiffness to a free side at d/h from its edge, by a/h, nu, d/h",
        "axes": {"a_over_h": A_OVER_H_NODES, "poisson_ratio": POISSON_NODES, "d_over_h": DISTANCES},
        "source": "mechanics/punch_fem, linear: glued sliding face, depth 1e-4 mm, default mesh",
        "made_by": "tactilevision.mechanics.boundary.write_table",
        "licence": "MIT",
        "sha256": _fingerprint(table),
    })  # fmt: skip


def _stiffness(poisson_ratio: float, a_over_h: float, d_over_h: float) -> float:
    from tactilevision.mechanics.punch_fem.march import march
    from tactilevision.mechanics.punch_fem.newton import equations
    from tactilevision.mechanics.punch_fem.problem import GluedFace, PunchProblem, build

    face = GluedFace(3 * a_over_h, slides=True)
    model = build(PunchProblem(Material(1.0, poisson_ratio), face, 3.0, 3 * (a_over_h + d_over_h)))
    (state,) = march(equations(model, by_force=False), [1e-4], [])
    return state.force_N / state.depth_mm


@lru_cache(maxsize=1)
def _table() -> Floats:
    with np.load(TABLE, allow_pickle=False) as content:
        table = content["log_softening"]
    card = json.loads(TABLE.with_suffix(".json").read_text(encoding="utf-8"))
    if _fingerprint(table) != card["sha256"]:
        raise InputError("the table differs from its card", where=TABLE, remedy="Reinstall tactilevision.")
    return np.asarray(table, dtype=float)


def _fingerprint(table: Floats) -> str:
    return hashlib.sha256(np.ascontiguousarray(table, dtype="<f8").tobytes()).hexdigest()


def _weights(nodes: tuple[float, ...], at: float) -> Floats:
    """Linear interpolation as weights: the tables are nearly straight between nodes, and must not overshoot."""
    return np.array([np.interp(at, nodes, row) for row in np.eye(len(nodes))])
