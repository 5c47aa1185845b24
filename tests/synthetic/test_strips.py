"""Cast shadows of strip lamps: where geometry puts them, and as Mitsuba draws them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from benchmarks.rendered.compare import Pictured, darkened, diffuse_rig, rms
from tactilevision.records.measured import Floats, Pair
from tactilevision.synthetic.camera import CameraOptions, build_camera
from tactilevision.synthetic.gel import Area, Flat, Grid, Prescribed, Singles, Surface, lookup
from tactilevision.synthetic.lights import Strip, visibility

KEPT = Path(__file__).parents[1] / "data" / "rendered" / "direct_light.npz"
AXIS = np.linspace(-6.0, 6.0, 201)  # .06 mm
GRID = Grid(AXIS, np.linspace(-3.0, 3.0, 101))


def lamp(elevation_deg: float, *, width_mm: float = 0.2) -> Strip:
    """A long strip far to the left."""
    out = 200.0
    centre = (-out, 0.0, out * np.tan(np.deg2rad(elevation_deg)))
    return Strip(centre, (0.0, 0.0, 0.0), 2.0, width_mm, brightness=1.0, colour=(1.0, 0.0, 0.0))


def block(height_mm: float) -> Prescribed:
    """A plateau over the left half, which ends at x = 0 in one pixel."""
    return Prescribed(np.tile(np.where(AXIS <= 0, height_mm, 0.0), (GRID.y_mm.size, 1)), GRID)


@pytest.mark.parametrize("elevation_deg", [15.0, 25.0, 35.0])
def test_a_shadow_ends_where_the_lamp_rises_over_the_edge(elevation_deg: float) -> None:
    (share,) = visibility([lamp(elevation_deg)], block(0.5), GRID)
    reach = 0.5 / np.tan(np.deg2rad(elevation_deg))
    x, row = AXIS, share[50]
    half = float(np.interp(0.5, row[x > 0.1], x[x > 0.1]))
    assert half == pytest.approx(reach, abs=0.06)
    assert row[(x > 0.1) & (x < 0.8 * reach)].max() == 0.0
    assert row[x < -0.1].min() == 1.0
    assert row[x > 1.2 * reach + 0.1].min() == 1.0


def test_a_penumbra_is_as_wide_as_the_lamp_is_seen_from_the_edge() -> None:
    height, width = 0.5, 20.0
    source = lamp(25.0, width_mm=width)
    (share,) = visibility([source], block(height), GRID)
    _, upper = source.points()
    tangents = [(source.centre_mm[2] + sign * upper[2]) / (200.0 - sign * upper[0]) for sign in (1, -1)]
    row, beyond = share[50], AXIS > 0.1
    low, high = (float(np.interp(part, row[beyond], AXIS[beyond])) for part in (0.02, 0.98))
    assert low == pytest.approx(height / tangents[0], abs=0.07)
    assert high == pytest.approx(height / tangents[1], abs=0.07)


def test_nothing_gentler_than_the_lamp_stands_high_casts_a_shadow() -> None:
    x, _ = GRID.places()
    slope = Prescribed(np.asarray(0.2 * np.tanh(x), np.float64), GRID)
    for surface in (Flat(), slope):
        (share,) = visibility([lamp(20.0)], surface, GRID)
        assert share.min() == 1.0


def test_a_camera_s_lamps_cast_shadows_only_where_asked_and_only_darken() -> None:
    plain, shaded = (
        build_camera(CameraOptions(distortion_px=0.0, blur_px=0.0, shadow_strip_mm=size), np.random.default_rng(1))
        for size in (None, (12.0, 2.0))
    )
    x, y = plain.grid.places()
    plateau = Prescribed(np.asarray(0.25 - 0.25 * np.tanh((np.hypot(x, y) - 2.5) / 0.05), np.float64), plain.grid)
    np.testing.assert_array_equal(plain.ideal(Flat()), shaded.ideal(Flat()))
    change = shaded.ideal(plateau) - plain.ideal(plateau)
    assert change.max() <= 1e-6
    assert change[np.hypot(x, y) > 6.0].min() > -1e-6
    assert change.min() < -0.1


@dataclass(frozen=True)
class Kept(Surface):
    """The surface that was kept beside Mitsuba's pictures."""

    centre_mm: Pair
    rounding_mm: float
    places_mm: Floats
    depths_mm: Floats

    @property
    def steep(self) -> tuple[Area, ...]:
        return (Area(self.centre_mm, (5.0, 5.0)),)

    def depth_mm(self, grid: Grid) -> Singles:
        """Depth (H, W) mm."""
        r = grid.distance(self.centre_mm)
        return lookup(r, self.places_mm, self.depths_mm, rounding_mm=self.rounding_mm)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """No shift (H, W) mm: the ink is even."""
        return Flat().shift_mm(grid)


def test_shadows_are_those_of_mitsuba_to_three_grey_levels() -> None:
    with np.load(KEPT, allow_pickle=False) as kept:
        x, y = (float(value) for value in kept["centre_mm"])
        places, depths = (kept[name].astype(np.float64) for name in ("places_mm", "depths_mm"))
        surface = Kept((x, y), float(kept["rounding_mm"]), places, depths)
        pictured = Pictured(surface, kept["shadowed"], kept["lit"], kept["scale"])
        part = slice(*kept["rows"]), slice(*kept["columns"])
        rig = diffuse_rig(int(kept["seed"]))
    dark = darkened(pictured.shadowed, pictured.lit)
    assert dark.sum() > 5000
    assert rms(pictured.simulated(rig, shadows=True)[part], pictured.shadowed, dark) < 3.0
    assert rms(pictured.simulated(rig, shadows=False)[part], pictured.shadowed, dark) > 12.0
