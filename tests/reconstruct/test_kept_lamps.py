"""A method's file keeps the lamps: shadows are undone where no ball is at hand; files of before have none."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.heightmap.build import calibrate_light
from tactilevision.heightmap.lamps import find_lamps
from tactilevision.heightmap.shadows_seen import with_shadows
from tactilevision.photometric.illumination.kept_lamps import lamp_arrays, lamps_of
from tactilevision.photometric.illumination.lamps import Lamp, Lamps
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.storage import digest, load_method, save_method
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "rendered_shadows"
LAMPS = Lamps(
    (
        Lamp(0.1, 20.0, 9.0, 15.0, 0.5, (0.9, 0.2, 0.1)),
        Lamp(2.2, 21.0, 8.0, 15.0, -0.5, (0.1, 0.8, 0.3)),
        Lamp(-2.0, 22.0, 7.0, 15.0, 0.0, (0.1, 0.1, 0.7)),
    ),
    2.1,
    0.9,
)


@pytest.mark.slow
def test_a_saved_method_undoes_shadows_as_the_balls_do(tmp_path: Path) -> None:
    recording = read_recording(SAMPLE)
    made = calibrate_light(recording, "polynomial")
    assert isinstance(made.referenced, CalibratedMethod)
    path = save_method(dataclasses.replace(made.referenced, lamps=find_lamps(recording, made)), tmp_path / "m")
    bare = dataclasses.replace(recording, balls=())
    kept = with_shadows(bare, calibrate_light(bare, str(path)))
    assert kept.shadows is not None
    assert find_lamps(recording, made) is find_lamps(recording, made), "balls are read once"
    by_balls = with_shadows(recording, made)
    frame = read_frame(recording, 6)
    assert np.abs(kept.height_map(frame).depth_mm - by_balls.height_map(frame).depth_mm).max() < 0.005
    without = save_method(dataclasses.replace(made.referenced, lamps=None), tmp_path / "older")
    assert with_shadows(bare, calibrate_light(bare, str(without))).shadows is None


def test_lamps_come_back_as_they_went() -> None:
    refined = dataclasses.replace(LAMPS, refined=dataclasses.replace(LAMPS, power=1.9))
    assert lamps_of(lamp_arrays(refined), where=Path("m.npz")) == refined
    assert lamps_of(lamp_arrays(LAMPS), where=Path("m.npz")) == LAMPS
    assert lamps_of({}, where=Path("m.npz")) is None
    four = dataclasses.replace(LAMPS, lamps=(*LAMPS.lamps, Lamp(1.1, 19.0, 8.0, 15.0, 0.0, (0.5, 0.1, 0.1))))
    doubtful = dataclasses.replace(four, refined=LAMPS, unexplained=0.2)
    assert lamps_of(lamp_arrays(doubtful), where=Path("m.npz")) == doubtful
    assert doubtful.doubtful
    assert not four.doubtful


@pytest.mark.parametrize("count", [0, 2, 7])
def test_no_sensor_has_two_lamps_or_seven(count: int) -> None:
    arrays = lamp_arrays(LAMPS)
    for name in ("lamps_places", "lamps_colours"):
        arrays[name] = np.tile(arrays[name], (3, 1))[:count]
    with pytest.raises(InputError, match="three to 6 lamps"):
        lamps_of(arrays, where=Path("m.npz"))


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("lamps_places", (1, 2), -3.0),
        ("lamps_places", (0, 1), 1e9),
        ("lamps_colours", (2, 0), -0.1),
        ("lamps_camera", (0,), 0.0),
        ("lamps_camera", (1,), -1.0),
    ],
)
def test_lamps_that_no_sensor_has_are_refused(name: str, place: tuple[int, ...], value: float) -> None:
    arrays = lamp_arrays(LAMPS)
    arrays[name][place] = value
    with pytest.raises(InputError):
        lamps_of(arrays, where=Path("m.npz"))


@pytest.mark.parametrize("broken", [np.zeros((2, 5)), np.full((3, 5), np.nan), np.full((3, 5), "x"), None])
def test_a_file_whose_lamps_do_not_fit_is_refused(broken: np.ndarray | None, tmp_path: Path) -> None:
    before = Path(__file__).parents[1] / "data" / "before"
    source = next(path for path in sorted(before.rglob("*.npz")) if path.with_suffix(".json").is_file())
    with np.load(source) as file:
        arrays = dict(file)
    card, path = json.loads(source.with_suffix(".json").read_text()), tmp_path / "method.npz"

    def write(lamps: dict[str, np.ndarray]) -> None:
        np.savez(path, allow_pickle=False, **arrays, **lamps)
        path.with_suffix(".json").write_text(json.dumps(card | {"sha256": digest(path)}))

    write(lamp_arrays(LAMPS))
    assert load_method(path).lamps == LAMPS
    rest = {name: values for name, values in lamp_arrays(LAMPS).items() if name != "lamps_colours"}
    write(rest if broken is None else lamp_arrays(LAMPS) | {"lamps_places": broken})
    with pytest.raises(InputError):
        load_method(path)
    assert load_method(source).lamps is None
