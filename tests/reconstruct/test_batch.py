"""Frames in batches: the frame path's maps, exact solutions, and devices that are not there."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from shared_scenes import SAMPLE, sample_reconstructor

from tactilevision import reconstruct_batch
from tactilevision.batch.folder import reconstruct_folder
from tactilevision.errors import InputError
from tactilevision.heightmap import device
from tactilevision.heightmap.batch import BatchReader, HeightMaps, Steps
from tactilevision.heightmap.batched_slopes import rectified
from tactilevision.heightmap.batched_surface import BatchedPoisson, components
from tactilevision.heightmap.poisson import integrate
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import Frame, HeightMap, SlopeMap
from tactilevision.sensors.rectification import rectify

NUMBERS = (0, 3, 6, 96, 150, 246)  # free and gentle gel, and walls


@lru_cache
def light() -> Reconstructor:
    return sample_reconstructor()


@lru_cache
def frames() -> tuple[Frame, ...]:
    """Sample frames, and one in light whose lamps have faded separately."""
    recording = read_recording(SAMPLE)
    found = [read_frame(recording, number) for number in NUMBERS]
    changed = np.clip(np.rint(found[0].rgb * np.array([0.97, 1.0, 0.95])), 0, 255).astype(np.uint8)
    return (*found, Frame(changed, 1.5, "changed"))


def rms_um(maps: HeightMaps) -> list[float]:
    paths = [light().height_map(frame) for frame in frames()[: len(maps)]]
    return [
        1e3 * float(np.sqrt(np.mean((a.depth_mm - b.depth_mm) ** 2))) for a, b in zip(paths, maps, strict=True)
    ]


def test_a_batch_names_the_frame_that_cannot_be_read() -> None:
    black = Frame(np.zeros_like(frames()[0].rgb), 0.0, "black")
    maps = reconstruct_batch(light(), [*frames()[:2], black], "cpu")
    assert max(rms_um(maps[:-1])) == 0.0, "without a device, frames are read one by one"
    assert isinstance(fault := maps.found[-1], InputError)
    assert "black" in fault.what
    assert np.isnan(maps.depth_mm[-1]).all()
    with pytest.raises(InputError, match="black"):
        maps[-1]


def test_the_steps_of_a_device_give_the_maps_of_the_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run on the processor, in batches under way two at once, as a device would run their record."""
    reader, alone = BatchReader(light(), "cpu"), [light().height_map(frame) for frame in frames()]
    record(monkeypatch, lambda: reader)
    reader._record(Steps(light(), "cpu"), 3)
    names: list[str] = []
    read = Reconstructor.height_map

    def counted(one: Reconstructor, frame: Any) -> HeightMap:
        names.append(frame.name)
        return read(one, frame)

    monkeypatch.setattr(Reconstructor, "height_map", counted)
    black = Frame(np.zeros_like(frames()[0].rgb), 0.0, "black")
    maps = reader.read([*frames(), black])
    assert "black" in names
    assert set(names) <= {"00096.jpg", "00150.jpg", "00246.jpg", "black"}, "walls take the frame path"
    assert max(rms_um(maps[:-1])) < 1.0
    for found, plain in zip(maps[:-1], alone, strict=True):
        assert (found.flags, found.name) == (plain.flags, plain.name)
        assert found.std_mm == pytest.approx(plain.std_mm, abs=3e-3)
        assert np.array_equal(found.valid, plain.valid)
        assert found.colour_change == pytest.approx(plain.colour_change, abs=1e-3)
    assert isinstance(maps.found[-1], InputError)


def record(monkeypatch: pytest.MonkeyPatch, reader: Callable[[], BatchReader]) -> None:
    """A stand-in for CUDA: a graph whose replay runs the steps again, into the same tensors."""

    class Graph:
        def replay(self) -> None:
            held: Any = reader().recorded
            for old, new in zip(device.leaves(held.found), device.leaves(reader().steps(held.greys)), strict=True):
                old.copy_(new)

    def within(*_: object) -> nullcontext[None]:
        return nullcontext()

    event = SimpleNamespace(record=lambda: None, synchronize=lambda: None)
    stream = SimpleNamespace(wait_stream=lambda other: None)
    fake = SimpleNamespace(
        device=within, stream=within, graph=within, CUDAGraph=Graph, Stream=lambda: stream, Event=lambda: event,
        current_stream=lambda: stream,
    )  # fmt: skip
    monkeypatch.setattr(torch, "cuda", fake)
    for name in ("empty_like", "zeros"):
        make = getattr(torch, name)
        monkeypatch.setattr(torch, name, lambda *a, make=make, pin_memory=False, **named: make(*a, **named))


