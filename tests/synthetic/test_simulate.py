"""Simulated recordings: legal, complete, repeatable, and true to their own truth."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared_scenes import scenes, shared

from tactilevision.errors import InputError, OutputError
from tactilevision.recording.model import BadFrame, Recording
from tactilevision.recording.pictures import iter_frames, read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Floats
from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.options import FAULTS, GelOptions, IndenterOptions, RigOptions, SimulationOptions
from tactilevision.synthetic.rig import Protocol
from tactilevision.synthetic.scenario import PlannedPress, Scenario, draw_scenario
from tactilevision.synthetic.simulation import frame_times, simulate

SMALL = SimulationOptions(
    camera=CameraOptions(width_px=160, height_px=120, mm_per_px=(0.17, 0.17), light_seed=3, distortion_px=4.0),
    rig=RigOptions(frames_per_press=6),
    indenters=IndenterOptions(heights_mm=(0.2, 0.4)),
    presses=1,
    flats=1,
    balls=2,
)


@pytest.fixture(scope="module")
def folder() -> Path:
    return simulated()


@shared
def simulated() -> Path:
    return simulate(scenes() / "simulated", seed=5, options=SMALL)


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return read_recording(folder)


@pytest.fixture(scope="module")
def truth(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "truth.toml").read_text())


def digest(folder: Path) -> str:
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return hashlib.sha256(
        b"".join(str(p.relative_to(folder)).encode() + p.read_bytes() for p in files)
    ).hexdigest()


def test_recording_is_legal_and_complete(recording: Recording) -> None:
    assert recording.warnings == ()
    assert len(recording.presses) == 2 + len(FAULTS)
    assert len(recording.flats) == 1
    assert [ball.centre_px for ball in recording.balls] == [None, None]
    assert recording.clock_offset_s is None
    frames = list(iter_frames(recording))
    assert sum(isinstance(frame, BadFrame) for frame in frames) == 1
    assert read_frame(recording, 0).rgb.shape == (120, 160, 3)


def test_same_seed_gives_the_same_bytes_and_another_seed_others(folder: Path, tmp_path: Path) -> None:
    tiny = replace(SMALL, faults=(), balls=1)
    first, again, other = (simulate(tmp_path / n, seed=s, options=tiny) for n, s in (("a", 1), ("b", 1), ("c", 2)))
    assert digest(first) == digest(again)
    assert digest(first) != digest(other)


def test_truth_names_every_fault_and_the_material(truth: dict[str, Any]) -> None:
    assert sorted(p["reason"] for p in truth["presses_rejected"]) == sorted(FAULTS)
    assert len(truth["presses_accepted"]) == 2
    stiffness = 2 * 2.5 * truth["reduced_modulus_MPa"]
    assert truth["c_N_per_mm"] / stiffness == pytest.approx(2.81, abs=0.03)  # kappa(.48, 2.5/3)
    for press in truth["press"]:
        if press["reason"] == "bevel_not_touched":
            assert "depth_mm" not in press
        else:
            w = press["depth_mm"]
            force = truth["c_N_per_mm"] * w * (1 + truth["beta"] * w / 3.0) * press["gain"]
            if press["reason"] == "footprint":
                assert press["force_N"] < 0.75 * force  # a punch of .8 of the radius
            else:
                assert press["force_N"] == pytest.approx(force, rel=2e-3)  # finite elements are hardly bent


def test_forces_come_in_steps_of_the_sensor_at_its_rate(recording: Recording) -> None:
    assert recording.forces is not None
    steps = recording.forces.force_N * np.array([160.0, 160.0, 80.0])
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    np.testing.assert_allclose(np.diff(recording.forces.time_s), 0.005, atol=1.01e-4)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    rig = RigOptions(protocol=Protocol(dwell_s=1.0), frames_per_press=None)
    return draw_scenario(SimulationOptions(rig=rig, presses=1), seed=11)


def press_with(scenario: Scenario, fault: str) -> PlannedPress:
    return next(p for p in scenario.presses if p.fault == fault)


def test_touch_time_is_when_the_face_has_reached_the_touch_depth(scenario: Scenario) -> None:
    for press in (p for p in scenario.presses if not p.fault):
        assert press.motion.at(press.touch_time_s) == pytest.approx(press.touch_mm, abs=1e-9)
        assert press.bevel.gap_mm(press.profile, press.touch_mm, tilt=press.tilt) == pytest.approx(0.0, abs=1e-6)
        assert press.motion.at(press.touch_time_s - 0.004) == pytest.approx(press.touch_mm - 0.001, abs=1e-9)
        assert press.motion.at(press.touch_time_s + 0.99) == pytest.approx(press.touch_mm, abs=1e-9)  # the dwell


def test_force_during_the_dwell_is_the_law_at_the_touch(scenario: Scenario) -> None:
    time_s, readings = scenario.read_forces()
    camera_clock = time_s - scenario.clock_offset_s
    for press in (p for p in scenario.presses if not p.fault):
        rows = (camera_clock > press.touch_time_s) & (camera_clock < press.touch_time_s + 1.0)
        free = (camera_clock > press.start_s) & (camera_clock < press.start_s + 0.7)
        found = readings[rows, 2].mean() - readings[free, 2].mean()
        expected = float(scenario.options.gel.force_N(press.profile, press.touch_mm)) * press.gain
        assert found == pytest.approx(expected, abs=0.006)  # four standard deviations of both means


def test_every_fault_is_there_in_the_data(scenario: Scenario) -> None:
    time_s, readings = scenario.read_forces()
    by_label = {press.label: times for press, times in frame_times(scenario)}

    def during(press: PlannedPress) -> Floats:
        clock = time_s - scenario.clock_offset_s
        return readings[(clock > press.start_s) & (clock < press.end_s)]

    tangential = press_with(scenario, "tangential")
    assert np.hypot(*tangential.tangential) > 0.15
    assert np.hypot(*press_with(scenario, "tilt").tilt) > 0.025
    assert press_with(scenario, "footprint").profile.punch_radius_mm < 2.1
    shy = press_with(scenario, "bevel_not_touched")
    assert np.isnan(shy.touch_time_s)
    assert shy.bevel.gap_mm(shy.profile, float(shy.motion.face_mm.max())) > 0.02
    dropped = press_with(scenario, "dropped_frames")
    since = by_label[dropped.label] - dropped.touch_time_s
    assert ((since < -0.2) | (since > 1.2)).all()  # nothing of the dwell of one second either
    top = during(press_with(scenario, "saturated"))[:, 2]
    assert (top == top.max()).sum() > 100
    good = [p for p in scenario.presses if not p.fault]
    assert all((during(p)[:, 2] == during(p)[:, 2].max()).sum() < 100 for p in good)
    assert press_with(scenario, "short_rest").rest_s < 0.25 * min(p.rest_s for p in good)
    border = press_with(scenario, "border")
    half = 427 * 0.0634 / 2
    assert abs(border.centre_mm[0]) + 2.5 > half + 0.5


def test_full_rate_frames_keep_the_camera_s_pace_with_jitter(scenario: Scenario) -> None:
    _, times = frame_times(scenario)[0]
    steps = np.diff(times)
    assert steps.mean() == pytest.approx(1 / 90, rel=0.01)
    assert 1e-4 < steps.std() < 2e-3


@pytest.mark.parametrize("kind", ["curves", "points"])
def test_recordings_without_pictures(tmp_path: Path, kind: str) -> None:
    options = replace(SMALL, frames=kind)  # type: ignore[arg-type]
    recording = read_recording(simulate(tmp_path, seed=1, options=options))
    assert recording.warnings == ()
    assert len(recording.curves) == (2 if kind == "curves" else 0)
    assert len(recording.points) == (2 if kind == "points" else 0)
    if kind == "curves":
        curve = recording.curves[0]
        assert set(curve.phase) == {"free", "load", "hold", "unload"}
        assert abs(curve.depth_mm[curve.phase == "free"].mean()) < 0.002
        assert {curve.press for curve in recording.curves} <= {press.press for press in recording.presses}


def test_prior_of_poisson_ratio_can_be_left_out_and_clock_stated(tmp_path: Path) -> None:
    options = replace(
        SMALL,
        faults=(),
        balls=0,
        torn_frame=False,
        frames="jpeg",
        gel=GelOptions(prior_std=None),
        rig=RigOptions(frames_per_press=6, clock_offset_s=0.123, state_clock_offset=True),
        indenters=IndenterOptions(heights_mm=(0.3,), state_bevel_place=False, bevel="top"),
    )
    recording = read_recording(simulate(tmp_path, seed=1, options=options))
    assert recording.clock_offset_s == 0.123
    assert recording.sensor.gel is not None
    assert recording.sensor.gel.poisson_ratio is None
    assert recording.indenters["A1"].bevel_distance_mm is None
    assert recording.frame_names[0].endswith(".jpg")


def test_unknown_fault_is_refused() -> None:
    with pytest.raises(InputError, match=r"'earthquake'.*Known are tangential"):
        SimulationOptions(faults=("earthquake",))


def test_an_earlier_simulation_is_replaced_whole_and_nothing_else_ever(tmp_path: Path) -> None:
    small = replace(SMALL, faults=(), balls=1, torn_frame=False)
    simulate(tmp_path / "made", seed=1, options=small)
    simulate(tmp_path / "made", seed=1, options=replace(small, balls=0, rig=RigOptions(frames_per_press=6)))
    assert read_recording(tmp_path / "made").warnings == ()
    assert read_recording(tmp_path / "made").balls == ()
    real = tmp_path / "real"
    real.mkdir()
    (real / "points.csv").write_text("press,indenter,depth_mm,fz_N\n")
    with pytest.raises(OutputError, match="no simulation wrote"):
        simulate(real, seed=1, options=small)
    assert [path.name for path in real.iterdir()] == ["points.csv"]
