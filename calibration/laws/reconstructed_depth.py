"""The law of what a picture reads of depths that are certified: the same, but for what it may be off by.

    seen = f(w) + z + s(w) (u_0 + u_1 x + u_2 P_2(x)),    f = w where nothing is wrong

w the certified depth, z the zero of the height map, s its own std behind a punch's steep walls, which all presses
of a depth share: u ~ N(0, 1) let it be off by that much, alike, growing or bent over the depths (x from -1 to 1,
P_2 Legendre's). Where slopes beside the faces were read (slopes_beside_face.py), each is a depth of its own
too: f(w) times 1 + what its quarter of directions, its ring, nu and the friction may be off by, each with its std.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legval

from calibration.inputs.observations import Observations
from calibration.laws.theory.wall_ceiling import WALLS_PER_MM, of_walls
from calibration.model.composition import Composable
from calibration.model.parameters import Parameter, Prior
from calibration.model.stages import State
from tactilevision.mechanics.profile import SHARE_STD
from tactilevision.mechanics.tables.profile import TABULATED
from tactilevision.records import Bools, Floats

WALLS = 3  # terms of a face's own error over the depths
FLATTENING, LOST = "flattening", "lost_in_walls"
LOST_STD = 0.5  # of what a second ceiling like the method's own would take off a face
MIN_RISE_STD = 0.005  # of what certified depths have wrong alike, relative
KEPT = 8  # data sets of which the law's tables are kept: a fit asks at every step
ZERO_STD_MM = 0.005  # of a height map's zero, where single depths cannot tell it from a gain


@dataclass(frozen=True, slots=True)
class ReconstructedDepth(Composable):
    """The law: what is seen is what was certified, but for a zero and what the height map says of itself."""

    @property
    def key(self) -> str:
        """The name in a model."""
        return "reconstructed_depth"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """z, then the u where the height map states a std, then what slopes beside may be off by."""
        curves = data.is_curves and data.slopes is None
        prior = None if curves else Prior(0.0, ZERO_STD_MM, "a height map's zero")
        table = [Parameter("zero_mm", "mm", 0.0, (-0.2, 0.2), "seen where nothing is pressed", 0.005, prior)]
        if _stated(data) is not None:
            table += [Parameter(f"walls_{k}", "1", 0.0, (-8.0, 8.0), "error of the face, in its own std", 1.0,
                                Prior(0.0, 1.0, "the height map's own std")) for k in range(WALLS)]  # fmt: skip
        return (*table, *(_share(name, std) for name, std, _ in _open(data)))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """The seen depth in the force's place."""
        stated, beside = _stated(data), _changes(data)
        share = np.sum(values[values.size - len(beside) :, None] * beside, axis=0)
        depth = state.depth_mm
        if data.slopes is not None:
            depth = np.where(beside_face(data), data.slopes.depth_mm * depth / data.depth_mm, depth)
        seen = depth * (1 + share) + values[0] * _of_face(data)
        if stated is not None:
            seen = seen + stated * legval(_across(data.depth_mm), values[1 : 1 + WALLS])
        return replace(state, force_N=seen, stiffness_N_per_mm=np.ones(data.size))


@lru_cache(maxsize=KEPT)
def _stated(data: Observations) -> Floats | None:
    """The height map's own std of the face (N,), where it is known throughout; smooth over the depth, since all
    presses share it. 0 for the slopes beside.
    """
    std = data.reconstructed_std_mm
    if std is None or not (np.isfinite(std).all() and (std > 0).all()):
        return None
    degree = 1 if np.ptp(data.depth_mm) > 0.1 * np.max(data.depth_mm) else 0
    line = np.polynomial.Polynomial.fit(data.depth_mm, std / data.depth_mm, degree)
    stated = data.depth_mm * np.maximum(line(data.depth_mm), 0.5 * np.min(std / data.depth_mm))
    return np.asarray(stated * _of_face(data))


@lru_cache(maxsize=KEPT)
def _of_face(data: Observations) -> Floats:
    """1 for the depth of a face (N,), mm, 0 for a slope beside it."""
    return np.ones(data.size) if data.slopes is None else np.isnan(data.slopes.slope).astype(float)


@lru_cache(maxsize=KEPT)
def _open(data: Observations) -> list[tuple[str, float, Floats]]:
    """What slopes beside a face may be off by besides: a name, its std, and what one of it changes (N,)."""
    slopes = data.slopes
    if slopes is None:
        return []
    azimuths, rise = np.unique(slopes.azimuth_deg[beside_face(data)]), max(data.shared.rise, MIN_RISE_STD)
    gain, flattened = float(np.nanmedian(slopes.gain_std)), (slopes.slope / slopes.ball_slope) ** 2 / 3
    # a light's law errs smoothly over the picture: quarters err alike for the most part, their mean by `gain`
    changes: list[tuple[str, float, Floats | Bools]] = [("light", float(np.sqrt(0.75)) * gain, beside_face(data))]
    changes += [(f"quarter_{azimuth:.0f}", gain, slopes.azimuth_deg == azimuth) for azimuth in azimuths]
    changes += [
        (f"ring_{begin:.2f}", TABULATED.relative_error, slopes.from_mm == begin)
        for begin in np.unique(slopes.from_mm[beside_face(data)])
    ]
    # each indenter has its height, and a depth at which the table has an error of its own
    kind, half = data.presses.indenter[data.press], 0.5 * TABULATED.relative_error
    changes += [(f"indenter_{k}", half, beside_face(data) & (kind == k)) for k in np.unique(kind)]
    changes += [(f"face_{k}", TABULATED.relative_error, _of_face(data) * (kind == k)) for k in np.unique(kind)]
    walls = of_walls(1.0, WALLS_PER_MM * data.depth_mm / np.nanmedian(slopes.ball_slope))
    # the method's own: a ceiling at the steepest slope that the light was made from
    changes += [
        (FLATTENING, 1.0, -np.nan_to_num(flattened)),
        (LOST, LOST_STD, _of_face(data) * (walls - 1)),
        ("certificate", rise, np.ones(data.size)),
        ("profile_nu", 1.0, np.nan_to_num(slopes.nu_change)),
        ("profile_friction", SHARE_STD, np.nan_to_num(slopes.friction_change)),
    ]
    return [(name, std, np.asarray(change, dtype=float)) for name, std, change in changes]


@lru_cache(maxsize=KEPT)
def beside_face(data: Observations) -> Bools:
    """Whether a sample (N,) is a slope beside a face, read as a depth in mm."""
    return np.asarray(_of_face(data) == 0)


@lru_cache(maxsize=KEPT)
def _changes(data: Observations) -> Floats:
    """What one of each of those changes, (k, N)."""
    return np.array([change for *_, change in _open(data)]).reshape(-1, data.size)


def _share(name: str, std: float) -> Parameter:
    least = 0.0 if name in (FLATTENING, LOST) else -8 * std  # no method reads steep slopes steeper than they are
    return Parameter(
        name,
        "1",
        0.0,
        (least, 8 * std),
        "what slopes beside the face may be off by",
        std,
        Prior(0.0, std, "the method's card and the tabulated surface"),
    )


def _across(depth_mm: Floats) -> Floats:
    low, high = float(depth_mm.min()), float(depth_mm.max())
    return np.asarray(2 * (depth_mm - low) / (high - low) - 1 if high > low else np.zeros(depth_mm.size))
