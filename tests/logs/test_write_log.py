"""What one library writes, the other opens: mcap and rosbags, and SQLite as it is."""

from __future__ import annotations

import re
import sqlite3
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_logs import Draw, drawer, time_ns
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from tactilevision.errors import InputError, RecordingError
from tactilevision.files.tiff import write_tiff
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import HeightMap
from tactilevision.robots.log_export import DEPTH_TOPIC, TRACTION_TOPIC, WRENCH_TOPIC, export_log
from tactilevision.robots.log_import import ImportSettings, import_log


@pytest.fixture
def draw(tmp_path: Path) -> Draw:
    return drawer(tmp_path)


@pytest.fixture
def made(draw: Draw, tmp_path: Path) -> tuple[Recording, Path]:
    """A recording out of a log, and results beside it: three maps of four, forces of two frames."""
    import_log(draw(), tmp_path / "rec", ImportSettings("/camera", sensor="gelsight_mini", mm_per_px=0.03))
    results = tmp_path / "results"
    (results / "depth").mkdir(parents=True)
    for number in range(3):
        depth = np.full((6, 8), 0.1 * number, np.float32)
        valid = np.ones((6, 8), bool)
        valid[0, 0] = False
        write_tiff(results / "depth" / f"{number:07d}.tiff", HeightMap(depth, valid, (0.03, 0.03)))
    lines = ["frame,fx_N,fy_N,fz_N,mx_Nmm,my_Nmm,mz_Nmm", "0000001.png,1,2,3,1000,0,-500", "0000002.png,,,6,,,"]
    (results / "resultants.csv").write_text("\n".join([*lines, "0000003.png,,,,,,"]) + "\n")
    return read_recording(tmp_path / "rec"), results


def by_rosbags(path: Path) -> list[tuple[str, int, Any]]:
    with AnyReader([path]) as bag:
        return [
            (about.topic, at_ns, bag.deserialize(data, about.msgtype)) for about, at_ns, data in bag.messages()
        ]


@pytest.mark.parametrize("name", ["out.mcap", "out.bag", "out"])
def test_depth_and_force_are_opened_by_rosbags(made: tuple[Recording, Path], tmp_path: Path, name: str) -> None:
    recording, results = made
    found = export_log(recording, tmp_path / name, depth=results, force=results)
    assert (found.depths, found.wrenches, found.without) == (3, 2, 1)
    messages = by_rosbags(tmp_path / name)
    depths = [(at_ns, one) for topic, at_ns, one in messages if topic == DEPTH_TOPIC]
    for number, (at_ns, one) in enumerate(depths):
        assert (one.encoding, one.height, one.width, one.step) == ("32FC1", 6, 8, 32)
        depth_m = np.frombuffer(bytes(one.data), "<f4").reshape(6, 8)
        assert np.isnan(depth_m[0, 0])
        np.testing.assert_allclose(depth_m[1:], 1e-4 * number, rtol=1e-6)
        stamp = one.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == at_ns
        assert at_ns == pytest.approx(time_ns(number), abs=2)
    wrench, normal = (one.wrench for topic, _, one in messages if topic == WRENCH_TOPIC)
    assert np.isnan([normal.force.x, normal.torque.z]).all()  # without markers the shear is not measured
    assert normal.force.z == 6.0
    assert (wrench.force.x, wrench.force.y, wrench.force.z) == (1.0, 2.0, 3.0)
    assert (wrench.torque.x, wrench.torque.z) == (1.0, -0.5)


