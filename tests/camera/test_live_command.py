"""`live` on a folder, a video and a camera that is drawn: numbers, drops, a page, and a camera that goes."""

from __future__ import annotations

import csv
import json
import re
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from test_sources import FakeCapture

from tactilevision.cli import main
from tactilevision.errors import InputError, OutputError
from tactilevision.profile.sensor import load_sensor
from tactilevision.recording.write import write_image
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes
from tactilevision.robots import camera as sources
from tactilevision.robots.live import Counts, LiveResult, Stream
from tactilevision.robots.preview import Foxglove, Preview, draw, words

sys.path.insert(0, str(Path(__file__).parents[1] / "profile"))
from lamp_sensor import SHAPE, free, pressed, saved


def run(*words: object) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        return main()


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("live"))


def frames() -> list[Bytes]:
    """Six frames of free gel, three of a press, one of free gel."""
    return [free(seed) for seed in range(6)] + [pressed(seed) for seed in range(3)] + [free(9)]


def folder(root: Path) -> Path:
    for number, rgb in enumerate(frames()):
        write_image(root / f"{number}.png", rgb)
    return root


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_a_folder_played_gives_contact_and_force_of_every_frame(
    profile: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = tmp_path / "told.json"
    words = ("--camera", folder(tmp_path / "frames"), "--sensor", profile, "--every")
    assert run("live", *words, "--out", tmp_path / "out", "--json", told) == 0
    found = rows(tmp_path / "out" / "live.csv")
    assert [row["contact"] for row in found] == list("0000001110")
    assert all(float(row["fz_N"]) > 0.1 for row in found[6:9])
    assert all(float(row["fz_N"]) == 0 for row in found[:6])
    assert found[6]["fx_N"] == ""
    content = json.loads(told.read_text())
    assert (content["frames"], content["dropped"], content["refused"]) == (10, 0, 0)
    assert sum(count for _, count in content["histogram"]) == 10
    assert content["audit"]["repeated"] == 0
    said = capsys.readouterr()
    assert "10 frames read of 10 that came, 0 dropped" in said.out
    assert " ms " in said.out.splitlines()[-1]


def test_a_video_is_played_at_its_rate_and_frames_are_dropped_rather_than_kept_waiting(
    profile: Path, tmp_path: Path
) -> None:
    path, told = tmp_path / "film.avi", tmp_path / "told.json"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, SHAPE[::-1])
    for rgb in frames() * 8:
        video.write(rgb[..., ::-1])
    video.release()
    assert run("live", "--camera", path, "--sensor", profile, "--rate", 2000, "--json", told) == 0
    content = json.loads(told.read_text())
    assert content["frames"] + content["dropped"] == 80
    assert content["dropped"] > 0  # how many depends on the load of the machine
    assert np.isfinite(content["age95_ms"])
    assert run("live", "--camera", path, "--sensor", profile, "--every", "--frames", 3, "--json", told) == 0
    assert json.loads(told.read_text())["frames"] == 3


def with_camera(monkeypatch: pytest.MonkeyPatch, pictures: list[Any], exposure: float = 1.0) -> None:
    """The next camera that is opened gives these, red first, some hundred a second, and then no more."""

    class Paced(FakeCapture):
        def read(self) -> tuple[bool, Any]:
            time.sleep(0.005)
            return super().read()

    def opened(number: int, *, form: str | None = None) -> sources.Camera:
        return sources.Camera(Paced([rgb[..., ::-1] for rgb in pictures], exposure), f"camera {number}")

    monkeypatch.setattr(sources, "GONE_S", 0.2)
    monkeypatch.setattr(sources, "open_camera", opened)


