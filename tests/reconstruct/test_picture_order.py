"""Pictures mirrored, or red changed for blue, are named by the curl of what a ready network reads in them."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from shared_scenes import SAMPLE

from tactilevision.errors import InputError
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.scene_faults import check_surface, curl_share, order_warnings
from tactilevision.photometric.methods.network import find_model
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_network
from tactilevision.recording.folder import read_folder
from tactilevision.recording.pictures import read_flats, read_frame, read_reference
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Bytes
from tactilevision.sensors.rectification import rectify

EXCHANGES: dict[str, Callable[[Bytes], Bytes]] = {
    "": lambda rgb: rgb,
    "red and blue exchanged (BGR for RGB)": lambda rgb: rgb[..., ::-1],
    "the picture mirrored": lambda rgb: rgb[::-1],
}


@lru_cache
def sample() -> tuple[list[Bytes], list[Bytes]]:
    """The untouched gel and six ball presses of the sample."""
    recording = read_recording(SAMPLE)
    shots = [read_reference(recording, ball.path) for ball in recording.balls[:6]]
    flats = read_flats(recording)
    return [rectify(recording.sensor, rgb) for rgb in flats], [rectify(recording.sensor, rgb) for rgb in shots]


@pytest.mark.parametrize("said", EXCHANGES)
def test_exchanged_pictures_are_named_and_others_are_not(said: str) -> None:
    sensor, path = read_recording(SAMPLE).sensor, find_model("gelslim3")
    assert path is not None
    flats, shots = ([np.ascontiguousarray(EXCHANGES[said](rgb)) for rgb in many] for many in sample())
    warned = order_warnings(path, flats, shots, sensor=sensor)
    assert len(warned) == bool(said)
    assert all(said in one for one in warned)
    assert said or order_warnings(path, flats, flats[:3], sensor=sensor) == (), "untouched gel shows no order"


@pytest.mark.parametrize("swapped", [False, True])
def test_who_reads_such_a_folder_is_warned_and_its_maps_are_flagged(
    tmp_path: Path, swapped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The network reads alone, as where the contacts do not determine the light."""
    monkeypatch.setattr("tactilevision.heightmap.build.calibrated_on_frames", lambda *_, **__: None)
    recording = read_recording(SAMPLE)
    shot = rectify(recording.sensor, read_frame(recording, 60).rgb)
    for name, rgb in (("ref", sample()[0][0]), ("0", shot)):
        write_image(tmp_path / f"{name}.png", np.ascontiguousarray(rgb[..., ::-1] if swapped else rgb))
    found = build_reconstructor(read_folder(tmp_path, "gelslim3", guess=True))
    assert any("the frames show no surface" in one for one in found.warnings) == swapped
    assert ("light" in found.rectified_map(shot[..., ::-1].copy() if swapped else shot).flags) == swapped


def test_contacts_whose_slopes_are_no_surface_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A whirl in a bowl, read by a network; without a contact nothing is judged."""
    flats, shots = sample()
    path = find_model("gelslim3")
    assert path is not None
    network = load_network(path, make_reference(flats))
    sensor = read_recording(SAMPLE).sensor
    check_surface(network, shots, sensor=sensor, where=SAMPLE)
    monkeypatch.setattr(network, "slopes", Field(0.7).slopes)
    check_surface(network, [], sensor=sensor, where=SAMPLE)
    with pytest.raises(InputError, match="the light is not that of a usual gelslim3"):
        check_surface(network, shots, sensor=sensor, where=SAMPLE)


class Field:
    """Reads every picture as one field of slopes: a bowl, and in it a whirl of `share` of the squared ones."""

    name = "field"

    def __init__(self, share: float) -> None:
        self.share = share

    def slopes(self, rgb_rectified: Bytes) -> SlopeMap:
        shape = rgb_rectified.shape[:2]
        y, x = (at - 0.5 * (n - 1) for at, n in zip(np.indices(shape), shape, strict=True))
        near = np.exp(-(x**2 + y**2) / (2 * 15.0**2)) / 15.0
        bowl, whirl = np.sqrt(1.0 - self.share) * near, np.sqrt(self.share) * near
        return SlopeMap(-bowl * x - whirl * y, -bowl * y + whirl * x)


@pytest.mark.parametrize("share", [0.0, 0.25, 1.0])
def test_curl_is_the_share_of_the_slopes_that_no_surface_has(share: float) -> None:
    frames = [np.zeros((120, 160, 3), np.uint8)] * 2
    assert curl_share(Field(share), frames, (0.06, 0.06)) == pytest.approx(share, abs=0.01)
    assert np.isnan(curl_share(Field(share), [], (0.06, 0.06)))
