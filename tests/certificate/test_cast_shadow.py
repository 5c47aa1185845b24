"""The fall of the gel beside the punch over depth: one number without shadows, and what is done where it grows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from press_scenes import Made, line_up, recording
from test_poisson_from_rise import EXACT, NU, R, Slopes, certified, views_of_presses

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.mechanics.poisson_from_surface import SurfaceFitSettings, fit_poisson_ratio
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.press import poisson_from_rise
from tactilevision.press.poisson_from_rise import (
    FLAG,
    fall_growth,
    nu_beyond_shadows,
    press_slopes,
    shows_shadow,
    with_nu,
)
from tactilevision.records.maps import Frame, SlopeMap
from tactilevision.records.measured import Curve, Estimate
from tactilevision.records.rig import SHADOW_ZONE, ShadowZone

HEIGHTS = (0.2, 0.3, 0.4, 0.5)


class Shadowed(Slopes):
    """Slopes that are the steeper, the deeper the punch stands, within `reach` depths of its edge."""

    def __init__(self, made: list[Made], reach: float = np.inf) -> None:
        super().__init__(made)
        self.reach, self.count = reach, 0

    def slope_map(self, frame: Frame) -> SlopeMap:
        slopes = super().slope_map(frame)
        press = next(m for m in self.made if m.start_s <= frame.time_s <= m.end_s)
        depth = float(press.depth(np.array([frame.time_s]))[0])
        self.count += 1
        grown = np.where(2.5 + self.reach * depth > R, 1 + 1.5 * depth, 1.0)
        return replace(slopes, dz_dx=slopes.dz_dx * grown, dz_dy=slopes.dz_dy * grown)


def views_of(tmp_path: Path, kind: type[Slopes]) -> list[SurfaceView]:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    return views_of_presses(record, cast(Reconstructor, kind(made)), certified(made, record))


def test_without_shadows_the_fall_over_depth_hardly_grows(tmp_path: Path) -> None:
    views = views_of(tmp_path, Slopes)
    growth, std = fall_growth(views)
    assert abs(growth) < 0.15
    assert not shows_shadow(growth, std)
    assert not shows_shadow(*fall_growth(views[:3]))


def test_shadows_show_in_it(tmp_path: Path) -> None:
    growth, std = fall_growth(views_of(tmp_path, Shadowed))
    assert growth > 0.25
    assert shows_shadow(growth, std)


def nu_at(views: list[SurfaceView]) -> float:
    fit = fit_poisson_ratio(views, thickness_mm=3.0, model=EXACT, settings=SurfaceFitSettings(guard_mm=1.2))
    return float(fit.values[0])


def test_nu_beyond_the_zone_is_free_of_shadows_and_frames_are_read_once(tmp_path: Path) -> None:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    reader = Shadowed(made, reach=4.0)
    presses = press_slopes(record, cast(Reconstructor, reader), certificate=certified(made, record))
    count = reader.count
    assert abs(nu_at([press.view(0.0) for press in presses]) - NU) > 0.01
    assert nu_at([press.view(SHADOW_ZONE.clear) for press in presses]) == pytest.approx(NU, abs=0.006)
    certificate, nu = with_nu(record, cast(Reconstructor, reader), certificate=certified(made, record))
    assert reader.count == 2 * count
    assert certificate.flags == (FLAG,)
    assert nu is not None
    assert nu.value is not None


def test_nu_is_as_uncertain_as_the_zone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    reader = cast(Reconstructor, Slopes(made))
    presses = press_slopes(record, reader, certificate=certified(made, record))

    def fit(recording: object, reconstructor: object, views: list[SurfaceView], start: object) -> Any:
        reach = (views[0].valid.sum() - nearest) / abs(nearest)  # fewer squares, the farther the zone reaches
        value = 0.47 + 0.5 * reach
        return SimpleNamespace(poisson_ratio=Estimate(value, 0.003, None, "1"), values=[value], left_out=())

    nearest = presses[0].view(SHADOW_ZONE.clear).valid.sum()
    monkeypatch.setattr(poisson_from_rise, "fit_nu", fit)
    nu, _ = nu_beyond_shadows(record, reader, presses=presses, zone=SHADOW_ZONE)
    wider, _ = nu_beyond_shadows(
        record, reader, presses=presses, zone=replace(SHADOW_ZONE, reach_std=2.0, clear_sigma=1.5)
    )
    assert nu.value == wider.value == 0.47
    assert 0.003 < (nu.std or 0.0) < (wider.std or 0.0)


def test_nu_is_open_where_no_gel_lies_beyond_the_zone(tmp_path: Path) -> None:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    _, nu = with_nu(
        record, cast(Reconstructor, Slopes(made)), certificate=certified(made, record), zone=ShadowZone(1.0)
    )
    assert nu is not None
    assert nu.value is None
    assert nu.why


def test_a_frame_whose_wall_is_lost_has_the_forces_depth(tmp_path: Path) -> None:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    certificate = certified(made, record)
    reader = cast(Reconstructor, Slopes(made))
    sound = [view.certified_depth_mm for view in views_of_presses(record, reader, certificate)]
    curves = [_with_lost_walls(curve) for curve in certificate.curves]
    broken = replace(certificate, curves=tuple(curves))
    found = [view.certified_depth_mm for view in views_of_presses(record, reader, broken)]
    assert found == pytest.approx(sound, rel=0.03)


def _with_lost_walls(curve: Curve) -> Curve:
    """A force that belongs to the depth, and every third depth a third too small."""
    force = np.zeros((curve.depth_mm.size, 3))
    force[:, 2] = 3.0 * np.maximum(curve.depth_mm, 0.0) ** 1.1
    lost = np.where(np.arange(curve.depth_mm.size) % 3 == 0, 0.66, 1.0)
    return replace(curve, force_N=force, depth_mm=curve.depth_mm * lost)
