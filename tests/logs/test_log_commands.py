"""`import` and `export` as they are typed: a log, a recording, and a log again."""

from __future__ import annotations

import json
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawn_logs import Draw, Drawn, drawer, image, pictures, time_ns, transform
from rosbags.highlevel import AnyReader

from tactilevision.cli import main
from tactilevision.errors import RecordingError
from tactilevision.files.tiff import write_tiff
from tactilevision.profile.sensor import open_with_profile
from tactilevision.profile.storage import read_profile
from tactilevision.recording.folder import read_folder
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import HeightMap
from tactilevision.robots.log_export import open_writer, wrench_message
from tactilevision.robots.messages import typestore

sys.path.insert(0, str(Path(__file__).parents[1] / "profile"))
from lamp_sensor import saved

AXES = "0,1,0,1,0,0,0,0,-1"


@pytest.fixture
def draw(tmp_path: Path) -> Draw:
    return drawer(tmp_path)


def run(*words: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        return main()


def test_a_log_becomes_a_recording_and_its_depth_a_log(
    draw: Draw, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, rec, out = draw("bag", sensor="wrist"), tmp_path / "rec", tmp_path / "out.mcap"
    told = tmp_path / "told.json"
    taken = ["--frames", "/camera", "--wrench", "/ft", "--rotation", AXES, "--out", rec, "--sensor", "digit"]
    taken += ["--mm-per-px", "0.03"]
    assert run("import", log, *taken, "--json", told) == 0
    assert "4 frames of /camera over 0.120 s, 4 readings" in capsys.readouterr().out
    assert json.loads(told.read_text())["wrench_frame_id"] == "wrist"
    (tmp_path / "depth").mkdir()
    zero = HeightMap(np.zeros((6, 8), np.float32), np.ones((6, 8), bool), (0.03, 0.03))
    write_tiff(tmp_path / "depth" / "0000002.tiff", zero)
    assert run("export", rec, "--depth", tmp_path, "--out", out, "--frame-id", "pad") == 0
    said = "".join(capsys.readouterr())
    assert "3 frames have no height map" in said
    assert "no meaning" not in said
    with AnyReader([out]) as bag:
        ((about, _, data),) = bag.messages()
        assert bag.deserialize(data, about.msgtype).header.frame_id == "pad"


def test_frames_that_are_there_are_kept(draw: Draw, tmp_path: Path) -> None:
    rec = tmp_path / "rec"
    taken = ["--frames", "/camera", "--sensor", saved(tmp_path), "--out", rec]
    assert run("import", draw(), *taken) == 0
    before = {path: path.read_bytes() for path in rec.rglob("*") if path.is_file()}
    assert run("import", draw("other.bag", frames=2), *taken) == 2
    assert {path: path.read_bytes() for path in rec.rglob("*") if path.is_file()} == before
    sensor = tomllib.loads((rec / "recording.toml").read_text())["sensor"]
    assert sensor.pop("gel")["thickness_mm"] > 0, "of the profile"
    assert sensor == {
        "kind": "custom",
        "serial": "07",
        "mm_per_px": [0.08, 0.08],
        "width_px": 240,
        "height_px": 180,
    }


@pytest.mark.parametrize("axes", ["1,0,0", "1,0,0,0,1,0,0,0,z"])
def test_axes_are_nine_numbers(draw: Draw, tmp_path: Path, capsys: pytest.CaptureFixture[str], axes: str) -> None:
    taken = ["--frames", "/camera", "--wrench", "/ft", "--rotation", axes]
    assert run("import", draw(), *taken, "--out", tmp_path / "rec") == 2
    assert f"--rotation: nine numbers with commas between are needed (got '{axes}')" in capsys.readouterr().err
    assert not (tmp_path / "rec").exists()


def test_a_rotation_that_stretches_and_one_topic_for_both_are_refused(
    draw: Draw, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, rec = draw("bag"), tmp_path / "rec"
    taken = ["--frames", "/camera", "--out", rec]
    assert run("import", log, *taken, "--wrench", "/ft", "--rotation", "1,0,0,0,1,0,0,0,2") == 2
    assert "--rotation: these nine numbers are not a rotation" in capsys.readouterr().err
    assert run("import", log, *taken, "--wrench", "/camera") == 2
    assert "--wrench: is the topic of the frames, too" in capsys.readouterr().err
    assert not rec.exists()


@pytest.mark.parametrize(("unit", "told"), [(1.0, False), (1000.0, True)])
def test_forces_that_no_gel_stands_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: float, *, told: bool
) -> None:
    path = tmp_path / "log.mcap"
    with open_writer(path) as (put, kind):
        for number, rgb in enumerate(pictures(3)):
            at_ns = time_ns(number)
            put("/camera", image(rgb, at_ns=at_ns, drawn=Drawn(), kind=kind), at_ns)
            force, moment = np.array([0.0, 0.0, -4.0 * unit]), np.zeros(3)
            put("/ft", wrench_message(force, moment, time_ns=at_ns, frame_id="tool", encoding=kind), at_ns)
    assert run("import", path, "--frames", "/camera", "--wrench", "/ft", "--out", tmp_path / "rec") == 0
    assert ("the wrench reaches 4000 N, too much for a gel" in capsys.readouterr().err) == told


def test_the_only_topic_of_pictures_is_taken_and_several_are_listed(
    draw: Draw, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("import", draw("bag"), "--out", tmp_path / "rec") == 0
    assert "4 frames of /camera over" in capsys.readouterr().out
    path = tmp_path / "two.mcap"
    with open_writer(path) as (put, kind):
        for topic in ("/left", "/right"):
            put(topic, image(pictures(1)[0], at_ns=time_ns(0), drawn=Drawn(), kind=kind), time_ns(0))
    assert run("import", path, "--out", tmp_path / "rec2") == 2
    assert "several topics of pictures. Name one with --frames: /left, /right." in capsys.readouterr().err
    force = tmp_path / "force.mcap"
    with open_writer(force) as (put, kind):
        put("/ft", wrench_message(np.zeros(3), np.zeros(3), time_ns=1, frame_id="a", encoding=kind), 1)
    assert run("import", force, "--out", tmp_path / "rec3") == 2
    assert "no topic of pictures. It has: /ft (geometry_msgs/msg/WrenchStamped)." in capsys.readouterr().err


def test_what_was_not_taken_is_listed_with_its_option(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.mcap"
    with open_writer(path) as (put, kind):
        for number, rgb in enumerate(pictures(2)):
            at_ns = time_ns(number)
            for topic in ("/left", "/right", "/top"):
                put(topic, image(rgb, at_ns=at_ns, drawn=Drawn(), kind=kind), at_ns)
            wrench = wrench_message(np.zeros(3), np.zeros(3), time_ns=at_ns, frame_id="tool", encoding=kind)
            put("/ft", wrench, at_ns)
            put("/joint", typestore(kind).types["std_msgs/msg/Float64"](1.0), at_ns)
            put("/tf_static", transform("a", "b", (0.0, 0.0, 0.0, 1.0), kind=kind), at_ns)
    assert run("import", path, "--frames", "/top", "--out", tmp_path / "rec") == 0
    pictures_of = "(sensor_msgs/msg/Image)"
    assert capsys.readouterr().out.splitlines()[1:] == [
        f"the log also has /left {pictures_of}, /right {pictures_of}; --frames takes one",
        "the log also has /ft (geometry_msgs/msg/WrenchStamped); --wrench takes it",
        "the log also has /joint (std_msgs/msg/Float64); no option takes these",
    ]
    assert run("import", path, "--frames", "/top", "--wrench", "/ft", "--out", tmp_path / "rec2") == 0
    assert "--wrench" not in capsys.readouterr().out


def test_the_scale_of_a_kind_that_is_named_is_guessed_and_one_of_another_shape_refused(
    draw: Draw, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Else no command could read the recording: 8 x 6 px are a Mini's view over few pixels."""
    log, rec = draw("bag"), tmp_path / "rec"
    assert run("import", log, "--frames", "/camera", "--sensor", "gelsight_mini", "--out", rec) == 0
    assert "guessed: 2.536 mm per pixel" in capsys.readouterr().err
    assert read_recording(rec).sensor.mm_per_px == pytest.approx((2.536, 2.536))
    other = tmp_path / "other"
    assert run("import", log, "--frames", "/camera", "--sensor", "digit", "--out", other) == 2
    assert "State it with --mm-per-px" in capsys.readouterr().err
    assert not other.exists()


def test_what_a_recording_leaves_out_of_its_sensor_a_profile_or_an_option_says(draw: Draw, tmp_path: Path) -> None:
    rec, profile = tmp_path / "rec", read_profile(saved(tmp_path))
    assert run("import", draw("bag"), "--frames", "/camera", "--out", rec) == 0
    mini = replace(profile, sensor=replace(profile.sensor, kind="gelsight_mini"), frame_size_px=(8, 6))
    assert open_with_profile(rec, mini).sensor.mm_per_px == profile.sensor.mm_per_px
    settings = rec / "recording.toml"
    settings.write_text(settings.read_text() + '[sensor]\nkind = "gelsight_mini"\n')
    with pytest.raises(RecordingError, match="or --mm-per-px if the command has it"):
        read_recording(rec)
    assert read_folder(rec, mm_per_px=0.5).sensor.mm_per_px == (0.5, 0.5)
