"""Forces on a dome: sums, symmetry, what is not measured, E by a force sensor, and maps that cannot be.

Against another library: test_against_ngsolve in this folder and benchmarks.force_curved.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.inputs.gather import _one_gel
from tactilevision.errors import InputError
from tactilevision.force.calibrated import modulus_of
from tactilevision.force.field import NO_CONTACT, NO_SHEAR, ForceField, ForceSettings
from tactilevision.force.mesh_compliance import MeshCompliance
from tactilevision.force.observe import observe
from tactilevision.profile.sensor import _check_shape
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

SCALE, SHAPE = (0.125, 0.125), (56, 56)
DOME = Gel(2.0, shape="dome", curvature_mm=(6.0, 6.0), radius_mm=4.5)
MATERIAL = Material(0.2, 0.48, np.diag([0.004**2, 0.005**2]))


@cache
def field() -> ForceField:
    return ForceField(DOME, MATERIAL, SCALE, view_px=SHAPE, settings=ForceSettings(large_depth=False))


def pressed(x_mm: float, y_mm: float, *, depth_mm: float = 0.15, std_mm: float = 0.001) -> HeightMap:
    """What a camera sees of a ball pressed along the surface's normal: a motion along its ray."""
    across, down = np.meshgrid(*(0.125 * (np.arange(n) - (n - 1) / 2) for n in SHAPE[::-1]))
    z = 6 - np.sqrt(36 - across**2 - down**2 + 0j).real
    middle = np.array([x_mm, y_mm, 6 - np.sqrt(36 - x_mm**2 - y_mm**2)])
    out = (middle - [0, 0, 6]) / 6
    away = np.stack([across, down, z], axis=-1) - middle
    along = away @ out
    off = np.sum(away**2, axis=-1) - along**2
    facing = np.sqrt(np.maximum(36 - across**2 - down**2, 1)) / 6
    noise = std_mm * np.random.default_rng(0).standard_normal(SHAPE)
    seen = np.clip(depth_mm - off / 6, 0, None) / facing + noise
    return HeightMap(seen, across**2 + down**2 < 20, SCALE, std_mm=np.full(SHAPE, std_mm))


def still() -> ShearMap:
    zero: Floats = np.zeros(SHAPE)
    return ShearMap(zero, zero, pressed(0, 0).valid, SCALE, std_mm=0.001)


def test_nodal_forces_and_their_moments_sum_to_the_wrench() -> None:
    found, made = field()(pressed(2.0, -1.0), still()), field().compliance
    assert isinstance(made, MeshCompliance)
    nodal = np.nan_to_num(found.nodal_N).reshape(3, -1)
    np.testing.assert_allclose(nodal.sum(axis=1), found.resultant_N, rtol=1e-6)
    moment = np.cross(made.surface.places_mm, nodal.T).sum(axis=0)
    np.testing.assert_allclose(moment, np.array(found.moment_Nmm), rtol=1e-6, atol=1e-9)
    assert found.patches[0].centre_mm == pytest.approx((2.0, -1.0), abs=0.15)
    covariance = np.asarray(found.covariance)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-12


def test_a_push_off_the_pole_is_normal_and_turns_with_its_place() -> None:
    right, down = (np.array(field()(pressed(*place), still()).resultant_N) for place in ((2.4, 0.0), (0.0, 2.4)))
    np.testing.assert_allclose(right[[1, 0, 2]], down, rtol=0.01, atol=2e-3)
    assert right[0] / right[2] < -0.2  # inward: the surface falls to the right
    pole = field()(pressed(0.0, 0.0), still()).resultant_N
    assert np.linalg.norm(pole) == pytest.approx(np.linalg.norm(right), rel=0.25)


def test_without_shear_the_pressure_is_known_and_friction_makes_fz_less_sure() -> None:
    height = pressed(2.4, 0.0)
    found, marked = field()(height), field()(height, still())
    assert NO_SHEAR in found.flags
    assert np.isnan(found.resultant_N[0])
    assert np.nanmax(found.pressure) == pytest.approx(np.nanmax(marked.pressure), rel=0.3)
    slope = 2.4 / np.sqrt(36 - 2.4**2)
    assert found.resultant_std_N[2] > 0.28 * slope * found.resultant_N[2]  # friction of .3 along the slope
    free = field()(pressed(0.0, 0.0, depth_mm=0.0))
    assert NO_CONTACT in free.flags
    assert 0 < free.could_hide_N < 0.1