def test_no_step_of_a_device_waits_for_a_number() -> None:
    """Tensors without numbers go through all steps: none depends on one, nor mixes devices."""
    sensor = light().sensor
    found = Steps(light(), "meta")(torch.zeros(4, 3, sensor.height_px, sensor.width_px, device="meta"))
    assert found.depth.shape == (4, sensor.height_px, sensor.width_px)
    assert {one.device.type for one in device.leaves(found)} == {"meta"}


def test_batched_integration_is_that_of_frames_and_exact_for_a_paraboloid() -> None:
    """The edge slopes of a paraboloid are means of its own."""
    shape, step = (25, 30), (0.2, 0.3)
    y_mm, x_mm = (np.arange(n) * along for n, along in zip(shape, step[::-1], strict=True))
    depth = 0.1 * x_mm**2 + (0.05 * y_mm**2)[:, None] + 0.3 * x_mm
    smooth = np.stack(np.broadcast_arrays(0.2 * x_mm + 0.3, (0.1 * y_mm)[:, None]))
    rough = np.random.default_rng(0).standard_normal((2, *shape))
    found = BatchedPoisson(shape, step, "cpu").integrate(torch.from_numpy(np.stack([smooth, rough])).float())
    assert found[0].numpy() == pytest.approx(depth - depth.mean(), abs=1e-4)
    assert found[1].numpy() == pytest.approx(integrate(SlopeMap(*rough), step), abs=1e-5)


def test_connected_parts_are_those_of_opencv() -> None:
    masks = np.random.default_rng(0).random((60, 21, 29)) < np.linspace(0.3, 0.9, 60)[:, None, None]
    for mask, labels in zip(masks, components(torch.from_numpy(masks)).numpy(), strict=True):
        count, theirs = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
        assert (
            len({*zip(labels.tolist(), theirs.ravel().tolist(), strict=True)}) == count == len({*labels.tolist()})
        )


def test_kornia_rectifies_as_opencv_does() -> None:
    raw = np.random.default_rng(1).integers(0, 256, (2, 90, 120, 3), dtype=np.uint8)
    y, x = np.mgrid[:70, :100].astype(np.float32)
    maps = (x + 8 + 3 * np.sin(y / 9), y + 7 + 2 * np.cos(x / 11))
    sensor = dataclasses.replace(light().sensor, width_px=100, height_px=70, rectification=maps)
    ours = rectified(torch.from_numpy(raw), [torch.from_numpy(one)[None] for one in maps])
    theirs = np.stack([rectify(sensor, one) for one in raw])
    off = ours.permute(0, 2, 3, 1).numpy() - theirs
    assert np.abs(off).max() <= 1
    assert np.mean(off != 0) < 0.02, "halves of noise between black and white, which single precision may miss"


def test_a_device_that_is_not_there_is_named() -> None:
    for asked in ("cuda:7", "tpu"):
        with pytest.raises(InputError, match=f"no such device.*{asked}.*auto"):
            reconstruct_batch(light(), frames(), asked)
    assert device.find_device("auto") == ("cuda" if torch.cuda.is_available() else "cpu")


def test_a_device_without_memory_is_named_or_left(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory")

    def reader(asked: str) -> BatchReader:
        made = BatchReader(light(), asked)
        monkeypatch.setattr(made, "device", "cuda")
        monkeypatch.setattr(made, "recorded", SimpleNamespace(begin=full))
        return made

    with pytest.raises(InputError, match="memory of the device is too small"):
        reader("cpu").read(frames()[:1])
    assert len(reader("auto").read(frames()[:1])) == 1
    assert "the processor goes on" in caplog.text


def test_a_folder_in_batches_has_the_same_rows(tmp_path: Path) -> None:
    recording = read_recording(SAMPLE)
    names = tuple(recording.frame_names[number] for number in NUMBERS)
    some = dataclasses.replace(recording, frame_names=names, frame_times_s=np.arange(len(names), dtype=float))
    plain, batched = (
        reconstruct_folder(some, light(), tmp_path / name, workers=1, device=name if name == "cpu" else None)
        for name in ("plain", "cpu")
    )
    for one, other in zip(plain, batched, strict=True):
        assert (one.frame, one.status, one.flags) == (other.frame, other.status, other.flags)
        numbers = one.peak_mm, one.peak_std_mm, one.contact_area_mm2
        assert numbers == pytest.approx((other.peak_mm, other.peak_std_mm, other.contact_area_mm2), abs=1e-5)