def test_a_camera_that_goes_in_the_middle_ends_with_a_sentence_and_whole_rows(
    profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with_camera(monkeypatch, [*frames() * 6, *frames()])
    assert run("live", "--camera", 0, "--sensor", profile, "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "error: camera 0: the camera has gone" in said
    assert said.count("error:") == 1
    found = rows(tmp_path / "out" / "live.csv")
    assert len(found) >= 1
    assert all(None not in row.values() for row in found)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"live.csv", "patches.csv"}


def test_a_camera_is_audited_before_it_is_trusted(
    profile: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    same = free(0)
    with_camera(monkeypatch, [same] * 1000, sources.AUTOMATIC)
    assert run("live", "--camera", 0, "--sensor", profile, "--frames", 2) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "the camera's exposure is automatic" in said
    assert "59 of 60 frames repeat the one before" in said


def test_a_camera_of_another_size_without_a_profile_or_told_wrongly_is_refused(
    profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with_camera(monkeypatch, [free(0)[:90]] * 60)
    assert run("live", "--camera", 0, "--sensor", profile) == 2
    assert "another size than those" in capsys.readouterr().err
    assert run("live", "--camera", 0) == 2
    assert "a camera needs a calibrated sensor" in capsys.readouterr().err
    assert run("live", "--camera", folder(tmp_path / "f"), "--sensor", profile, "--format", "raw") == 2
    assert "only a camera has a format" in capsys.readouterr().err
    black = [np.zeros((*SHAPE, 3), np.uint8)] * 3
    for number, rgb in enumerate(black):
        write_image(tmp_path / "black" / f"{number}.png", rgb)
    assert run("live", "--camera", tmp_path / "black", "--sensor", profile, "--every") == 2
    assert "no frame could be read" in capsys.readouterr().err


def test_the_histogram_names_its_last_step_by_where_it_begins() -> None:
    counts = Counts()
    for age_ms in (0.2, 300.0, 4000.0):
        counts.add(age_ms)
    steps = [line.split("#")[0].split() for line in counts.lines()]
    assert steps == [
        ["0", "to", "0.5", "ms", "1"],
        ["250", "to", "500", "ms", "1"],
        ["over", "1000", "ms", "1"],
    ]
    assert len({len(line.split("#")[0]) for line in counts.lines()}) == 1, "the bars stand below each other"


def test_a_newer_reference_is_taken(profile: Path, tmp_path: Path) -> None:
    words = ("--camera", folder(tmp_path / "f"), "--sensor", profile, "--every", "--frames", 2)
    assert run("live", *words, "--reference", tmp_path / "f" / "0.png") == 0


def told(profile: Path, rgb: Bytes) -> LiveResult:
    stream = Stream(load_sensor(profile))
    stream.take(Frame(free(1)))
    return LiveResult(sources.Shot(rgb, 0.0, 7, "a.png"), stream.take(Frame(rgb)), 12.3)


def test_the_page_shows_picture_depth_and_numbers(profile: Path) -> None:
    seen = told(profile, pressed())
    lines = words(seen, rate_Hz=60.0)
    assert lines[0].startswith("a.png: contact, 0.4")
    assert "fz +0." in lines[1]
    assert "fx" not in lines[1], "what is not known is not shown"
    assert lines[2] == "60 frames a second, 12 ms old"
    unseen = re.fullmatch(
        r"a.png: nothing touches, no force above (0\.\d+) N", words(told(profile, free(3)), rate_Hz=60.0)[0]
    )
    assert unseen is not None
    assert 0 < float(unseen[1]) < 0.1
    picture = draw(pressed(), seen, rate_Hz=60.0)
    assert picture.shape[1] == 2 * SHAPE[1]
    with Preview(load_sensor(profile).reconstructor, 0) as page:
        page.show(seen, 60.0)
        with urllib.request.urlopen(page.address, timeout=10) as answer:  # noqa: S310 - our own page
            assert b"page.js" in answer.read()
        with urllib.request.urlopen(page.address + "frame.jpg", timeout=10) as answer:  # noqa: S310
            shown = cv2.imdecode(np.frombuffer(answer.read(), np.uint8), cv2.IMREAD_COLOR)
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(page.address.replace(page.token, "other"), timeout=10)  # noqa: S310
        with pytest.raises(InputError, match="port cannot be used"):
            Preview(load_sensor(profile).reconstructor, page.port)
    assert shown is not None
    assert np.abs(shown.astype(int) - picture).mean() < 6


def test_an_mcap_file_holds_every_frame_for_another_reader(profile: Path, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    path = tmp_path / "out" / "live.mcap"
    words = ("--camera", folder(tmp_path / "f"), "--sensor", profile, "--every", "--mcap", path)
    assert run("live", *words) == 0
    counts: dict[str, int] = {}
    wrenches, schemas = [], {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            schemas[channel.topic] = "" if schema is None else schema.name
            if channel.topic == "/wrench":
                wrenches.append(json.loads(message.data))
            if channel.topic == "/depth":
                assert len(message.data) > 4 * SHAPE[0] * SHAPE[1]
    assert counts == dict.fromkeys(("/picture", "/depth", "/state", "/tractions", "/wrench", "/patches"), 10)
    assert (schemas["/picture"], schemas["/depth"]) == ("foxglove.RawImage", "foxglove.Grid")
    assert wrenches[0]["force_N"] == [None, None, 0.0], "shear is not measured here"
    assert wrenches[7]["force_N"][:2] == [None, None]
    assert wrenches[7]["force_N"][2] > 0.1
    assert [name.name for name in path.parent.iterdir()] == ["live.mcap"]


def test_an_mcap_file_that_cannot_be_ended_is_told_and_leaves_nothing(profile: Path, tmp_path: Path) -> None:
    class Full:
        def close(self) -> None:
            raise RuntimeError("MCAP error: No space left on device")

    reconstructor = load_sensor(profile).reconstructor
    for ended, said in ((None, r"live.mcap: cannot be written: .*No space left"), (KeyboardInterrupt, None)):
        outlet = Foxglove(reconstructor, mcap=tmp_path / "live.mcap")
        assert outlet._writer is not None
        outlet._writer.close()
        outlet._writer = Full()
        with pytest.raises(ended or OutputError, match=said), outlet:
            if ended is not None:
                raise ended
        assert list(tmp_path.iterdir()) == []


def test_an_mcap_file_is_whole_where_the_camera_went(
    profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mcap.reader import make_reader

    with_camera(monkeypatch, frames() * 7)
    path = tmp_path / "out" / "live.mcap"
    assert run("live", "--camera", 0, "--sensor", profile, "--mcap", path) == 2
    with path.open("rb") as file:
        assert any(True for _ in make_reader(file).iter_messages(topics=["/wrench"]))
    assert [name.name for name in path.parent.iterdir()] == ["live.mcap"]


def test_without_its_package_foxglove_is_refused_in_a_sentence(
    profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    words = ("--camera", folder(tmp_path / "f"), "--sensor", profile, "--foxglove")
    assert run("live", *words) == 2
    told = capsys.readouterr()
    assert "pip install '.[foxglove]'" in told.err
    assert told.out == ""  # before the light is calibrated and the camera looked at


def test_ctrl_c_ends_with_the_sums_of_what_was_read(
    profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    take, calls = Stream.take, []

    def interrupted(stream: Stream, frame: Frame) -> Any:
        calls.append(frame.name)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return take(stream, frame)

    monkeypatch.setattr(Stream, "take", interrupted)
    words = ("--camera", folder(tmp_path / "f"), "--sensor", profile, "--every", "--out", tmp_path / "out")
    assert run("live", *words) == 130
    assert "3 frames read of " in capsys.readouterr().out
    assert len(rows(tmp_path / "out" / "live.csv")) == 3


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        ("/dev/video93", r"no camera of that number can be opened (got 93)"),
        ("rtsp://127.0.0.1/x", "network streams are not supported"),
    ],
)
def test_a_camera_by_its_device_and_a_stream_are_told(
    profile: Path, capsys: pytest.CaptureFixture[str], camera: str, said: str
) -> None:
    assert run("live", "--camera", camera, "--sensor", profile) == 2
    assert said in capsys.readouterr().err


def test_no_frame_counts_as_dropped_where_every_one_is_read(profile: Path, tmp_path: Path) -> None:
    told = tmp_path / "told.json"
    assert (
        run("live", "--camera", folder(tmp_path), "--sensor", profile, "--every", "--frames", 3, "--json", told)
        == 0
    )
    assert (json.loads(told.read_text())["frames"], json.loads(told.read_text())["dropped"]) == (3, 0)
