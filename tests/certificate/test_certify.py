"""The whole chain on drawn height maps: touch, force, clocks, depth, and the reason of every bad press."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from press_scenes import OFFSET_S, RISE, C, Made, line_up, recording
from shared_scenes import scenes, shared

from tactilevision.errors import RecordingError
from tactilevision.press.certification import certify
from tactilevision.records.certified import REASONS
from tactilevision.records.rig import Indenter

FAULTS = list(REASONS)


@pytest.fixture(scope="module")
def whole():  # type: ignore[no-untyped-def]
    return certified_whole()


@shared
def certified_whole():  # type: ignore[no-untyped-def]
    """Six good presses with one of every fault in between."""
    heights = (0.2, 0.35, 0.5)
    order = [Made(heights[k % 3]) for k in range(6)]
    for k, fault in enumerate(FAULTS):
        order.insert(
            min(2 + 2 * k, len(order)),
            Made(0.5 if fault in ("saturated", "bevel_not_touched") else 0.35, fault=fault),
        )
    made = line_up(order)
    folder = scenes() / "whole"
    folder.mkdir()
    return made, certify(*recording(folder, made, seed=3))


def test_every_press_is_judged_for_its_true_reason(whole) -> None:  # type: ignore[no-untyped-def]
    made, certificate = whole
    assert [p.reason for p in certificate.points] == [m.fault for m in made]
    assert [p.accepted for p in certificate.points] == [not m.fault for m in made]
    for point in certificate.points:
        assert point.accepted or point.reason in point.details.findings


def test_touch_within_a_frame_and_force_within_its_std(whole) -> None:  # type: ignore[no-untyped-def]
    made, certificate = whole
    late, sigmas = [], []
    for press, point in zip(made, certificate.points, strict=True):
        if press.fault:
            continue
        true = C * press.touch_mm * (1 + 0.28 * press.touch_mm)
        late.append(point.time_s - press.touch_s)
        slope = C * (1 + 0.56 * press.touch_mm)  # a point is a depth with a force: what is open of either counts
        sigmas.append((point.fz_N - true) / np.hypot(point.fz_std_N, slope * point.depth_std_mm))
        assert point.fz_N == pytest.approx(true, rel=0.07)
    assert np.sqrt(np.mean(np.square(late))) < 1 / 30
    assert np.sqrt(np.mean(np.square(sigmas))) < 2


def test_depth_is_corrected_for_the_rise(whole) -> None:  # type: ignore[no-untyped-def]
    made, certificate = whole
    for press, point in zip(made, certificate.points, strict=True):
        assert point.depth_uncorrected_mm == press.height_mm
        assert point.depth_mm == pytest.approx(press.touch_mm, abs=2 * point.depth_std_mm)
        assert point.depth_mm == pytest.approx(press.touch_mm, rel=0.012)
    for pile_up in certificate.pile_ups.values():
        assert pile_up.ratio == pytest.approx(RISE, abs=2 * pile_up.std)


def test_clocks_are_aligned(whole) -> None:  # type: ignore[no-untyped-def]
    offset = whole[1].clock_offset
    assert offset.value == pytest.approx(OFFSET_S, abs=0.003)
    assert abs(offset.value - OFFSET_S) < 4 * offset.std


def test_curves_follow_the_press_and_meet_the_certificate(whole) -> None:  # type: ignore[no-untyped-def]
    made, certificate = whole
    presses = {str(k + 1): press for k, press in enumerate(made)}
    points = {point.press: point for point in certificate.points}
    for curve in certificate.curves:
        if not points[curve.press].accepted:
            continue
        true = presses[curve.press].depth(curve.time_s)
        assert np.abs(curve.depth_mm - true).max() < 0.02 + 0.02 * true.max()
        at_event = np.interp(points[curve.press].time_s, curve.time_s, curve.depth_mm)
        assert at_event == pytest.approx(points[curve.press].depth_mm, rel=1e-3)
        assert set(curve.phase.tolist()) == {"free", "load", "hold", "unload"}
        hold = curve.phase == "hold"
        assert true[hold].min() > 0.95 * true.max()


def test_evidence_shows_the_event(whole) -> None:  # type: ignore[no-untyped-def]
    made, certificate = whole
    for press, point in zip(made, certificate.points, strict=True):
        evidence = certificate.evidence[point.press]
        assert evidence.footprint is not None
        if press.fault:
            continue
        assert evidence.height_map.depth_mm.dtype == np.float32
        assert abs(evidence.height_map.time_s - point.time_s) < 1 / 30
        (x0, y0), (x1, y1) = evidence.bevel_window_mm
        assert x0 < 5.3 < x1
        assert y0 < -0.2 < y1


def test_evidence_of_a_bad_press_shows_contact_and_no_touch_that_was_not_seen(whole) -> None:  # type: ignore[no-untyped-def]
    made, certificate = whole
    for press, point in zip(made, certificate.points, strict=True):
        evidence = certificate.evidence[point.press]
        if press.fault in ("saturated", "bevel_not_touched"):
            assert evidence.touch is None
            assert press.depth(evidence.height_map.time_s) > 0.8 * press.top_mm
        elif not press.fault:
            assert evidence.touch is not None


@pytest.mark.parametrize(
    "side", ["top", *(pytest.param(side, marks=pytest.mark.slow) for side in ("left", "bottom"))]
)
def test_any_side_and_a_bevel_whose_place_is_not_stated(side: str, tmp_path: Path) -> None:
    made = line_up([Made(h, side=side) for h in (0.2, 0.35, 0.5)])
    certificate = certify(*recording(tmp_path, made, seed=5, rate_Hz=20.0, state_place=False))
    assert certificate.bevel_distance_mm == pytest.approx(5.0, abs=0.3)
    assert any("5.0 mm" in warning or "found at" in warning for warning in certificate.warnings)
    for press, point in zip(made, certificate.points, strict=True):
        assert point.accepted
        assert abs(point.time_s - press.touch_s) < 2 / 20
        assert point.depth_mm == pytest.approx(press.touch_mm, abs=3 * point.depth_std_mm)


def test_a_stated_offset_is_used_and_frames_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    made = line_up([Made(0.3), Made(0.3)])
    read, drawn = recording(tmp_path, made)
    (tmp_path / "00003.png").write_bytes(b"torn")
    certificate = certify(replace(read, clock_offset_s=OFFSET_S), drawn)
    assert any("00003.png" in warning for warning in certificate.warnings)
    assert certificate.clock_offset.value == OFFSET_S
    assert all(point.accepted for point in certificate.points)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    read, drawn = recording(tmp_path, line_up([Made()]))
    with pytest.raises(RecordingError, match="force readings"):
        certify(replace(read, forces=None), drawn)
    with pytest.raises(RecordingError, match="same label"):
        certify(replace(read, presses=read.presses * 2), drawn)
    with pytest.raises(RecordingError, match="not described"):
        certify(replace(read, indenters={"other": next(iter(read.indenters.values()))}), drawn)


def test_a_long_press_is_read_the_same_without_keeping_its_maps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, drawn = recording(tmp_path, line_up([Made(0.35), Made(0.35)]))
    short = certify(read, drawn)
    monkeypatch.setattr(sys.modules["tactilevision.press.certification"], "_LONG", 20)
    for once, again in zip(short.points, certify(read, drawn).points, strict=True):
        assert again.time_s == pytest.approx(once.time_s, abs=2 * once.details.contact_std_s)
        assert again.accepted


@pytest.mark.slow
def test_few_frames_while_the_rig_stands_still_at_the_touch_are_no_loss(tmp_path: Path) -> None:
    made = line_up([Made(0.35), Made(0.5), Made(0.35, dwell_s=0.6), Made(0.5), Made(0.5, fault="dropped_frames")])
    certificate = certify(*recording(tmp_path, made, seed=4))
    assert [point.reason for point in certificate.points] == ["", "", "", "", "dropped_frames"]
    assert certificate.points[2].details.force_dwell


def test_a_gap_between_ramp_and_hold_is_no_saturation(tmp_path: Path) -> None:
    made = line_up([Made(0.15), Made(0.5), Made(0.15, pause=True)])
    certificate = certify(*recording(tmp_path, made, seed=4))
    assert [point.reason for point in certificate.points] == ["", "", ""]
    law = certificate.points[0].fz_N / certificate.points[0].depth_mm
    assert certificate.points[1].fz_N / certificate.points[1].depth_mm > law, "read at its own height"


@pytest.mark.slow
def test_a_face_with_something_beside_it_is_no_disc(tmp_path: Path) -> None:
    made = line_up([Made(0.35), Made(0.5), Made(0.35, crumb=True)])
    certificate = certify(*recording(tmp_path, made, seed=4))
    assert [point.reason for point in certificate.points] == ["", "", "footprint"]
    assert "uneven" in certificate.points[2].details.findings


@pytest.mark.parametrize("seeds", [(1,), pytest.param((1, 2, 3), marks=pytest.mark.slow)])
@pytest.mark.slow
def test_stops_that_scatter_about_the_touch_leave_the_force_open(seeds: tuple[int, ...], tmp_path: Path) -> None:
    stds: dict[float, list[float]] = {0.0: [], 0.006: []}
    for off_mm, seed in product(stds, seeds):
        folder = tmp_path / f"{off_mm}-{seed}"
        folder.mkdir()
        made = line_up([Made(0.35, dwell_s=0.6, stop_mm=off_mm * side) for side in (1, -1, 1, -1, 1)])
        points = certify(*recording(folder, made, seed=seed)).points
        stopped = [point.fz_std_N for point in points if point.details.force_dwell]
        assert len(stopped) >= 4
        stds[off_mm].append(float(np.median(stopped)))
    assert np.median(stds[0.0]) < 0.003
    assert np.median(stds[0.006]) > 0.005


@pytest.mark.slow
def test_a_chipped_face_is_no_tilted_one(tmp_path: Path) -> None:
    made = line_up([Made(0.35), Made(0.5), Made(0.35), Made(0.5, chip=True)])
    certificate = certify(*recording(tmp_path, made, seed=4))
    assert [point.reason for point in certificate.points] == ["", "", "", "footprint"]
    assert "not flat" in certificate.points[3].details.findings


@pytest.mark.slow
def test_presses_at_another_clock_say_so_and_not_that_the_force_is_saturated(tmp_path: Path) -> None:
    made = [Made(0.35, clock_s=-0.4), *(Made(0.5 - 0.15 * (k % 2)) for k in range(5))]
    certificate = certify(*recording(tmp_path, line_up(made), seed=4))
    first, *others = certificate.points
    assert [point.reason for point in others] == [""] * 5
    assert first.reason == "dropped_frames"
    assert "another offset of the clocks" in first.details.findings


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(Indenter("", "cone", half_angle_deg=70.0), marks=pytest.mark.slow),
        Indenter("", "sphere", radius_mm=6.0),
    ],
    ids=["cone", "ball"],
)
def test_a_cone_or_a_ball_has_no_bevel_and_its_presses_are_rejected_for_that(
    tmp_path: Path, shape: Indenter
) -> None:
    given, reconstruct = recording(tmp_path, line_up([Made(0.3), Made(0.4)]), seed=4)
    others = {name: replace(shape, name=name) for name in given.indenters}
    points = certify(replace(given, indenters=others), reconstruct).points
    assert [point.reason for point in points] == ["bevel_not_touched"] * 2
