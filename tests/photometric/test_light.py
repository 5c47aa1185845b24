"""A ready method says when it is used in another light than it was made in."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from lamp_room import SHAPE, flat

from tactilevision.errors import InputError
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reference_match import ReferenceMatch
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.network import Network, find_model
from tactilevision.photometric.reference import Reference, change_of_light, light_of, make_reference, other_light
from tactilevision.photometric.storage import save_method
from tactilevision.recording.model import Recording
from tactilevision.records.maps import LIGHT
from tactilevision.records.measured import Bytes
from tactilevision.sensors import get_sensor

RNG = np.random.default_rng(4)
OWN = flat(RNG)
TURNED = np.dstack([OWN[::-1, ::-1, 0], OWN[..., 1:]])  # one lamp on the other side
DIMMED = np.clip(np.array([0.8, 0.9, 0.6]) * OWN + RNG.normal(0, 1, OWN.shape), 0, 255).astype(np.uint8)


FOUND = find_model("gelslim3")
assert FOUND is not None
MODEL = FOUND


def reference(rgb: Bytes) -> Reference:
    return make_reference([rgb])


def test_noise_of_single_pixels_hides_no_other_light() -> None:
    """A method's error a pixel is mostly noise, its scale far better known."""
    method = CalibratedMethod(
        Network(MODEL.read_bytes(), 0.9, MODEL), reference(TURNED), 0.9, card=MethodCard(held_out_gain_std=0.05)
    )
    match, said = ReferenceMatch(method).with_light(light_of(reference(OWN)))
    assert "another light" in said[0]
    assert match.other_light
    match, said = match.with_light(light_of(reference(TURNED)))
    assert said == ()
    assert not match.other_light


def recording(folder: Path, rgb: Bytes) -> Recording:
    path = folder / "flat.png"
    cv2.imwrite(str(path), rgb[..., ::-1])
    sensor = get_sensor("gelslim3", width_px=rgb.shape[1], height_px=rgb.shape[0])
    return Recording(folder, "other", sensor, flats=(path,))


def saved(folder: Path) -> Path:
    law = Network(MODEL.read_bytes(), 0.9, MODEL)
    return save_method(
        CalibratedMethod(law, reference(OWN), 0.15, card=MethodCard(sensor="gelslim3")), folder / "own"
    )


def test_exposure_and_white_balance_are_no_change_of_light() -> None:
    assert change_of_light(light_of(reference(OWN)), light_of(reference(DIMMED))) < 0.03
    assert other_light(light_of(reference(OWN)), reference(DIMMED), scale_error=0.05) == ()


def test_the_change_is_the_share_by_which_the_pattern_of_brightness_changed() -> None:
    before = light_of(reference(OWN))
    after = before * np.exp(0.2 * np.where(np.arange(8) % 2, 1, -1))[None, :, None]
    assert change_of_light(before, after) == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("suffix", [".npz", ".onnx"])
def test_another_light_is_warned_of(suffix: str, tmp_path: Path) -> None:
    path = saved(tmp_path).with_suffix(suffix)
    if suffix == ".onnx":  # carried without its numbers, its error in its own light on its card
        path.with_suffix(".npz").unlink()
        card = json.loads(path.with_suffix(".json").read_text()) | {"held_out_relative_error": 0.15}
        path.with_suffix(".json").write_text(json.dumps(card))
    found = build_reconstructor(recording(tmp_path, TURNED), str(path))
    assert "made in another light" in found.warnings[0]
    assert LIGHT in found.rectified_map(TURNED).flags
    assert build_reconstructor(recording(tmp_path, OWN), str(path)).warnings == ()
    assert build_reconstructor(recording(tmp_path, DIMMED), str(path)).warnings == ()


def test_the_network_for_any_light_knows_no_other(tmp_path: Path) -> None:
    assert build_reconstructor(recording(tmp_path, TURNED), str(MODEL)).warnings == ()


def test_pictures_of_another_shape_are_refused_and_resized_ones_are_not(tmp_path: Path) -> None:
    path = str(saved(tmp_path))
    half = cv2.resize(OWN, (SHAPE[1] // 2, SHAPE[0] // 2), interpolation=cv2.INTER_AREA)
    assert build_reconstructor(recording(tmp_path, np.asarray(half, np.uint8)), path).warnings == ()
    with pytest.raises(InputError, match="pictures of another shape"):
        build_reconstructor(recording(tmp_path, OWN[:, : SHAPE[1] // 2]), path)


def test_a_ready_method_in_memory_warns_too(tmp_path: Path) -> None:
    from tactilevision.photometric.storage import load_method

    method = dataclasses.replace(load_method(saved(tmp_path)), relative_error=0.1)
    assert "another light" in build_reconstructor(recording(tmp_path, TURNED), method).warnings[0]