@pytest.mark.parametrize("name", ["out.mcap", "out.bag"])
def test_tractions_are_a_cloud_of_named_fields(made: tuple[Recording, Path], tmp_path: Path, name: str) -> None:
    recording, results = made
    t_z = np.arange(2 * 3 * 4, dtype=np.float32).reshape(2, 3, 4) / 100
    nothing = np.full_like(t_z, np.nan)
    places: dict[str, Any] = {"mm_per_px": [0.5, 0.5], "first_mm": [-0.75, -0.5]}
    fields: dict[str, Any] = {"t_x": nothing, "t_y": nothing, "t_z": t_z, "patch": (t_z > 0).astype(np.float32)}
    np.savez(results / "tractions.npz", frame=np.array(["0000001.png", "0000003.png"]), **places, **fields)
    assert export_log(recording, tmp_path / name, force=results).tractions == 2
    clouds = [one for topic, _, one in by_rosbags(tmp_path / name) if topic == TRACTION_TOPIC]
    cloud = clouds[1]
    assert [(one.name, one.offset, one.datatype) for one in cloud.fields] == [
        (name, 4 * k, 7)
        for k, name in enumerate(("x", "y", "z", "traction_x", "traction_y", "traction_z", "patch"))
    ]
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step, cloud.is_dense) == (3, 4, 28, 112, False)
    kind = np.dtype({"names": [one.name for one in cloud.fields], "formats": ["<f4"] * 7})
    points = np.frombuffer(cloud.data.tobytes(), kind).reshape(3, 4)
    np.testing.assert_allclose(points["traction_z"], 1e6 * t_z[1], rtol=1e-6)
    np.testing.assert_allclose(points["x"][2], [-0.75e-3, -0.25e-3, 0.25e-3, 0.75e-3], rtol=1e-6)
    np.testing.assert_allclose(points["y"][:, 1], [-0.5e-3, 0, 0.5e-3], atol=1e-9)
    assert np.isnan(points["traction_x"]).all()
    np.savez(results / "tractions.npz", frame=np.array(["0000001.png"]), **places, **fields)
    with pytest.raises(InputError, match="holds no tractions"):
        export_log(recording, tmp_path / "again.mcap", force=results)


def test_mcap_reads_what_was_written_and_knows_the_schema(made: tuple[Recording, Path], tmp_path: Path) -> None:
    recording, results = made
    export_log(recording, tmp_path / "out.mcap", depth=results)
    with (tmp_path / "out.mcap").open("rb") as file:
        found = list(make_reader(file, validate_crcs=True).iter_messages())
    assert {schema.name for schema, *_ in found if schema} == {"sensor_msgs/msg/Image"}
    assert all(b"std_msgs/Header header" in schema.data for schema, *_ in found if schema)


def test_sqlite_reads_the_folder_and_its_times(made: tuple[Recording, Path], tmp_path: Path) -> None:
    recording, results = made
    export_log(recording, tmp_path / "out", force=results)
    storage = next((tmp_path / "out").glob("*.db3"))
    with sqlite3.connect(storage) as base:
        rows = base.execute("SELECT timestamp, data FROM messages ORDER BY timestamp").fetchall()
    assert len(rows) == 2
    force = struct.unpack_from("<3d", rows[0][1], len(rows[0][1]) - 48)  # force, then torque, end the message
    assert force == (1.0, 2.0, 3.0)


def test_nothing_is_left_where_there_is_nothing_to_write(made: tuple[Recording, Path], tmp_path: Path) -> None:
    recording, _ = made
    for name in ("out.mcap", "out.bag", "out"):
        with pytest.raises(InputError, match="neither depth nor force"):
            export_log(recording, tmp_path / name, depth=tmp_path)
        assert not (tmp_path / name).exists()
    with pytest.raises(InputError, match=r"end in \.mcap"):
        export_log(recording, tmp_path / "out.txt", depth=tmp_path)
    assert not list(tmp_path.glob(".unfinished*"))


def test_a_start_that_no_clock_has_is_told(made: tuple[Recording, Path]) -> None:
    toml = made[0].path / "recording.toml"
    text = re.sub(r"origin_ns = \d+", "origin_ns = -5", toml.read_text())
    toml.write_text(text)
    with pytest.raises(RecordingError, match=r"\[log\] origin_ns"):
        read_recording(toml.parent)
