"""The gel beside the punch, read apart from walls that cannot be read: nu comes through, the depth follows it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from press_scenes import MM_PER_PX, SIZE, Made, line_up, recording

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.mechanics.poisson_from_surface import SurfaceFitSettings, fit_poisson_ratio
from tactilevision.mechanics.profile import LINEAR, PunchCase, linear_profile, seen_profile
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.press.certificate import Certificate, Evidence
from tactilevision.press.pile_up import PileUp
from tactilevision.press.poisson_from_rise import press_slopes, with_nu, with_pile_up
from tactilevision.recording.model import Recording
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.maps import Footprint, Frame, SlopeMap
from tactilevision.records.measured import Curve, Estimate, Floats

NU, CENTRE = 0.478, (0.3, -0.2)
EXACT = replace(LINEAR, relative_error=0.0, shape_error=(), single_depth_std=0.0)
X, Y = np.meshgrid(*((np.arange(n) - (n - 1) / 2) * MM_PER_PX for n in SIZE))
R = np.hypot(X - CENTRE[0], Y - CENTRE[1])
GRID = np.linspace(0, 20, 2001)


class Slopes:
    """Draws the slopes of a frame: walls half as steep on one side, and a light that has drifted unevenly."""

    method = None  # no card: the gain is not known

    def __init__(self, made: list[Made]) -> None:
        self.made = made

    def slope_map(self, frame: Frame) -> SlopeMap:
        press = next(m for m in self.made if m.start_s <= frame.time_s <= m.end_s)
        depth = float(press.depth(np.array([frame.time_s]))[0])
        profile = seen_profile(GRID / 2.5, PunchCase(NU, 2.5 / 3, depth / 3), source=linear_profile)
        surface = -depth * np.interp(R, GRID, profile)
        dz_dy, dz_dx = np.gradient(surface, MM_PER_PX)
        read = np.where((np.abs(R - 2.5) < 0.3) & (CENTRE[0] > X), 0.5, 1.0)
        return SlopeMap(read * dz_dx + 1e-3 + 1e-4 * X, read * dz_dy - 5e-5 * Y)


def certified(made: list[Made], record: Recording) -> Certificate:
    face = Footprint(np.zeros(SIZE[::-1], bool), CENTRE, 0.02, 2.5, 0.02, (0, 0), 0.001, 0.3, 0.01, 0.02)
    nothing: Floats = np.zeros(0)
    points, curves, evidence = [], [], {}
    for press, row in zip(made, record.presses, strict=True):
        times = record.frame_times_s
        times = times[(times > press.start_s) & (times < press.end_s)]
        force = np.zeros((times.size, 3))
        curves.append(Curve(row.press, times, press.depth(times), force, np.full(times.size, "load")))
        points.append(
            CertifiedPoint(
                row.press,
                row.indenter,
                press.touch_mm,
                1.0,
                0.003,
                time_s=press.touch_s,
                depth_uncorrected_mm=press.height_mm,
            )
        )
        evidence[row.press] = Evidence(
            row.press,
            0,
            "",
            face,
            None,
            None,
            times,
            press.depth(times),
            None,
            None,
            press.touch_s,
            nothing,
            nothing,
        )
    known = Estimate(0.0, 0.0, (0.0, 0.0), "s")
    rise = PileUp(0.1, 0.02)
    rises = {point.press: rise for point in points}
    return Certificate(tuple(points), tuple(curves), known, evidence, rises, 5.0)


def views_of_presses(record: Recording, reader: Reconstructor, certificate: Certificate) -> list[SurfaceView]:
    return [press.view(0.0) for press in press_slopes(record, reader, certificate=certificate)]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Made], Recording]:
    made = line_up([Made(height) for height in (0.2, 0.35, 0.5)])
    return made, recording(tmp_path_factory.mktemp("beside"), made)[0]


def test_walls_that_cannot_be_read_do_not_reach_nu(scene: tuple[list[Made], Recording]) -> None:
    made, record = scene
    views = views_of_presses(record, cast(Reconstructor, Slopes(made)), certified(made, record))
    assert [view.name for view in views] == ["1", "2", "3"]
    settings = SurfaceFitSettings(guard_mm=1.2, gain_std=0.01, bowl_std_per_mm=3e-4)
    fit = fit_poisson_ratio(views, thickness_mm=3.0, model=EXACT, settings=settings)
    assert fit.poisson_ratio.value == pytest.approx(NU, abs=0.003), "differences over .15 mm alone cost .002"


def test_bevel_and_wall_are_left_out(scene: tuple[list[Made], Recording]) -> None:
    made, record = scene
    (view, *_) = views_of_presses(record, cast(Reconstructor, Slopes(made)), certified(made, record))
    rows, columns = view.valid.shape
    x = (np.arange(columns) - (columns - 1) / 2) * view.mm_per_px[0] - CENTRE[0]
    y = (np.arange(rows) - (rows - 1) / 2) * view.mm_per_px[1] - CENTRE[1]
    assert not view.valid[:, x > 4.5].any(), "the bevel is on the right, 5 mm from the axis"
    assert not view.valid[np.hypot(*np.meshgrid(x, y)) < 2.9].any()
    assert view.valid.mean() > 0.4
    assert view.certified_depth_mm == pytest.approx(made[0].touch_mm, rel=0.1)


def test_rejected_presses_are_not_looked_at(scene: tuple[list[Made], Recording]) -> None:
    made, record = scene
    certificate = certified(made, record)
    spoiled = tuple(replace(p, accepted=p.press == "2", reason="tilt") for p in certificate.points)
    views = views_of_presses(record, cast(Reconstructor, Slopes(made)), replace(certificate, points=spoiled))
    assert [view.name for view in views] == ["2"]


def test_depth_follows_the_rise_of_the_nu_that_was_found(scene: tuple[list[Made], Recording]) -> None:
    made, record = scene
    before = certified(made, record)
    low, high = (with_pile_up(before, record, poisson_ratio=Estimate(nu, 0.004, None, "1")) for nu in (0.46, 0.49))
    for old, a, b in zip(before.points, low.points, high.points, strict=True):
        assert b.depth_mm < a.depth_mm, "a gel that rises more meets the bevel at a smaller depth"
        assert a.depth_mm / b.depth_mm == pytest.approx(1 + 0.03 * 1.1, abs=0.006)
        assert a.depth_std_mm < 0.02 * old.depth_mm
    ratio = low.points[0].depth_mm / before.points[0].depth_mm
    assert low.curves[0].depth_mm == pytest.approx(ratio * before.curves[0].depth_mm)
    assert with_pile_up(before, record, poisson_ratio=Estimate(None, None, (0.4, 0.5), "1", "noise")) is before


def test_presses_beyond_the_profiles_are_named_and_not_extrapolated(tmp_path: Path) -> None:
    made = line_up([Made(height) for height in (0.2, 0.35, 0.95)])
    record = recording(tmp_path, made)[0]
    certificate, nu = with_nu(record, cast(Reconstructor, Slopes(made)), certificate=certified(made, record))
    assert nu is not None
    assert any("presses 3 lies beyond" in line for line in certificate.warnings)
