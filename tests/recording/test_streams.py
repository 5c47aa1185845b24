"""Pictures come one after another: whole, flagged where torn, and never many at a time."""

from __future__ import annotations

import gc
import os
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from each import each
from small_recording import edit, picture, write_small

from tactilevision.errors import InputError, RecordingError
from tactilevision.recording.folder import read_folder
from tactilevision.recording.images import count_frames
from tactilevision.recording.model import BadFrame, Recording
from tactilevision.recording.pictures import iter_frames, read_frame
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Sensor


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_small(tmp_path / "small")


def names(recording: Recording, start_s: float = -np.inf, end_s: float = np.inf) -> list[str]:
    return [frame.name for frame in iter_frames(recording, start_s, end_s=end_s)]


def test_frames_come_in_order_and_in_their_window(folder: Path) -> None:
    recording = read_recording(folder)
    assert names(recording) == [f"f{i}.png" for i in range(10)]
    assert names(recording, 0.2, 0.5) == ["f2.png", "f3.png", "f4.png", "f5.png"]
    assert names(recording, 5.0) == []
    for index, frame in enumerate(iter_frames(recording)):
        assert isinstance(frame, Frame)
        np.testing.assert_array_equal(frame.rgb, picture(index))
        assert frame.time_s == pytest.approx(index / 10)


def test_one_frame_is_read_by_its_number(folder: Path) -> None:
    recording = read_recording(folder)
    np.testing.assert_array_equal(read_frame(recording, 3).rgb, picture(3))
    assert read_frame(recording, -1).name == "f9.png"
    with pytest.raises(InputError, match="the recording has 10 frames"):
        read_frame(recording, 10)


