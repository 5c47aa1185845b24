"""c of each of several radii is its own points' line, also where friction and edges bend the common law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_recordings import points_of

from calibration.inputs.observations import Measured
from calibration.tasks.calibrate import calibrate
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.tables.punch import punch_force
from tactilevision.records.measured import Material
from tactilevision.records.rig import Gel

THICK, GEL = 3.0, Material(0.2, 0.48)
DEPTH = np.linspace(0.08, 0.4, 6)
STD_N = 0.001


def of_radii(friction: float, seed: int, counts: dict[float, int]) -> tuple[Measured, dict[float, float]]:
    """Finite elements of punches with an edge of .05 mm, and where each one's noiseless line begins."""
    rng = np.random.default_rng(seed)
    points, indenters, begins = [], {}, {}
    for radius, count in counts.items():
        depth = DEPTH[-count:]
        force = punch_force(depth, FlatContact(radius, 0.05, THICK, friction), material=GEL)
        begins[radius] = float(np.polyfit(depth / THICK, force / depth, 1)[1]) if count > 1 else np.nan
        one = points_of(depth, force + STD_N * rng.standard_normal(count), radius_mm=radius, gel=Gel(THICK))
        name = f"R{radius:g}"
        points += [replace(p, press=f"{name}-{p.press}", indenter=name) for p in one.points]
        indenters[name] = replace(one.recording.indenters["A"], name=name)
    recording = replace(one.recording, indenters=indenters)
    return replace(one, recording=recording, points=tuple(points)), begins


@pytest.mark.parametrize("friction", [0.0, 0.3, np.inf])
def test_each_radius_has_the_line_of_its_own_points(friction: float) -> None:
    measured, begins = of_radii(friction, 12, {1.5: 6, 2.5: 6, 4.0: 6})
    result = calibrate(measured, test=False)
    for radius, c, beta in result.by_radius:
        low, high = c.interval95 or (0, 0)
        assert low < begins[radius] < high
        assert high - low < 0.08 * begins[radius]
        assert beta.value is not None
    main = next(line for line in result.by_radius if line[1] is result.c)
    assert main[2] is result.beta


def test_a_radius_of_one_depth_is_left_out_by_name() -> None:
    measured, begins = of_radii(0.3, 13, {1.5: 1, 2.5: 6, 4.0: 6})
    result = calibrate(measured, test=False)
    assert [radius for radius, _, _ in result.by_radius] == [2.5, 4.0]
    assert any("radius 1.5 mm are excluded" in warning for warning in result.warnings)
    low, high = result.c.interval95 or (0, 0)
    assert low < begins[2.5] < high
