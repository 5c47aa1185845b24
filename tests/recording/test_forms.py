"""Every legal form of a recording is read, and means what the format says."""

from __future__ import annotations

import datetime
import shutil
from pathlib import Path

import numpy as np
import pytest
from each import each
from small_recording import edit, picture, write_small

from tactilevision.errors import InputError, RecordingError
from tactilevision.recording.folder import read_folder
from tactilevision.recording.model import faults_of_flats, require
from tactilevision.recording.pictures import iter_frames
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image, write_points
from tactilevision.records.certified import EdgeDrop, EdgeProfile

POINTS_ONLY = """\
format = 1
[sensor]
kind = "custom"
[sensor.gel]
thickness_mm = 3.0
[indenter.A1]
radius_mm = 2.5
[depth]
source = "gauge"
std_mm = 0.003
[force]
std_N = [0.01, 0.01, 0.02]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_small(tmp_path / "small")


def tables_only(root: Path, name: str, text: str) -> Path:
    root.mkdir()
    (root / "recording.toml").write_text(POINTS_ONLY)
    (root / name).write_text(text)
    return root


def test_the_whole_is_read(folder: Path) -> None:
    recording = read_recording(folder)
    assert (recording.name, recording.date) == ("small", datetime.date(2026, 11, 21))
    assert (recording.sensor.kind, recording.sensor.width_px, recording.sensor.mm_per_px) == (
        "custom",
        32,
        (0.06, 0.06),
    )
    assert recording.sensor.gel is not None
    assert (recording.sensor.gel.thickness_mm, recording.sensor.gel.radius_mm) == (3.0, 15.0)
    assert (recording.force_std_N, recording.force_rate_Hz) == ((0.01, 0.01, 0.02), 100.0)
    assert (recording.clock_offset_s, recording.depth_source, recording.depth_std_mm) == (0.0, "vision", None)
    assert [(p.press, p.indenter, p.start_s, p.end_s) for p in recording.presses] == [
        ("1", "A1", 0.1, 0.4),
        ("2", "A1", 0.5, 0.9),
    ]
    assert np.isnan(recording.presses[0].rest_s)
    assert (recording.indenters["A1"].radius_mm, recording.indenters["A1"].bevel) == (2.5, "right")
    assert recording.forces is not None
    assert recording.forces.force_N.shape == (100, 3)
    assert [path.name for path in recording.flats] == ["untouched.png"]
    ball = recording.balls[0]
    assert (ball.path.name, ball.ball_radius_mm, ball.centre_px) == ("b1.png", 3.0, None)
    assert recording.warnings == ()


def test_columns_in_any_order_marks_line_ends_and_spaces_do_not_matter(folder: Path) -> None:
    lines = [line.split(",") for line in (folder / "forces.csv").read_text().splitlines()]
    turned = "\r\n".join(f" {z} ,{x},{t}, {y}" for t, x, y, z in lines)
    before = read_recording(folder).forces
    (folder / "forces.csv").write_bytes(("\ufeff" + turned + "\r\n\r\n,,,\r\n").encode())
    (folder / "recording.toml").write_bytes(b"\xef\xbb\xbf" + (folder / "recording.toml").read_bytes())
    after = read_recording(folder).forces
    assert before is not None
    assert after is not None
    np.testing.assert_array_equal(before.force_N, after.force_N)


def test_unknown_columns_are_kept(folder: Path) -> None:
    (folder / "presses.csv").write_text(
        "press,who,indenter,start_s,end_s,rest_s\n2,Ada,A1,0.5,0.9,\n1,,A1,0.1,0.4,7\n"
    )
    (folder / "stage.csv").write_text("time_s,z_mm,current_A,mode\n0,0,0.5,go\n1,1,,stop\n")
    recording = read_recording(folder)
    first = recording.presses[0]
    assert (first.press, first.rest_s, first.extra) == ("1", 7.0, {"who": ""})
    assert recording.presses[1].extra == {"who": "Ada"}
    np.testing.assert_array_equal(recording.extra["stage.csv"]["current_A"], [0.5, np.nan])
    assert list(recording.extra["stage.csv"]["mode"]) == ["go", "stop"]


def test_forces_and_torques_are_turned_into_the_frame(folder: Path) -> None:
    (folder / "forces.csv").write_text("time_s,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n")
    edit(folder / "recording.toml", "rate_Hz = 100.0", "rotation = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]")
    edit(folder / "recording.toml", "[0.01, 0.01, 0.02]", "[0.01, 0.03, 0.02]")
    forces = read_recording(folder).forces
    assert forces is not None
    assert forces.torque_Nm is not None
    np.testing.assert_allclose(forces.force_N[0], [2, 1, -3])
    np.testing.assert_allclose(forces.torque_Nm[0], [5, 4, -6])  # a turn: det +1
    np.testing.assert_allclose(forces.std_N, [0.03, 0.01, 0.02])
    edit(folder / "recording.toml", "[0, 0, -1]]", "[0, 0, 1]]")
    mirrored = read_recording(folder).forces
    assert mirrored is not None
    assert mirrored.torque_Nm is not None
    np.testing.assert_allclose(mirrored.force_N[0], [2, 1, 3])
    np.testing.assert_allclose(mirrored.torque_Nm[0], [-5, -4, -6])  # torque is an axial vector


def test_noise_left_out_is_estimated_from_the_readings(folder: Path) -> None:
    rng = np.random.default_rng(5)
    time_s = np.arange(4000) / 1000
    press = np.clip(np.sin(2 * np.pi * time_s / 4), 0, None)  # slow beside the readings
    noise = rng.normal(0, [0.01, 0.02, 0.05], (4000, 3))
    rows = "".join(
        f"{t:.4f},{x:.6f},{y:.6f},{p + z:.6f}\n" for t, p, (x, y, z) in zip(time_s, press, noise, strict=True)
    )
    (folder / "forces.csv").write_text("time_s,fx_N,fy_N,fz_N\n" + rows)
    edit(folder / "recording.toml", "std_N = [0.01, 0.01, 0.02]\nrate_Hz = 100.0\n", "")
    recording = read_recording(folder)
    # a median of 4000 differences scatters by 2 %
    np.testing.assert_allclose(recording.force_std_N or 0, [0.01, 0.02, 0.05], rtol=0.08)
    assert any("std_N is missing" in warning for warning in recording.warnings)


def test_a_rectification_gives_the_sensor_its_size(folder: Path) -> None:
    map_x, map_y = np.meshgrid(np.arange(20.0), np.arange(10.0))
    np.savez(folder / "maps.npz", map_x=map_x, map_y=map_y)
    edit(
        folder / "recording.toml",
        "width_px = 32\nheight_px = 24",
        'width_px = 20\nheight_px = 10\nrectification = "maps.npz"',
    )
    sensor = read_recording(folder).sensor
    assert (sensor.width_px, sensor.height_px) == (20, 10)
    assert sensor.rectification is not None
    np.testing.assert_array_equal(sensor.rectification[0], map_x.astype(np.float32))
    edit(folder / "recording.toml", "width_px = 20\nheight_px = 10\n", "")
    edit(folder / "recording.toml", '"custom"', '"gelslim3"')
    recording = read_recording(folder)
    assert (recording.sensor.width_px, recording.warnings) == (20, ())
    np.savez(folder / "maps.npz", map_x=map_x + 100, map_y=map_y)
    assert any("looks past the frames for 100 %" in warning for warning in read_recording(folder).warnings)


def test_points_alone_are_a_recording(tmp_path: Path) -> None:
    text = "indenter,press,fz_N,depth_mm,fz_std_N,note\nA1,a,1.0,0.2,,first\nA1,b,2.0,0.4,0.01,\n"
    recording = read_recording(tables_only(tmp_path / "points", "points.csv", text))
    first, second = recording.points
    assert (first.press, first.depth_mm, first.fz_N, first.accepted, first.extra) == (
        "a",
        0.2,
        1.0,
        True,
        {"note": "first"},
    )
    assert np.isnan(first.fz_std_N)
    assert second.fz_std_N == 0.01
    assert (recording.depth_source, recording.depth_std_mm, recording.name) == ("gauge", 0.003, "points")
    assert recording.force_std_N == (0.01, 0.01, 0.02)
    assert np.isnan(recording.sensor.mm_per_px).all()


def test_rejected_points_may_lack_their_depth(tmp_path: Path) -> None:
    text = "press,indenter,depth_mm,fz_N,accepted,reason\n1,A1,,,False,tilt\n2,A1,0.1,1,TRUE,\n"
    first, second = read_recording(tables_only(tmp_path / "points", "points.csv", text)).points
    assert (first.accepted, first.reason, np.isnan(first.depth_mm)) == (False, "tilt", True)
    assert second.accepted


def test_curves_alone_are_a_recording(tmp_path: Path) -> None:
    text = (
        "press,time_s,depth_mm,fx_N,fy_N,fz_N,phase,z_mm,humidity\n"
        "a,0,-0.1,0,0,0,free,1,40\nb,5,0,0,0,0,,2,41\na,1,0.1,.1,.2,.3,load,3,42\n"
    )
    first, second = read_recording(tables_only(tmp_path / "curves", "curves.csv", text)).curves
    assert (first.press, second.press) == ("a", "b")
    np.testing.assert_array_equal(first.depth_mm, [-0.1, 0.1])
    np.testing.assert_array_equal(first.force_N[1], [0.1, 0.2, 0.3])
    assert list(first.phase) == ["free", "load"]
    assert first.z_mm is not None
    np.testing.assert_array_equal(first.z_mm, [1, 3])
    np.testing.assert_array_equal(first.extra["humidity"], [40, 42])


def test_a_time_that_starts_anew_between_curves_is_a_warning(tmp_path: Path) -> None:
    text = "press,time_s,depth_mm,fx_N,fy_N,fz_N\na,5,0,0,0,0\na,6,0,0,0,0\nb,0,0,0,0,0\n"
    warnings = read_recording(tables_only(tmp_path / "curves", "curves.csv", text)).warnings
    assert any("starts again between presses, at b, so" in warning for warning in warnings)


@pytest.mark.parametrize(("scale", "told"), [(1, False), (1000, True)])
def test_times_of_curves_in_milliseconds_are_asked_about(tmp_path: Path, scale: int, told: bool) -> None:
    rows = [
        f"{name},{scale * (start + k)},0.{k},0,0,0.{k}" for name, start in (("a", 5), ("b", 50)) for k in (1, 2)
    ]
    folder = tables_only(
        tmp_path / "curves", "curves.csv", "\n".join(["press,time_s,depth_mm,fx_N,fy_N,fz_N", *rows])
    )
    with (folder / "recording.toml").open("a") as settings:
        settings.write('[indenter.A]\nshape = "flat_cylinder"\nradius_mm = 2.5\n')
    (folder / "presses.csv").write_text("press,indenter,start_s,end_s\na,A,4,9\nb,A,49,60\n")
    warnings = read_recording(folder).warnings
    assert any("is it in milliseconds" in warning for warning in warnings) is told


def test_frames_and_a_reference_are_enough_for_depth(folder: Path) -> None:
    for name in ("forces.csv", "presses.csv", "frames.csv"):
        (folder / name).unlink()
    recording = read_recording(folder)
    assert recording.frame_names == tuple(f"f{i}.png" for i in range(10))
    assert np.isnan(recording.frame_times_s).all()
    assert len(list(iter_frames(recording))) == 10
    assert any("frames.csv is missing" in warning for warning in recording.warnings)


@each(
    "needs, said",
    [
        (("frames", "forces"), "forces.csv: certify needs force readings. Add the table: columns time_s, fx_N"),
        (("presses",), "presses.csv: certify needs the protocol of presses"),
        (("frame_times",), "frames.csv: certify needs the times of the frames"),
        (("stage",), "stage.csv: certify needs the place of the motion stage"),
        (("points",), "points.csv: certify needs certified points"),
        (("curves",), "curves.csv: certify needs curves of depth and force"),
    ],
)
def test_what_a_step_lacks_is_named_with_its_file(tmp_path: Path, needs: tuple[str, ...], said: str) -> None:
    folder = write_small(tmp_path / "small")
    for name in ("forces.csv", "presses.csv", "frames.csv"):
        (folder / name).unlink()
    recording = read_recording(folder)
    require(recording, "frames", "flats", "balls", "gel", "indenters", step="certify")
    with pytest.raises(RecordingError, match=said):
        require(recording, *needs, step="certify")  # type: ignore[arg-type]


def test_a_missing_gel_and_missing_references_are_named(folder: Path) -> None:
    shutil.rmtree(folder / "reference")
    edit(folder / "recording.toml", '[sensor.gel]\nthickness_mm = 3.0\nshape = "disc"\nradius_mm = 15.0\n', "")
    recording = read_recording(folder)
    with pytest.raises(
        RecordingError, match=r"recording.toml \[sensor.gel\]: the fit needs the thickness of the gel"
    ):
        require(recording, "gel", step="the fit")
    with pytest.raises(RecordingError, match="reference/flat: depth needs a picture of the untouched gel"):
        require(recording, "flats", step="depth")
    with pytest.raises(RecordingError, match=r"reference/ball.csv: depth needs ball presses"):
        require(recording, "balls", step="depth")


def test_a_fault_of_its_own_reference_names_the_recording(folder: Path) -> None:
    recording = read_recording(folder)
    with pytest.raises(InputError) as told, faults_of_flats(recording):
        raise InputError("most of the reference is black", where="reference/flat", remedy="Check the lights.")
    assert told.value.where == str(folder / "reference" / "flat")
    assert told.value.remedy == "Check the lights."


def test_names_are_counted_as_a_person_does(tmp_path: Path) -> None:
    for index in (10, 9, 2, 100):
        write_image(tmp_path / "bare" / f"img_{index}.png", picture(index))
    write_image(tmp_path / "flat.png", picture(0))
    (tmp_path / "bare" / "notes.txt").write_text("not a picture")
    toml = tmp_path / "mine.toml"
    toml.write_text("[sensor]\nkind = 'custom'\nmm_per_px = 0.05\nwidth_px = 32\nheight_px = 24\n")
    recording = read_folder(tmp_path / "bare", sensor=toml, reference=tmp_path / "flat.png")
    assert recording.frame_names == ("img_2.png", "img_9.png", "img_10.png", "img_100.png")
    assert recording.sensor.mm_per_px == (0.05, 0.05)
    assert [path.name for path in recording.flats] == ["flat.png"]
    assert len(list(iter_frames(recording))) == 4


def test_a_recording_lends_a_bare_folder_what_it_has(folder: Path, tmp_path: Path) -> None:
    write_image(tmp_path / "flats/other.png", picture(3))
    assert read_folder(folder, reference=tmp_path / "flats").flats == (tmp_path / "flats/other.png",)
    again = read_folder(folder, sensor=folder / "recording.toml")
    assert again.frame_names == read_recording(folder).frame_names
    assert again.flats == read_recording(folder).flats


def test_faults_of_a_bare_folder_are_named(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    with pytest.raises(RecordingError, match="the sensor is not known"):
        read_folder(folder / "frames")
    with pytest.raises(RecordingError, match="the folder holds no pictures"):
        read_folder(tmp_path / "none", sensor="gelslim3")
    with pytest.raises(RecordingError, match=r"kind names no known sensor.*Did you mean gelslim3"):
        read_folder(folder / "frames", sensor="gelslim")
    with pytest.raises(RecordingError, match="no picture of the untouched gel"):
        read_folder(folder / "frames", sensor="gelslim3", reference=tmp_path / "none")
    with pytest.raises(RecordingError, match="no such folder of pictures"):
        read_folder(tmp_path / "nowhere", sensor="gelslim3")
    (tmp_path / "bare.toml").write_text("format = 1\n")
    with pytest.raises(RecordingError, match=r"the table \[sensor\] is missing"):
        read_folder(folder / "frames", sensor=tmp_path / "bare.toml")


def test_details_of_a_point_are_read_from_their_columns(tmp_path: Path) -> None:
    header = (
        "indenter,press,fz_N,depth_mm,rise_ratio,ruler_std,force_dwell,findings,fall_270_0.40_0.53_mm,ball_slope"
    )
    text = (
        header
        + ",slope_gain_std,lubricated,who\nA1,a,1.0,0.2,0.1,,1,,0.011,0.6,0.02,1,Ada\nA1,b,2.0,0.4,,,,,,,,,\n"
    )
    recording = read_recording(tables_only(tmp_path / "points", "points.csv", text))
    first, second = recording.points
    details, profile = first.details, first.edge_profile
    assert (details.pile_up_ratio, details.force_dwell, details.findings) == (0.1, True, "")
    assert np.isnan(details.travel_scale_std)
    assert profile == EdgeProfile((EdgeDrop(270.0, 0.4, 0.53, 0.011),), 0.02, 0.6)
    assert (first.lubricated, first.extra) == (1.0, {"who": "Ada"})
    assert second.edge_profile is None
    write_points(tmp_path / "points", recording.points)
    again = read_recording(tmp_path / "points").points[0]
    assert (again.edge_profile, again.details.pile_up_ratio, again.extra) == (profile, 0.1, first.extra)
    assert "fall_270_0.40_0.53_mm" in (tmp_path / "points" / "points.csv").read_text()
