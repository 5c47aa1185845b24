"""What a picture reads of the gel beside the faces, held against certified depths: slopes, by place and azimuth.

    seen = w (fall read)/(fall expected)

for each ring and quarter beside a face at the certified depth w: a depth of its own, right where the light is, and
read over slopes as gentle as those that the light was made from. What is expected is the tabulated surface beside
a flat punch at the gel's stated nu (.48 where none is) and the usual friction; how it changes with both is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from calibration.inputs.observations import EdgeDrop, Observations, Slopes
from calibration.laws.flat_punch import NOMINAL_NU, STATED_NU_STD
from tactilevision.mechanics.profile import LIKELY_SHARE, PunchCase, friction_of_share, seen_profile
from tactilevision.mechanics.tables.profile import profile_model
from tactilevision.records import Floats, Gel

READ_STD_MM = 0.001  # of a fall: the camera's noise in the mean over a quarter of a ring; its scale is estimated
FACE_STD = 0.02  # of a face behind its walls, relative, from press to press
MIN_MM = 0.004  # of an expected fall: below it a micron is a quarter
UNSTATED_NU_STD = 0.015  # of nu where none is stated: silicones lie in .45 to .4999
HIGHEST_NU = 0.499  # where the profile's table ends
MIN_PRESSES = 6  # fewer leave too little beside what each indenter may be off by


def with_slopes(faces: Observations) -> Observations | None:
    """Samples of faces (one a press, what was seen in the force's place) and of the slopes beside them.

    None where fewer than six presses have slopes beside them that can be expected.
    """
    place = {
        (int(number), label): k
        for k, (number, label) in enumerate(zip(faces.presses.recording, faces.presses.label, strict=True))
    }
    falls = [f for f in faces.falls if (f.recording, f.press) in place]
    if faces.is_curves or not falls:
        return None
    press = np.array([place[f.recording, f.press] for f in falls], dtype=np.int64)
    depth = faces.depth_mm[press]
    usual, other_nu, slippery = _expected(faces.gel, depth, faces.radius_mm[press], falls)
    sound = np.flatnonzero(usual > MIN_MM)
    if np.unique(press[sound]).size < MIN_PRESSES:
        return None
    read = np.array([f.fall_mm for f in falls])
    told = np.array([(f.to_mm - f.from_mm, f.azimuth_deg, f.from_mm, f.gain_std, f.ball_slope) for f in falls])
    width, azimuth, begin, gain_std, ball_slope = told.T
    beside = Slopes(
        usual / width, depth, azimuth, begin, gain_std, ball_slope, other_nu / usual - 1, slippery / usual - 1
    ).take(sound)
    seen = np.concatenate([faces.normal_N, (depth * read / usual)[sound]])
    std = np.concatenate([FACE_STD * faces.depth_mm, (depth * READ_STD_MM / usual)[sound]])
    rows = np.concatenate([np.arange(faces.count), press[sound]])
    order = np.argsort(rows, kind="stable")  # each press's face, then what is beside it
    unknown = np.full(faces.count, np.nan)
    slopes = Slopes(**{f.name: np.concatenate([unknown, getattr(beside, f.name)])[order] for f in fields(Slopes)})
    return replace(faces.at(rows[order]).with_force(seen[order]), slopes=slopes, force_std_N=std[order])


def _expected(gel: Gel, depth_mm: Floats, radius_mm: Floats, falls: Sequence[EdgeDrop]) -> tuple[Floats, ...]:
    """Expected falls (N,), those for a std more of nu, and those without friction; NaN where none is known."""
    nu = NOMINAL_NU if gel.poisson_ratio is None else gel.poisson_ratio
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