def cut_to(path: Path, share: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


@each("suffix", [".png", ".jpg", ".tiff", ".bmp", ".npy"])
@each("share", [0.0, 0.02, 0.5, 0.98])
def test_a_torn_picture_is_flagged_and_the_rest_goes_on(tmp_path: Path, suffix: str, share: float) -> None:
    folder = write_small(tmp_path / "small")
    write_image(folder / f"frames/torn{suffix}", picture(4))
    cut_to(folder / f"frames/torn{suffix}", share)
    edit(folder / "frames.csv", "f4.png", f"torn{suffix}")
    recording = read_recording(folder)
    frames = list(iter_frames(recording))
    torn = frames[4]
    assert isinstance(torn, BadFrame)
    assert (torn.name, torn.time_s) == (f"torn{suffix}", 0.4)
    assert sum(isinstance(frame, Frame) for frame in frames) == 9
    with pytest.raises(RecordingError, match=f"frame torn{suffix}"):
        read_frame(recording, 4)


def test_a_torn_first_picture_does_not_hide_the_size(folder: Path) -> None:
    cut_to(folder / "frames/f0.png", 0.5)
    recording = read_recording(folder)
    assert recording.frame_size_px == (32, 24)
    assert isinstance(next(iter_frames(recording)), BadFrame)


def test_pictures_that_are_all_torn_are_an_error(folder: Path) -> None:
    for path in (folder / "frames").iterdir():
        cut_to(path, 0.5)
    with pytest.raises(RecordingError, match=r"frames: none of the first pictures can be read: f0.png, f1.png"):
        read_recording(folder)


def test_two_sizes_are_an_error_even_in_a_later_window(folder: Path) -> None:
    write_image(folder / "frames/f7.png", picture(7, width=40))
    recording = read_recording(folder)
    with pytest.raises(RecordingError, match=r"two sizes: f7.png is 40 x 24, those before 32 x 24"):
        names(recording, 0.65)
    with pytest.raises(RecordingError, match="two sizes"):
        read_frame(recording, 7)


def test_a_grey_picture_is_an_error(folder: Path) -> None:
    cv2.imwrite(str(folder / "frames/f3.png"), picture(3)[..., 0])
    with pytest.raises(RecordingError, match=r"f3.png: the picture is grey, but photometric stereo needs"):
        names(read_recording(folder))


def test_a_long_stream_holds_only_a_few_pictures(tmp_path: Path) -> None:
    for index in range(4):
        write_image(tmp_path / f"{index}.png", picture(index, width=160, height=120))
    recording = read_folder(tmp_path, sensor=Sensor("custom", 160, 120, (0.1, 0.1)))
    recording = replace(recording, frame_names=recording.frame_names * 100, frame_times_s=np.arange(400.0))
    one = 160 * 120 * 3
    tracemalloc.start()
    count = sum(isinstance(frame, Frame) for frame in iter_frames(recording))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == 400
    assert peak < 20 * one, "a few pictures and what decoding them takes, not 400"


def test_a_stream_may_be_left_early(folder: Path) -> None:
    stream = iter_frames(read_recording(folder))
    next(stream)
    del stream
    gc.collect()


def write_video(path: Path, code: str, pictures: list[Bytes]) -> None:
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 30.0, (width, height))
    if not writer.isOpened():
        pytest.skip(f"this OpenCV cannot write {code}")
    for rgb in pictures:
        writer.write(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    writer.release()


def flat_picture(index: int, size: int = 48) -> Bytes:
    """One colour that tells the frame's number, so that a codec with losses keeps it too."""
    return np.full((size, size, 3), (10 + 8 * index, 128, 240 - 8 * index), dtype=np.uint8)


def make_video_recording(folder: Path, name: str, code: str, count: int = 10) -> Path:
    for path in sorted((folder / "frames").iterdir()):
        path.unlink()
    (folder / "frames").rmdir()
    write_video(folder / name, code, [flat_picture(index) for index in range(count)])
    text = (folder / "frames.csv").read_text().replace("f", "").replace(".png", "")
    (folder / "frames.csv").write_text("f" + text)
    for name_of in ("flat/untouched.png", "ball/b1.png"):
        write_image(folder / "reference" / name_of, flat_picture(0))
    settings = (folder / "recording.toml").read_text().replace("= 32", "= 48").replace("= 24", "= 48")
    (folder / "recording.toml").write_text(settings)
    return folder


VIDEOS = [("frames.avi", "FFV1"), ("frames.mkv", "FFV1"), ("frames.avi", "MJPG"), ("frames.mp4", "mp4v")]


@each("name, code", VIDEOS)
def test_frames_of_a_video_are_found_by_their_number(tmp_path: Path, name: str, code: str) -> None:
    folder = write_small(tmp_path / "small")
    recording = read_recording(make_video_recording(folder, name, code))
    assert recording.frame_names == tuple(str(i) for i in range(10))
    windows = [(0.0, 0.3), (0.35, 0.6), (0.75, 2.0), (0.1, 0.2)]  # on from where one stopped, then back
    for start_s, end_s in windows:
        for frame in iter_frames(recording, start_s, end_s=end_s):
            assert isinstance(frame, Frame)
            expected = flat_picture(int(frame.name)).astype(int)
            # neighbours differ by 8; codecs with losses stay within 4 on a single colour
            assert np.abs(frame.rgb.astype(int) - expected).max() <= 4
    np.testing.assert_allclose(read_frame(recording, 7).rgb[0, 0], flat_picture(7)[0, 0], atol=4)


def test_a_grey_video_is_refused(folder: Path) -> None:
    """Its decoder makes three equal colours of it."""
    grey = [np.repeat(picture(index)[..., :1], 3, axis=2) for index in range(10)]
    make_video_recording(folder, "frames.avi", "FFV1")
    write_video(folder / "frames.avi", "FFV1", grey)
    with pytest.raises(RecordingError, match=r"frames.avi: the picture is grey"):
        read_recording(folder)


def test_two_streams_of_one_video_do_not_disturb_each_other(folder: Path) -> None:
    recording = read_recording(make_video_recording(folder, "frames.avi", "FFV1"))
    pairs = zip(iter_frames(recording), iter_frames(recording, 0.35), strict=False)
    assert [(a.name, b.name) for a, b in pairs] == [(str(i), str(i + 4)) for i in range(6)]
    reds = [frame.rgb[0, 0, 0] for frame in iter_frames(recording) if isinstance(frame, Frame)]
    assert all(after > before for before, after in pairwise(reds))


def test_a_video_may_be_listed_with_gaps(folder: Path) -> None:
    make_video_recording(folder, "frames.mkv", "FFV1")
    (folder / "frames.csv").write_text("frame,time_s\n1,0.1\n4,0.4\n9,0.9\n")
    frames = [frame for frame in iter_frames(read_recording(folder)) if isinstance(frame, Frame)]
    assert [int(frame.rgb[0, 0, 0]) for frame in frames] == [18, 42, 82]


def test_a_video_of_huge_pictures_needs_too_much_memory(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_video_recording(folder, "frames.mkv", "FFV1")
    monkeypatch.setenv("TACTILEVISION_MAX_CHILD_MB", "1")
    with pytest.raises(InputError, match=r"frames.mkv: .*memory.*TACTILEVISION_MAX_CHILD_MB"):
        read_recording(folder)


def test_whole_numbers_may_be_written_as_a_spreadsheet_does(folder: Path) -> None:
    make_video_recording(folder, "frames.mkv", "FFV1")
    (folder / "frames.mkv").rename(folder / "frames.MKV")
    (folder / "frames.csv").write_text("frame,time_s\n1.0,1e-1\n4.0,0.4\n")
    assert read_recording(folder).frame_names == ("1", "4")


@pytest.mark.parametrize(
    ("listed", "said"),
    [
        ("0,0\n1,0.1\n12,0.9\n", "line 4: frame 12 is missing: frames.avi has 10 frames"),
        ("0,0\n1,0.1\n1.5,0.9\n", r"line 4: frames of a video \(frames.avi\) are numbers, from 0"),
        ("0,0\n3,0.1\n2,0.9\n", "line 4: frame 2 comes after frame 3"),
    ],
)
def test_faults_in_the_list_of_a_video_are_named(folder: Path, listed: str, said: str) -> None:
    make_video_recording(folder, "frames.avi", "FFV1")
    (folder / "frames.csv").write_text("frame,time_s\n" + listed)
    with pytest.raises(RecordingError, match=said):
        read_recording(folder)


def test_a_video_cut_short_is_flagged_from_there_on(folder: Path) -> None:
    make_video_recording(folder, "frames.avi", "MJPG", count=40)
    (folder / "frames.csv").write_text("frame,time_s\n" + "".join(f"{i},{i / 10}\n" for i in range(40)))
    whole = read_recording(folder)
    os.truncate(folder / "frames.avi", (folder / "frames.avi").stat().st_size // 2)
    frames = list(iter_frames(whole))
    bad = [isinstance(frame, BadFrame) for frame in frames]
    assert len(frames) == 40
    assert 10 < sum(bad) < 40
    assert bad == sorted(bad)
    assert count_frames(folder / "frames.avi") == 40 - sum(bad)


def test_two_videos_are_an_error(folder: Path) -> None:
    make_video_recording(folder, "frames.avi", "FFV1")
    write_video(folder / "frames.mkv", "FFV1", [flat_picture(0)])
    with pytest.raises(RecordingError, match="there are 2 videos of frames"):
        read_recording(folder)


def test_a_file_that_is_no_video_is_named(folder: Path) -> None:
    make_video_recording(folder, "frames.avi", "FFV1")
    (folder / "frames.avi").write_bytes(b"no video")
    with pytest.raises(RecordingError, match=r"frames.avi: the video cannot be opened"):
        read_recording(folder)


def test_a_listed_picture_that_is_gone_is_named_and_passed_over(folder: Path) -> None:
    for name in ("f0.png", "f3.png"):
        (folder / "frames" / name).unlink()
    read = read_recording(folder)
    said = "frames.csv: 2 of 10 pictures listed are missing and are skipped: f0.png, f3.png"
    assert said in read.warnings
    frames = list(iter_frames(read))
    assert [frame.name for frame in frames if isinstance(frame, BadFrame)] == ["f0.png", "f3.png"]
    assert [frame.why for frame in frames if isinstance(frame, BadFrame)] == ["the file is missing"] * 2
    assert len(frames) == 10


def test_a_list_of_which_most_is_missing_is_of_other_pictures(folder: Path) -> None:
    for k in range(6):
        (folder / f"frames/f{k}.png").rename(folder / f"frames/g{k}.png")
    with pytest.raises(RecordingError, match=r"line 2: 6 of 10 pictures listed are missing, the first is f0.png"):
        read_recording(folder)
