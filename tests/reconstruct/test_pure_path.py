"""A reconstructor is a frozen record: threads, processes and asyncio that share one give equal bytes."""

from __future__ import annotations

import asyncio
import dataclasses
import multiprocessing
import sys
import threading
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from shared_scenes import sample_reconstructor

from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import make_reference
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes

sys.path.insert(0, str(Path(__file__).parents[1] / "photometric"))
from lamp_room import SENSOR, ball, ball_pictures, flat, picture


@pytest.fixture(scope="module")
def reader() -> Reconstructor:
    rng = np.random.default_rng(1)
    shots = ball_pictures(8, rng)
    reference = make_reference([flat(rng) for _ in range(3)])
    fit = PHOTOMETRIC["polynomial"]
    method = calibrate_from_balls(reference, shots, mm_per_px=SENSOR.mm_per_px, fit=fit).method
    return Reconstructor(SENSOR, dataclasses.replace(method, card=dataclasses.replace(method.card, tile_px=3)))


def frames() -> list[Bytes]:
    rng = np.random.default_rng(5)
    presses = [picture(*ball((x, 0.5), contact, 4.0)[1:], rng) for x in (-2.0, 0.0, 2.0) for contact in (0.8, 1.6)]
    return [flat(rng), *presses]


def as_bytes(reader: Reconstructor, rgb: Bytes) -> bytes:
    height = reader.height_map(Frame(rgb))
    std = b"" if height.std_mm is None else height.std_mm.tobytes()
    return height.depth_mm.tobytes() + height.valid.tobytes() + std + repr(height.flags).encode()


def test_threads_processes_and_asyncio_give_equal_bytes(reader: Reconstructor) -> None:
    shown, read = frames(), partial(as_bytes, reader)
    alone = [read(rgb) for rgb in shown]
    assert len(set(alone)) == len(shown)
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(read, 3 * shown)) == 3 * alone
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as processes:
        assert list(processes.map(read, shown)) == alone

    async def together() -> list[bytes]:
        return await asyncio.gather(*(asyncio.to_thread(read, rgb) for rgb in 3 * shown))

    assert asyncio.run(together()) == 3 * alone


def test_nothing_of_a_reconstructor_is_changed_from_outside(reader: Reconstructor) -> None:
    for field in dataclasses.fields(reader):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(reader, field.name, None)
    other = reader.varied(taught=None).warned("a word")
    assert other.warnings[-1] == "a word"
    assert "a word" not in reader.warnings


def test_one_that_follows_the_gel_leaves_the_other_as_it_is(reader: Reconstructor) -> None:
    rgb, warm = frames()[-1], flat(np.random.default_rng(8), gain=1.05)
    before, own = as_bytes(reader, rgb), reader.independent()
    assert as_bytes(own, rgb) == before
    own.follow(warm, 0.5)
    assert as_bytes(own, rgb) != before
    assert as_bytes(reader, rgb) == before


def test_a_reading_has_what_its_map_rests_on(reader: Reconstructor) -> None:
    seen = reader.read(Frame(frames()[2]))
    assert seen.slopes.dz_dx.shape == seen.height.depth_mm.shape
    assert seen.surface.residuals[1] == seen.zero.std_mm
    assert set(seen.terms_mm())
    assert list(seen.edges) == []


def test_a_process_forked_while_a_thread_reads_reads_too() -> None:
    """A reconstructor has no lock that the child could inherit taken; OpenBLAS has none with one thread."""
    reader = sample_reconstructor()
    assert reader.referenced is not None
    rgb = np.rint(reader.referenced.reference.rgb).astype(np.uint8)
    ended = threading.Event()

    def read() -> None:
        while not ended.is_set():
            reader.rectified_map(rgb)

    thread = threading.Thread(target=read)
    thread.start()
    try:
        for _ in range(3):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12
                child = multiprocessing.get_context("fork").Process(target=reader.rectified_map, args=(rgb,))
                child.start()
            child.join(30)
            child.kill() if child.is_alive() else None
            assert child.exitcode == 0
    finally:
        ended.set()
        thread.join()
