"""A log comes back as it was drawn; one that is not what it should be is refused in a sentence."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_logs import KINDS, START_NS, Draw, drawer, pictures
from rosbags.highlevel import AnyReader

from tactilevision.errors import InputError
from tactilevision.recording import layout
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.recording.read_tables import read_frame_table
from tactilevision.robots.log_export import _header, open_writer
from tactilevision.robots.log_import import ImportSettings, import_log
from tactilevision.robots.messages import COMPRESSED, IMAGE, Clock, read_log, typestore

BOTH = ImportSettings("/camera", "/ft", sensor="gelsight_mini", mm_per_px=0.03)
FRAMES_ALONE = ImportSettings("/camera", sensor="gelsight_mini", mm_per_px=0.03)


@pytest.fixture
def draw(tmp_path: Path) -> Draw:
    return drawer(tmp_path)


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("encoding", ["bgr8", "rgb8"])
def test_frames_and_forces_come_back_on_the_headers_clock(
    draw: Draw, tmp_path: Path, name: str, encoding: str
) -> None:
    shift_s = 0.25  # both headers are later than the log
    log = draw(name, encoding=encoding, picture_shift_s=shift_s, wrench_shift_s=shift_s)
    found = import_log(log, tmp_path / "rec", BOTH)
    recording = read_recording(tmp_path / "rec")
    assert (found.frames, found.readings) == (4, 4)
    origin_ns = int(recording.settings["log"]["origin_ns"])
    expected = (START_NS - origin_ns) * 1e-9 + shift_s + 0.04 * np.arange(4)
    np.testing.assert_allclose(recording.frame_times_s, expected, atol=2e-9)
    assert recording.forces is not None
    np.testing.assert_allclose(recording.forces.time_s, expected, atol=2e-9)
    np.testing.assert_array_equal(recording.forces.force_N[:, 2], np.arange(4))
    np.testing.assert_allclose(recording.forces.torque_Nm[:, 0], 1.0)  # type: ignore[index]
    for number, rgb in enumerate(pictures(4)):
        np.testing.assert_array_equal(read_frame(recording, number).rgb, rgb)


def test_the_logs_own_time_is_taken_where_it_is_asked_for(draw: Draw, tmp_path: Path) -> None:
    log = draw(picture_shift_s=-1e9)
    with pytest.raises(InputError, match="two clocks"):
        import_log(log, tmp_path / "rec", BOTH)
    import_log(log, tmp_path / "rec", ImportSettings("/camera", "/ft", clock=Clock.LOG))
    times = read_frame_table(tmp_path / "rec" / layout.FRAME_TABLE).numbers["time_s"]
    np.testing.assert_allclose(np.diff(times), 0.04, atol=2e-9)


def test_a_missing_topic_names_those_there_are(draw: Draw, tmp_path: Path) -> None:
    for name in KINDS:
        with pytest.raises(InputError, match=r"no such topic.*/camera \(sensor_msgs.*Image\), /ft"):
            import_log(draw(name), tmp_path / "rec", ImportSettings("/kamera"))
    assert not (tmp_path / "rec" / layout.SETTINGS).exists()
    assert not list((tmp_path / "rec").iterdir())


def test_a_wrench_in_other_axes_is_turned_when_it_is_said_how(draw: Draw, tmp_path: Path) -> None:
    log = draw(sensor="wrist")
    with pytest.raises(InputError, match=r"another frame of reference.*'tool'.*wrist"):
        import_log(log, tmp_path / "rec", BOTH)
    turn = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    settings = ImportSettings("/camera", "/ft", sensor="gelsight_mini", mm_per_px=0.03, rotation=turn)
    import_log(log, tmp_path / "rec", settings)
    forces = read_recording(tmp_path / "rec").forces
    assert forces is not None
    np.testing.assert_allclose(forces.force_N[3], [2.0, 1.0, -3.0])


ABOUT_X, ABOUT_Z = (HALF := 0.5**0.5, 0.0, 0.0, HALF), (0.0, 0.0, HALF, HALF)  # a quarter each


@pytest.mark.parametrize("name", KINDS)
def test_a_wrench_is_turned_by_the_logs_fixed_transforms(draw: Draw, tmp_path: Path, name: str) -> None:
    """v_flange = Rz v_wrist, v_flange = Rx v_tool, so v_tool = Rx^-1 Rz v_wrist; the flange itself moves."""
    moved = tuple(("/tf", "flange", "base", turn) for turn in (ABOUT_X, ABOUT_Z))
    fixed = ("/tf_static", "wrist", "flange", ABOUT_Z), ("/tf", "/tool", "/flange", ABOUT_X)
    import_log(draw(name, sensor="wrist", turns=(*moved, *fixed)), tmp_path / "rec", BOTH)
    forces = read_recording(tmp_path / "rec").forces
    assert forces is not None
    np.testing.assert_allclose(forces.force_N[3], [-2.0, 3.0, -1.0], atol=1e-12)  # (1, 2, 3), turned


def test_transforms_that_move_or_are_none_turn_no_wrench(draw: Draw, tmp_path: Path) -> None:
    moved = tuple(("/tf", "wrist", "tool", turn) for turn in (ABOUT_X, ABOUT_Z))
    circle = ("/tf", "wrist", "arm", ABOUT_X), ("/tf", "arm", "wrist", ABOUT_X)
    for number, turns in enumerate((moved, circle, (("/tf", "wrist", "arm", ABOUT_X),))):
        with pytest.raises(InputError, match=r"another frame.*no fixed transform between them.*State --rotation"):
            import_log(draw(f"{number}.mcap", sensor="wrist", turns=turns), tmp_path / "rec", BOTH)
    log = draw("none.mcap", sensor="wrist", turns=(("/tf", "wrist", "tool", (0.0, 0.0, 0.0, 0.0)),))
    with pytest.raises(InputError, match="the transform of 'wrist' is no rotation"):
        import_log(log, tmp_path / "rec", BOTH)


def test_a_topic_of_another_type_and_grey_pictures_are_refused(draw: Draw, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"of another type.*WrenchStamped.*Needed"):
        import_log(draw(), tmp_path / "rec", ImportSettings("/ft"))
    with pytest.raises(InputError, match=r"encoding are not read.*mono8"):
        import_log(draw("grey.mcap", encoding="mono8"), tmp_path / "rec", ImportSettings("/camera"))


@pytest.mark.parametrize("name", KINDS)
def test_every_cut_and_every_flipped_byte_is_told_or_harmless(draw: Draw, tmp_path: Path, name: str) -> None:
    whole = draw(name)
    storage = next(whole.glob("*.db3")) if whole.is_dir() else whole
    data, rng = storage.read_bytes(), np.random.default_rng(1)
    broken = tmp_path / f"broken{storage.suffix}"
    told: list[str] = []
    for trial in range(60):
        torn = bytearray(data[: rng.integers(1, len(data))] if trial % 2 else data)
        torn[rng.integers(len(torn))] ^= 1 << rng.integers(8)
        broken.write_bytes(torn)
        try:
            import_log(broken, tmp_path / "rec", BOTH)
        except InputError as fault:
            told.append(str(fault))
        shutil.rmtree(tmp_path / "rec", ignore_errors=True)
    assert len(told) >= 20
    assert not [said for said in told if "\n" in said]


def test_what_is_no_log_is_told(tmp_path: Path) -> None:
    (tmp_path / "text.bag").write_text("a text")
    with pytest.raises(InputError, match="by its first bytes"):
        list(read_log(tmp_path / "text.bag", {}))
    (tmp_path / "text.bag").unlink()
    with pytest.raises(InputError, match="no such log"):
        list(read_log(tmp_path / "none.bag", {}))
    with pytest.raises(InputError, match="no log that is read"):
        list(read_log(tmp_path, {}))
    (tmp_path / "log_0.db3").symlink_to(__file__)
    with pytest.raises(InputError, match="leads out of its folder"):
        list(read_log(tmp_path, {}))
    (tmp_path / "log_0.db3").rename(tmp_path / "log_0.db3.zstd")
    with pytest.raises(InputError, match="packed"):
        list(read_log(tmp_path, {}))


@pytest.mark.parametrize("way", ["BZ2", "LZ4"])
def test_a_packed_bag_of_ros_1_is_read(draw: Draw, tmp_path: Path, way: str) -> None:
    from rosbags.rosbag1 import Writer

    packed = tmp_path / "packed.bag"
    writer = Writer(packed)
    writer.set_compression(Writer.CompressionFormat[way])
    with AnyReader([draw("log.bag")]) as whole, writer:
        added = {
            one.topic: writer.add_connection(one.topic, one.msgtype, typestore=whole.typestore)
            for one in whole.connections
        }
        for about, at_ns, data in whole.messages():
            writer.write(added[about.topic], at_ns, bytes(data))
    assert packed.stat().st_size != (tmp_path / "log.bag").stat().st_size
    _same_frames(packed, tmp_path)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_packed_messages_of_ros_2_are_read(draw: Draw, tmp_path: Path, storage: str) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(tmp_path / "packed", version=8, storage_plugin=StoragePlugin[storage])
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with AnyReader([draw("log")]) as whole, writer:
        added = {
            one.topic: writer.add_connection(one.topic, one.msgtype, typestore=whole.typestore)
            for one in whole.connections
        }
        for about, at_ns, data in whole.messages():
            writer.write(added[about.topic], at_ns, bytes(data))
    _same_frames(tmp_path / "packed", tmp_path)


def _same_frames(log: Path, folder: Path) -> None:
    import_log(log, folder / "rec", BOTH)
    recording = read_recording(folder / "rec")
    for number, rgb in enumerate(pictures(4)):
        np.testing.assert_array_equal(read_frame(recording, number).rgb, rgb)


def test_pictures_that_were_packed_stay_as_they_came(tmp_path: Path) -> None:
    store, rgb = typestore("cdr"), np.kron(pictures(2), np.ones((1, 8, 8, 1), np.uint8))
    jpegs = [cv2.imencode(".jpg", one)[1] for one in rgb]
    with open_writer(tmp_path / "log.mcap") as (put, kind):
        for number, data in enumerate(jpegs):
            header = _header(START_NS + number, "camera", kind)
            put(
                "/camera",
                store.types[COMPRESSED](header=header, format="bgr8; jpeg compressed bgr8", data=data),
                1,
            )
    import_log(tmp_path / "log.mcap", tmp_path / "rec", ImportSettings("/camera"))
    kept = [path.read_bytes() for path in sorted((tmp_path / "rec" / "frames").iterdir())]
    assert kept == [one.tobytes() for one in jpegs]


@pytest.mark.parametrize(
    ("encoding", "code"),
    [("yuv422_yuy2", cv2.COLOR_RGB2YUV_YUY2), ("yuyv", cv2.COLOR_RGB2YUV_YUY2), ("uyvy", cv2.COLOR_RGB2YUV_UYVY)],
)
def test_pictures_of_paired_pixels_are_read(tmp_path: Path, encoding: str, code: int) -> None:
    y, x = np.mgrid[:24, :32].astype(np.float32)
    rgb = np.stack([60 + 3 * x, 90 + 2 * y, 170 - 2 * x], axis=2).astype(np.uint8)
    with open_writer(tmp_path / "log.mcap") as (put, kind):
        for number in range(2):
            at_ns = START_NS + number * 40_000_000
            data = cv2.cvtColor(rgb, code).reshape(-1)
            about = {"height": 24, "width": 32, "encoding": encoding, "is_bigendian": 0, "step": 64, "data": data}
            put("/camera", typestore(kind).types[IMAGE](header=_header(at_ns, "tool", kind), **about), at_ns)
    import_log(tmp_path / "log.mcap", tmp_path / "rec", FRAMES_ALONE)
    read = read_frame(read_recording(tmp_path / "rec"), 0).rgb.astype(int)
    assert np.abs(read - rgb).max() <= 6
    assert np.abs(np.mean(read - rgb.astype(int), axis=(0, 1))).max() < 1.0


def test_an_odd_width_of_paired_pixels_is_refused(tmp_path: Path) -> None:
    with open_writer(tmp_path / "log.mcap") as (put, kind):
        about = {"height": 2, "width": 3, "encoding": "yuyv", "is_bigendian": 0, "step": 6}
        data = np.zeros(12, np.uint8)
        put("/camera", typestore(kind).types[IMAGE](header=_header(START_NS, "tool", kind), data=data, **about), 1)
    with pytest.raises(InputError, match="paired pixels has an odd width"):
        import_log(tmp_path / "log.mcap", tmp_path / "rec", FRAMES_ALONE)
