"""Laws of the reconstructed depth and slopes of presses whose depth is certified."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial.legendre import legvander

from calibration.inputs.observations import EdgeDrop, Observations, Slopes
from calibration.laws.flat_punch import STATED_NU_STD
from calibration.laws.theory import nominal_nu
from calibration.model.composition import Composable
from calibration.model.stages import Parameter, Prior, State, amplitude
from tactilevision.mechanics.profile import LIKELY_SHARE, SHARE_STD, PunchCase, friction_of_share, seen_profile
from tactilevision.mechanics.tables.punch import TABULATED, profile_model
from tactilevision.records.constants import TINY
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Gel

READ_STD_MM = 0.001  # std of a fall: camera noise in the mean over a quarter of a ring; its scale is estimated
FACE_STD = 0.02  # relative std of a face behind its walls, from press to press
MIN_MM = 4 * READ_STD_MM  # least expected fall
UNSTATED_NU_STD = 0.015  # std of nu where none is stated: silicones lie in .45 to .4999
HIGHEST_NU = 0.499  # end of the profile's table
NEAR = 0.55  # of the radius: gel falls by more there than slopes are off by; farther out only of shaded presses
MIN_PRESSES = 6  # fewer do not exceed the indenters' own errors


def with_slopes(faces: Observations) -> Observations | None:
    """Return samples of faces (one a press, the reconstructed depth as the force) and of the slopes next to them.

        seen = w (fall read)/(fall expected)

    for each ring and quarter next to a face at the certified depth w: one more depth, read over slopes as gentle
    as those of the light's calibration. The expected fall is that of the tabulated surface next to a flat punch at
    the gel's stated nu (.48 where none is stated) and the usual friction; its changes with both are kept. None
    where fewer than six presses have slopes with an expected fall.
    """
    place = {
        (int(number), label): k
        for k, (number, label) in enumerate(zip(faces.presses.recording, faces.presses.label, strict=True))
    }
    falls = _near(faces.falls, {one: float(faces.radius_mm[k]) for one, k in place.items()})
    if faces.is_curves or not falls:
        return None
    press = np.array([place[f.recording, f.press] for f in falls], dtype=np.int64)
    depth = faces.depth_mm[press]
    usual, other_nu, slippery = _expected(faces.gel, depth, faces.radius_mm[press], falls)
    sound = np.flatnonzero(usual > MIN_MM)
    if np.unique(press[sound]).size < MIN_PRESSES:
        return None
    read = np.array([f.fall_mm for f in falls])
    columns = np.array([(f.to_mm - f.from_mm, f.azimuth_deg, f.from_mm, f.gain_std, f.ball_slope) for f in falls])
    width, azimuth, begin, gain_std, ball_slope = columns.T
    outside = Slopes(
        usual / width, depth, azimuth, begin, gain_std, ball_slope, other_nu / usual - 1, slippery / usual - 1
    ).take(sound)
    seen = np.concatenate([faces.normal_N, (depth * read / usual)[sound]])
    std = np.concatenate([FACE_STD * faces.depth_mm, (depth * READ_STD_MM / usual)[sound]])
    rows = np.concatenate([np.arange(faces.count), press[sound]])
    order = np.argsort(rows, kind="stable")  # each press's face, then the slopes next to it
    unknown = np.full(faces.count, np.nan)
    slopes = Slopes(**{f.name: np.concatenate([unknown, getattr(outside, f.name)])[order] for f in fields(Slopes)})
    return replace(faces.at(rows[order]).with_force(seen[order]), slopes=slopes, force_std_N=std[order])


def _near(falls: Sequence[EdgeDrop], radius_mm: Mapping[tuple[int, str], float]) -> list[EdgeDrop]:
    """Return the falls within NEAR of the radius, and those farther out of presses that have none there."""
    here = [f for f in falls if (f.recording, f.press) in radius_mm]
    near = [f for f in here if f.to_mm <= NEAR * radius_mm[f.recording, f.press]]
    some = {(f.recording, f.press) for f in near}
    return [f for f in here if f in near or (f.recording, f.press) not in some]


def _expected(gel: Gel, depth_mm: Floats, radius_mm: Floats, falls: Sequence[EdgeDrop]) -> tuple[Floats, ...]:
    """Return expected falls (N,), those for nu plus its std, and those without friction; NaN where unknown."""
    nu = nominal_nu(gel)
    nu_std = UNSTATED_NU_STD if gel.poisson_ratio is None else gel.poisson_ratio_std or STATED_NU_STD
    friction, edges = friction_of_share(LIKELY_SHARE), np.array([(f.from_mm, f.to_mm) for f in falls])
    tables = np.full((3, len(falls)), np.nan)
    for depth, radius in set(zip(depth_mm.tolist(), radius_mm.tolist(), strict=True)):
        mine = (depth_mm == depth) & (radius_mm == radius)
        a_over_h, w_over_h = radius / gel.thickness_mm, depth / gel.thickness_mm
        model = profile_model(nu, a_over_h, deepest=w_over_h)
        if not 0 < w_over_h < model.deepest:
            continue
        for table, (of_nu, rubs) in zip(
            tables, ((nu, friction), (min(nu + nu_std, HIGHEST_NU), friction), (nu, 0.0)), strict=True
        ):
            case = PunchCase(of_nu, a_over_h, w_over_h, rubs)
            rise = seen_profile(1 + edges[mine] / radius, case, source=model.source)
            table[mine] = depth * (rise[:, 1] - rise[:, 0])
    return tuple(tables)


WALLS_PER_MM = 1.5  # slope of a face's walls per mm of depth: a wall's height over two thirds of a millimetre
WALLS_PER_MM_STD = 0.5  # its std, by pixels and blur


def wall_share(ratio: float, steep: Floats) -> Floats:
    """Return the share of a depth (N,) read where a second ceiling acts, 1/`ratio` times the method's own.

    `steep` (N,) is the walls' slope over the method's own ceiling S: a wall is read as T(steep), T(x) = tanh(x)/x.
    """
    share: Floats = read_share(np.sqrt(ratio**2 + 1.0) * steep) / read_share(steep)
    return share


def read_share(x: Floats) -> Floats:
    """Return the share tanh(x)/x (N,) that is read of slopes x (N,) times the ceiling."""
    x = np.maximum(x, TINY)
    share: Floats = np.tanh(x) / x
    return share


WALLS = 3  # terms of a face's own error over the depths
FLATTENING, LOST = "flattening", "lost_in_walls"
LOST_STD = 0.5  # std of the loss in walls, in units of a second ceiling like the method's own
MIN_RISE_STD = 0.005  # least relative std shared by all certified depths
KEPT = 8  # data sets whose tables are cached: a fit asks at every step
ZERO_STD_MM = 0.005  # std of a height map's zero, where single depths do not separate it from a gain


@dataclass(frozen=True, slots=True)
class ReconstructedDepth(Composable):
    """Law of the reconstructed depth of presses whose depth w is certified.

        seen = f(w) + z + s(w) (u_0 + u_1 x + u_2 P_2(x)),    f = w without an effect

    z is the zero of the height map and s its own std behind a punch's steep walls, which all presses of a depth
    share: u ~ N(0, 1) are errors constant, linear and quadratic in the depth (x from -1 to 1, P_2 Legendre's).
    Each slope next to a face (`with_slopes`) is one more depth: f(w) times 1 + the errors of its quarter, its
    ring, nu and the friction, each with its std.
    """

    key = "reconstructed_depth"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """Return z, then the u where the height map states a std, then the errors of the slopes."""
        curves = data.is_curves and data.slopes is None
        prior = None if curves else Prior(0.0, ZERO_STD_MM, "a height map's zero")
        table = [
            replace(amplitude("zero_mm", "mm", 0.2, "seen where nothing is pressed", ZERO_STD_MM), prior=prior)
        ]
        if _stated(data) is not None:
            wall = replace(
                amplitude("walls", "1", 8, "error of the face, in its own std", 1.0),
                prior=Prior(0.0, 1.0, "the height map's own std"),
            )
            table += [replace(wall, name=f"walls_{k}") for k in range(WALLS)]
        return (*table, *(_share(name, std) for name, std, _ in _slope_errors(data)))

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the reconstructed depth as its force."""
        stated = _stated(data)
        changes = np.array([change for *_, change in _slope_errors(data)]).reshape(-1, data.size)
        own = values[len(values) - len(changes) :]
        share = sum((value * change for value, change in zip(own, changes, strict=True)), np.zeros(data.size))
        depth = state.depth_mm
        if data.slopes is not None:
            depth = np.where(beside_face(data), data.slopes.depth_mm * depth / data.depth_mm, depth)
        seen = depth * (1 + share) + values[0] * _of_face(data)
        if stated is not None:
            along = legvander(_across(data.depth_mm), WALLS - 1).T
            seen = seen + stated * sum(
                value * one for value, one in zip(values[1 : 1 + WALLS], along, strict=True)
            )
        return replace(state, force_N=seen, stiffness_N_per_mm=np.ones(data.size))


@lru_cache(maxsize=KEPT)
def _stated(data: Observations) -> Floats | None:
    """Return the height map's std of the face (N,), mm, smooth over the depth since all presses share it.

    0 for slopes; None where a std is not known.
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
    """Return 1 for the depth of a face (N,) and 0 for a slope next to it."""
    return np.ones(data.size) if data.slopes is None else np.isnan(data.slopes.slope).astype(float)


@lru_cache(maxsize=KEPT)
def _slope_errors(data: Observations) -> list[tuple[str, float, Floats]]:
    """Return the possible errors of slopes next to a face: name, std, and change (N,) by a unit of it."""
    slopes = data.slopes
    if slopes is None:
        return []
    azimuths, rise = np.unique(slopes.azimuth_deg[beside_face(data)]), max(data.shared.rise, MIN_RISE_STD)
    gain, flattened = float(np.nanmedian(slopes.gain_std)), (slopes.slope / slopes.ball_slope) ** 2 / 3
    # the light's error varies smoothly over the picture: most of it is shared by the quarters, whose mean has
    # `gain`
    changes: list[tuple[str, float, Floats | Bools]] = [("light", float(np.sqrt(0.75)) * gain, beside_face(data))]
    changes += [(f"quarter_{azimuth:.0f}", gain, slopes.azimuth_deg == azimuth) for azimuth in azimuths]
    changes += [
        (f"ring_{begin:.2f}", TABULATED.relative_error, slopes.from_mm == begin)
        for begin in np.unique(slopes.from_mm[beside_face(data)])
    ]
    # each indenter has its own height, and its own depth at which the table errs
    kind, half = data.presses.indenter[data.press], 0.5 * TABULATED.relative_error
    changes += [(f"indenter_{k}", half, beside_face(data) & (kind == k)) for k in np.unique(kind)]
    changes += [(f"face_{k}", TABULATED.relative_error, _of_face(data) * (kind == k)) for k in np.unique(kind)]
    walls = wall_share(1.0, WALLS_PER_MM * data.depth_mm / np.nanmedian(slopes.ball_slope))
    changes += [  # flattening by the method's own ceiling, the steepest slope of the light's calibration
        (FLATTENING, 1.0, -np.nan_to_num(flattened)),
        (LOST, LOST_STD, _of_face(data) * (walls - 1)),
        ("certificate", rise, np.ones(data.size)),
        ("profile_nu", 1.0, np.nan_to_num(slopes.nu_change)),
        ("profile_friction", SHARE_STD, np.nan_to_num(slopes.friction_change)),
    ]
    return [(name, std, np.asarray(change, dtype=float)) for name, std, change in changes]


@lru_cache(maxsize=KEPT)
def beside_face(data: Observations) -> Bools:
    """Return whether a sample (N,) is a slope next to a face, read as a depth in mm."""
    return np.asarray(_of_face(data) == 0)


def _share(name: str, std: float) -> Parameter:
    least = 0.0 if name in (FLATTENING, LOST) else -8 * std  # steep slopes are never read steeper than they are
    prior = Prior(0.0, std, "the method's card and the tabulated surface")
    return Parameter(name, "1", 0.0, (least, 8 * std), "error of the slopes next to the face", std, prior)


def _across(depth_mm: Floats) -> Floats:
    low, high = float(depth_mm.min()), float(depth_mm.max())
    return np.asarray(2 * (depth_mm - low) / (high - low) - 1 if high > low else np.zeros(depth_mm.size))
