"""The fall of the gel beside the punch over depth: one number without shadows, and what is done where it grows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from press_scenes import Made, line_up, recording
from test_poisson_from_rise import Slopes, certified

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.photometric.illumination.lamps import Lamps
from tactilevision.press import poisson_from_rise
from tactilevision.press.poisson_from_rise import (
    FLAG,
    LIT_NU_STD,
    NU_STD,
    fall_growth,
    shows_shadow,
    surfaces_beside_punch,
    with_nu,
)
from tactilevision.records.maps import Frame, SlopeMap
from tactilevision.records.measured import Curve

HEIGHTS = (0.2, 0.3, 0.4, 0.5)


class Shadowed(Slopes):
    """Slopes beside the punch too steep by what a low lamp leaves out: the more, the deeper it stands."""

    def slope_map(self, frame: Frame) -> SlopeMap:
        slopes = super().slope_map(frame)
        press = next(m for m in self.made if m.start_s <= frame.time_s <= m.end_s)
        depth = float(press.depth(np.array([frame.time_s]))[0])
        return replace(slopes, dz_dx=slopes.dz_dx * (1 + 1.5 * depth), dz_dy=slopes.dz_dy * (1 + 1.5 * depth))


def views_of(tmp_path: Path, kind: type[Slopes]) -> list[SurfaceView]:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    return surfaces_beside_punch(record, cast(Reconstructor, kind(made)), certificate=certified(made, record))


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


def test_where_lamps_are_known_nu_has_room_for_the_light_that_the_gel_sends_to_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    monkeypatch.setattr(poisson_from_rise, "find_lamps", lambda recording, reconstructor: Lamps((), 2.0, 1.0))
    monkeypatch.setattr(poisson_from_rise, "LightField", SimpleNamespace(of=lambda *_: ()))
    monkeypatch.setattr(poisson_from_rise, "lit_slopes", lambda reader, *_, **__: reader)
    certificate, nu = with_nu(record, cast(Reconstructor, Shadowed(made)), certificate=certified(made, record))
    assert nu is not None
    assert nu.std is not None
    assert nu.interval95 is not None
    assert LIT_NU_STD < nu.std < NU_STD
    assert nu.interval95[1] - nu.interval95[0] > 2 * 1.96 * LIT_NU_STD
    assert "places that all lamps reach" in certificate.warnings[0]


@pytest.mark.parametrize("lamps", [None, Lamps((), 2.0, 1.0, unexplained=0.2)], ids=["none", "doubtful"])
def test_where_lamps_are_not_known_nu_says_what_shadows_may_do(
    lamps: Lamps | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    monkeypatch.setattr(poisson_from_rise, "find_lamps", lambda recording, reconstructor: lamps)
    certificate, nu = with_nu(record, cast(Reconstructor, Shadowed(made)), certificate=certified(made, record))
    assert nu is not None
    assert nu.std is not None
    assert nu.std >= NU_STD
    assert certificate.flags == (FLAG,)
    assert "lamps cast shadows" in certificate.warnings[0]
    assert "5 to 20 % too high" in certificate.warnings[0]
    assert ("unknown_lamps" in certificate.warnings[0]) is (lamps is not None)


def test_a_frame_whose_wall_is_lost_has_the_forces_depth(tmp_path: Path) -> None:
    made = line_up([Made(height) for height in HEIGHTS])
    record = recording(tmp_path, made)[0]
    certificate = certified(made, record)
    reader = cast(Reconstructor, Slopes(made))
    sound = [view.certified_depth_mm for view in surfaces_beside_punch(record, reader, certificate=certificate)]
    curves = [_with_lost_walls(curve) for curve in certificate.curves]
    broken = replace(certificate, curves=tuple(curves))
    found = [view.certified_depth_mm for view in surfaces_beside_punch(record, reader, certificate=broken)]
    assert found == pytest.approx(sound, rel=0.03)


def _with_lost_walls(curve: Curve) -> Curve:
    """A force that belongs to the depth, and every third depth a third too small."""
    force = np.zeros((curve.depth_mm.size, 3))
    force[:, 2] = 3.0 * np.maximum(curve.depth_mm, 0.0) ** 1.1
    lost = np.where(np.arange(curve.depth_mm.size) % 3 == 0, 0.66, 1.0)
    return replace(curve, force_N=force, depth_mm=curve.depth_mm * lost)