def test_young_modulus_of_a_curved_gel_follows_from_a_force_sensor_on_its_own_mesh() -> None:
    forces = np.array(
        [field()(pressed(*place), still()).resultant_N for place in ((2.0, 0.0), (0.0, 0.0), (0.0, 1.0))]
    )
    modulus, std = modulus_of(forces, 0.2, 1.5 * forces)
    assert modulus == pytest.approx(0.3)
    assert std < 1e-9
    with pytest.raises(InputError, match="two frames"):
        modulus_of(forces * np.nan, 0.2, forces)


def test_a_dome_seen_by_a_pinhole_moves_along_its_rays_and_the_slope_of_the_border_counts() -> None:
    made, camera = field().compliance, np.array([0.0, 0.0, 15.0])[:, None, None]
    assert isinstance(made, MeshCompliance)
    x, y = np.meshgrid(*(0.125 * (np.arange(n) - (n - 1) / 2) for n in SHAPE[::-1]))

    def on_dome(x: Floats, y: Floats) -> Floats:
        return np.stack([x, y, 6 - np.sqrt(np.maximum(36 - x**2 - y**2, 1))])

    def motion(x: Floats, y: Floats) -> Floats:
        return np.asarray(np.exp(-((x - 3) ** 2 + y**2) / 3) * np.array([0.06, -0.03, 0.12])[:, None, None])

    def met(x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Where the dome lies on the camera's ray to the moved point, and how far before it, mm."""
        to = on_dome(x, y) + motion(x, y) - camera
        ray = to / (size := np.linalg.norm(to, axis=0))
        from_centre = camera - np.array([0.0, 0.0, 6.0])[:, None, None]
        half = (ray * from_centre).sum(axis=0)
        far = -half + np.sqrt(half**2 - (from_centre**2).sum(axis=0) + 36)
        return (camera + far * ray)[:2], far - size

    from_x, from_y = x, y
    for _ in range(30):
        here = met(from_x, from_y)[0]
        from_x, from_y = from_x + x - here[0], from_y + y - here[1]
    inside = x**2 + y**2 < 19
    height = HeightMap(met(from_x, from_y)[1], inside, SCALE, std_mm=np.full(SHAPE, 1e-6))
    across, down = met(x, y)[0] - np.stack([x, y])
    shear = ShearMap(across, down, inside, SCALE, std_mm=1e-6)
    grid = made.grid
    truth = made.surface.local(motion(*np.meshgrid(grid.x_mm, grid.y_mm)))
    off = []
    for seen in (replace(made.surface, camera_mm=15.0), made.surface):
        both = observe(grid, height, shear, inside=made.inside, away_mm=1.0, surface=seen)
        off.append(np.abs(both.displacement_mm - truth)[:, both.known].max())
    assert off[0] < 2e-3 < 0.01 < off[1]


def test_a_dome_that_shrinks_all_round_loses_two_depths_over_its_radius_of_area() -> None:
    made = field().compliance
    assert isinstance(made, MeshCompliance)
    shrunk = np.zeros((3, *made.inside.shape))
    shrunk[2] = 0.06
    middle = made.surface.stretch(shrunk)[4:-4, 4:-4]
    np.testing.assert_allclose(middle, -2 * 0.06 / 6, rtol=0.03)


def test_a_map_deeper_than_the_gel_or_marked_beside_it_is_refused() -> None:
    with pytest.raises(InputError, match="larger than the gel allows"):
        field()(pressed(0.0, 0.0, depth_mm=1.9))
    small = Gel(2.0, shape="dome", curvature_mm=(6.0, 6.0), radius_mm=2.5)
    beside = ForceField(small, Material(0.2, 0.48), SCALE, view_px=SHAPE)
    with pytest.raises(InputError, match="outside the gel's mesh"):
        beside(pressed(0.0, 0.0), still())


def test_a_round_gel_is_refused_where_it_is_stated_flat_or_a_law_takes_it_for_flat() -> None:
    def sensed(gel: Gel) -> Any:
        return SimpleNamespace(sensor=SimpleNamespace(gel=gel), name="own", path=Path("own"))

    with pytest.raises(InputError, match="stated as disc here, and as dome in the profile own"):
        _check_shape(sensed(Gel(2.0, shape="disc", radius_mm=4.5)), sensed(DOME))
    with pytest.raises(InputError, match="laws of a flat layer do not fit"):
        _one_gel([sensed(DOME)])
