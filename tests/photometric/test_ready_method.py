"""The network that comes along reads gels like GelSlim's before any calibration, and says whose it is not."""

from __future__ import annotations

import json
import pickle
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from lamp_room import flat, with_dots

from benchmarks import ready_cards
from tactilevision.errors import InputError
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.photometric.methods.network import Network, find_model
from tactilevision.photometric.random_lights import draw_samples
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_network
from tactilevision.recording.model import Recording
from tactilevision.sensors import get_sensor


def recording(folder: Path, kind: str, *, flats: int = 1, marks: bool = False) -> Recording:
    frame = flat(np.random.default_rng(0))
    frame = with_dots(frame) if marks else frame
    names = [folder / f"flat{k}.png" for k in range(flats)]
    for name in names:
        cv2.imwrite(str(name), frame[..., ::-1])
    sensor = get_sensor(kind, width_px=frame.shape[1], height_px=frame.shape[0])
    return Recording(folder, "bare", sensor, flats=tuple(names))


def shipped(kind: str = "gelslim3") -> Path:
    path = find_model(kind)
    assert path is not None
    return path


@pytest.mark.parametrize("kind", ["gelslim3", "gelsight_mini", "digit"])
def test_it_fits_its_card(kind: str) -> None:
    method = load_network(shipped(kind), make_reference([flat(np.random.default_rng(0))]))
    assert isinstance(method.law, Network)
    assert method.card.other["licence"] == "MIT"
    assert method.card.other["versions"]["kornia"]
    assert all("direction_error_deg" in one for one in method.card.other["real_ball_presses"].values())
    assert method.card.sensor == kind
    unseen, still = draw_samples(32, 77, kind=kind)
    found = method.law.at(unseen.change, unseen.place)
    off = np.degrees(np.abs(np.angle((found @ [1, 1j]) * (unseen.slopes @ [1, -1j]))))
    assert np.median(off) == pytest.approx(method.card.held_out_direction_error_deg, rel=0.2)
    rest = method.law.at(still.change, still.place)
    assert np.median(np.hypot(*rest.T)) < 0.03


def test_real_sets_at_hand_are_judged_and_figures_of_others_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "models" / "gelsight_mini.json"
    path.parent.mkdir()
    e, f = (ready_cards.SENSORS[name] for name in "EF")
    monkeypatch.setattr(ready_cards, "ROOT", tmp_path)
    monkeypatch.setattr(ready_cards, "REAL", tmp_path)
    monkeypatch.setattr(ready_cards, "real_balls", lambda name: name)
    monkeypatch.setattr(ready_cards, "on_real", lambda kind, name, balls: {"direction_error_deg": 7.0})
    for before in ({}, {e: {"direction_error_deg": 9.0}, f: {"direction_error_deg": 8.0}}):
        path.write_text(json.dumps({"real_ball_presses": before} if before else {}))
        ready_cards.rejudge("gelsight_mini", "")
        assert f"not at hand: {f}" in capsys.readouterr().out
        card = json.loads(path.read_text())
        assert card["real_ball_presses"] == before | {e: {"direction_error_deg": 7.0}}
        assert card["real_judged"]["not_at_hand"] == [f]
    monkeypatch.setattr(ready_cards, "REAL", tmp_path / "none")
    ready_cards.rejudge("gelsight_mini", "")
    assert json.loads(path.read_text()) == card


def test_a_worker_s_copy_of_one_in_use_reads_alike() -> None:
    frame = flat(np.random.default_rng(0))
    method = load_network(shipped(), make_reference([frame]))
    other = frame[::-1].copy()
    first = method.slopes(other)
    again = pickle.loads(pickle.dumps(method)).slopes(other)  # noqa: S301 - a worker's copy
    np.testing.assert_array_equal(again.dz_dx, first.dz_dx)


def test_without_balls_it_is_used_and_named(tmp_path: Path) -> None:
    for kind, off in (("gelslim3_markers", "6 to 8"), ("gelsight_mini", "7"), ("digit", "9 to 13")):
        found = build_reconstructor(recording(tmp_path, kind))
        assert "no ball presses" in found.warnings[0]
        assert f"on real ones slopes pointed {off} degrees off" in found.warnings[0]
        assert found.method.name == "network"


def test_marks_that_the_sensor_should_not_have_are_named_and_filled(tmp_path: Path) -> None:
    said = [
        build_reconstructor(recording(tmp_path, kind, marks=marks))
        for kind, marks in (("gelslim3", True), ("gelslim3_markers", True), ("gelslim3", False))
    ]
    assert ["regular pattern of dark marks" in " ".join(one.warnings) for one in said] == [True, False, False]
    assert said[0].referenced is not None
    assert said[0].referenced.reference.marks is not None


def test_other_sensors_and_missing_references_are_told_what_they_lack(tmp_path: Path) -> None:
    here = re.escape(str(tmp_path))
    with pytest.raises(
        InputError,
        match=f"{here}: no ball presses.*Kinds that are ready without balls: digit, gelsight_mini, gelslim3",
    ):
        build_reconstructor(recording(tmp_path, "gelsight_wedge"))
    with pytest.raises(InputError, match=f"{here}: no picture of the untouched gel.*--reference"):
        build_reconstructor(recording(tmp_path, "gelslim3", flats=0))
    with pytest.raises(InputError, match=r"no photometric method of that name.*polynomial, auto, lookup"):
        build_reconstructor(recording(tmp_path, "gelslim3"), "polynomal")


def test_it_is_taken_by_its_path_but_not_for_another_sensor(tmp_path: Path) -> None:
    found = build_reconstructor(recording(tmp_path, "gelslim3"), str(shipped()))
    assert found.method.name == "network"
    with pytest.raises(InputError, match=r"made for another sensor.*gelslim3.*digit"):
        build_reconstructor(recording(tmp_path, "digit"), str(shipped()))
    with pytest.raises(InputError, match="no picture of the untouched gel"):
        build_reconstructor(recording(tmp_path, "gelslim3", flats=0), str(shipped()))


def copied(folder: Path) -> Path:
    for suffix in (".onnx", ".json"):
        shutil.copy(shipped().with_suffix(suffix), folder)
    return folder / "gelslim3.onnx"


def test_a_network_that_is_not_its_card_s_is_refused(tmp_path: Path) -> None:
    reference = make_reference([flat(np.random.default_rng(0))])
    path, content = copied(tmp_path), shipped().read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(InputError, match="does not match its card"):
        load_network(path, reference)
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match="does not match its card"):
        load_network(path, reference)
    path.unlink()
    with pytest.raises(InputError, match="the network is missing"):
        load_network(path, reference)
    path.with_suffix(".json").write_text("[]")
    with pytest.raises(InputError, match="is not a table"):
        load_network(path, reference)


@pytest.mark.parametrize("kept", [0.5, 0.0])
def test_a_truncated_network_with_a_card_to_match_is_still_told(tmp_path: Path, kept: float) -> None:
    import hashlib

    path, content = copied(tmp_path), shipped().read_bytes()
    part = content[: int(kept * len(content))]
    path.write_bytes(part)
    card = json.loads(path.with_suffix(".json").read_text())
    card["onnx_sha256"] = hashlib.sha256(part).hexdigest()
    path.with_suffix(".json").write_text(json.dumps(card))
    with pytest.raises(InputError, match=r"cannot be read|does not"):
        load_network(path, make_reference([flat(np.random.default_rng(0))]))
