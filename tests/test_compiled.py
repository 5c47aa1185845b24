"""Compiled kernels give what numpy gives, and nothing fails where numba is not there or may keep nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import tactilevision.compiled as switch
from tactilevision.heightmap import (
    circular_edges,
    circular_edges as circle,
    two_grid_poisson,
    walls as steep_edges,
    walls as wall_law,
    zero_plane,
)
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.heightmap.walls import PunchEdge
from tactilevision.photometric import drift
from tactilevision.photometric.colour_change import ColourChange, strips
from tactilevision.photometric.methods.polynomial import MAX_ORDER, POWERS, PRODUCTS, Polynomial
from tactilevision.photometric.reference import Reference
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import Frame, SlopeMap

ROOT = Path(__file__).parents[1]
FRAMES = {"free": 126, "gentle": 109, "deep": 308, "shallow": 137}  # of the sample, by what presses there
KEPT_OUT = "import tactilevision.photometric.frame_kernels as k; print(k.changes.signatures)"


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Callable[[], Any]], tuple[Any, Any]]]:
    """What a work gives by numpy and by kernels, in this order."""
    pytest.importorskip("numba")

    def run(work: Callable[[], Any]) -> tuple[Any, Any]:
        given = []
        for state in "01":
            monkeypatch.setenv(switch.SWITCH, state)
            switch.compiled.cache_clear()
            assert switch.compiled() is (state == "1")
            given.append(work())
        return given[0], given[1]

    yield run
    monkeypatch.undo()
    switch.compiled.cache_clear()


def alike(pair: tuple[Any, Any], *, rtol: float = 1e-9, atol: float = 1e-9) -> None:
    ours, theirs = pair
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(other, one, rtol=rtol, atol=atol)


@pytest.fixture(scope="module")
def sample() -> tuple[Recording, Reconstructor]:
    recording = read_recording(ROOT / "sample_frames" / "gelslim3")
    return recording, build_reconstructor(recording)


@pytest.mark.parametrize("name", FRAMES)
def test_maps_of_real_frames_are_the_same(sample: tuple[Recording, Reconstructor], name: str, both: Any) -> None:
    recording, reader = sample
    frame = read_frame(recording, FRAMES[name])
    ours, theirs = both(lambda: reader.height_map(frame))
    assert (theirs.flags, theirs.time_s, theirs.name) == (ours.flags, ours.time_s, ours.name)
    np.testing.assert_array_equal(theirs.valid, ours.valid)
    np.testing.assert_allclose(theirs.depth_mm, ours.depth_mm, atol=2e-4)  # a fifth of a thousandth of a mm
    np.testing.assert_allclose(theirs.std_mm, ours.std_mm, atol=5e-5)
    assert ours.depth_mm.max() > {"free": 0.0, "gentle": 0.03, "deep": 0.5, "shallow": 0.3}[name]


def test_a_frame_with_dark_and_bright_places(sample: tuple[Recording, Reconstructor], both: Any) -> None:
    recording, reader = sample
    rgb = read_frame(recording, FRAMES["deep"]).rgb.copy()
    rgb[40:90, 60:100], rgb[200:240, 300:330, 1], rgb[100:104, 200:260] = 3, 255, 254
    ours, theirs = both(lambda: reader.height_map(Frame(rgb)))
    assert theirs.flags == ours.flags
    assert not ours.valid.all()
    np.testing.assert_array_equal(theirs.valid, ours.valid)
    np.testing.assert_allclose(theirs.depth_mm, ours.depth_mm, atol=2e-4)


def test_a_frame_that_may_not_be_written_to_is_read(sample: tuple[Recording, Reconstructor], both: Any) -> None:
    recording, reader = sample
    rgb = reader.rectified(read_frame(recording, FRAMES["deep"]))
    rgb.setflags(write=False)
    ours, theirs = both(lambda: reader.rectified_map(rgb))
    np.testing.assert_allclose(theirs.depth_mm, ours.depth_mm, atol=2e-4)


@pytest.mark.parametrize("order", [3, 4])
def test_the_polynomial(order: int, both: Any) -> None:
    rng = np.random.default_rng(0)
    coefficients = rng.normal(0, 0.3, (2, len(PRODUCTS), len(POWERS)))
    for k, product in enumerate(PRODUCTS):
        high = [sum(power) > {1: MAX_ORDER, 2: 2, 3: 1, 4: 1}[len(product)] for power in POWERS]
        coefficients[:, k, high] = 0.0
        coefficients[:, k] *= len(product) <= order
    evaluate = Polynomial(coefficients, 1.0).evaluator((37, 53))
    change = rng.normal(0, 0.4, (3, 37, 53)).astype(np.float32)
    alike(both(lambda: evaluate(change)), rtol=1e-4, atol=2e-6)
    slopes = np.stack(both(lambda: evaluate(change))[1])
    assert 0.01 < float(np.mean(np.abs(slopes) >= evaluate.bound)) < 0.9  # some are held to the bound


def test_colour_changes(both: Any) -> None:
    rng = np.random.default_rng(1)
    mean = rng.uniform(60, 200, (48, 64, 3)).astype(np.float32)
    change = ColourChange(Reference(mean, (1.0, 1.2, 0.9), rng.random((48, 64)) > 0.05))
    rgb = np.clip(mean * 1.02 + rng.normal(0, 1.2, mean.shape), 0, 255).astype(np.uint8)
    window = slice(5, 40), slice(7, 61)

    def taken() -> list[Any]:
        found, _ = change.take(rgb)
        changes = np.concatenate([one.copy() for _, one in change.within(window)], axis=1)
        return [found.gains, found.untouched, changes]

    alike(both(taken), atol=2e-6)
    assert len(list(strips(window))) == 1


def test_blocks_near_a_contact() -> None:
    pytest.importorskip("numba")
    from tactilevision.photometric.frame_kernels import _near_contact

    rng = np.random.default_rng(2)
    for share in (0.05, 0.3, 0.8, 1.0):
        touched = rng.random((21, 28)) < share
        solid = cv2.erode(touched.view(np.uint8), drift.SOLID)
        near = cv2.dilate(solid, drift.NEAR, anchor=(3, 3)).ravel() > 0
        np.testing.assert_array_equal(_near_contact(touched.ravel(), 28), near)


def test_circles_and_profiles(both: Any) -> None:
    rng = np.random.default_rng(3)
    for trial in range(20):
        profiles = rng.normal(0, 1, (rng.integers(8, 33), 60))
        profiles[rng.random(profiles.shape) < 0.1] = np.nan
        profiles[0] = np.nan if trial % 3 else profiles[0]
        places, angle = 1.0 + 0.03 * np.arange(60), rng.uniform(0, 6, 100 + trial)
        x, y = 3 + 2 * np.cos(angle) + rng.normal(0, 0.02, angle.size), 1 + 2 * np.sin(angle)
        weight = rng.random(angle.size)

        def work(p: Any = profiles, s: Any = places, at: Any = (x, y, weight)) -> list[Any]:
            flank = circular_edges._flanks(s, p, 0.5)
            return [
                flank,
                *circular_edges._harmonics(flank, np.isfinite(flank)),
                circular_edges._quantiles(p, 0.25, 0.5, 0.75, 0.8),
                circle.quick_circle(at[0], at[1], weight=at[2]),
            ]

        alike(both(work))


def test_the_profile_across_a_rim(both: Any) -> None:
    rng = np.random.default_rng(4)
    p, q = rng.normal(0, 1, (2, 90, 120)).astype(np.float32)
    valid = rng.random((90, 120)) > 0.02
    rim = (3.0, 2.6, 1.9), (1.2, 3.4)
    for known in (None, valid):
        slopes = SlopeMap(p, q, known)
        alike(both(lambda s=slopes: circular_edges._profiles(s, (0.05, 0.06), *rim)), atol=3e-5)


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
def test_the_fit_of_a_wall(noise: float, both: Any) -> None:
    rng = np.random.default_rng(5)
    px, radius = 0.06, 2.5
    s = np.concatenate([np.arange(-5.5, -1.5, 0.5), np.arange(2.5, 17, 0.5)]) * px
    law = wall_law.Law(radius, px, 1.0, wall_law.wall_light(2.1), s)
    seen, _ = law._shown(np.array([0.02, np.log(0.6 * px), np.log(0.9 * px), 0.25, 0.02, -0.01]))
    std = 0.01 + 0.03 * np.abs(seen)
    seen = seen + noise * rng.standard_normal(seen.size)
    alike(both(lambda: law.fitted(seen, std)), rtol=1e-7)


def test_a_wall_put_in_place(both: Any) -> None:
    s = np.linspace(-0.2, 1.0, 81)
    edge = PunchEdge((3.11, 2.4), 1.5, 0.4, s, 0.3 * np.sqrt(np.maximum(s, 0.0)), 0.35, 0.1, 0.02)
    flat = np.random.default_rng(6).normal(0.02, 0.01, (2, 90, 110)).astype(np.float32)

    def work() -> list[Any]:
        p, q = flat.copy()
        steep_edges.restore(SlopeMap(p, q), [edge], mm_per_px=(0.06, 0.05))
        return [p, q]

    alike(both(work), atol=1e-6)
    assert np.abs(work()[0] - flat[0]).max() > 0.1


@pytest.mark.parametrize("touched", [False, True])
def test_the_zero_plane(touched: bool, both: Any) -> None:
    rng = np.random.default_rng(7)
    y, x = np.mgrid[-1:1:80j, -1:1:106j]
    depth = (0.01 + 0.02 * x - 0.01 * y + 0.002 * rng.standard_normal(x.shape)).astype(np.float32)
    untouched = np.ones((21, 28), np.bool_)
    if touched:
        depth += (0.4 * np.exp(-9 * (x * x + y * y))).astype(np.float32)
        untouched[6:15, 8:20] = False

    def work() -> list[Any]:
        plane = zero_plane.find_zero_plane(depth, untouched, mm_per_px=(0.25, 0.25))
        return [plane.offset_mm, plane.tilt_mm, plane.std_mm, plane.takes]

    alike(both(work), rtol=1e-6)


@pytest.mark.parametrize("shape", [(40, 53), (130, 121)])
def test_surfaces_between_all_kinds_of_ends(shape: tuple[int, int], both: Any) -> None:
    right = np.random.default_rng(8).normal(0, 1, shape).astype(np.float32)
    kinds = [(low, high) for low in (False, True) for high in (False, True)]
    for free in [(along_y, along_x) for along_y in kinds for along_x in kinds]:
        level = right - right.mean() if all(free[0] + free[1]) else right
        pair = both(lambda r=level, f=free: two_grid_poisson._solved(r, (0.06, 0.05), f))
        np.testing.assert_allclose(pair[1], pair[0], atol=3e-6 * np.abs(pair[0]).max())


def test_numba_is_left_alone_where_it_is_not_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    code = "import sys; from tactilevision.compiled import compiled; print(compiled(), 'numba' in sys.modules)"
    environment = os.environ | {switch.SWITCH: "0"}
    out = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["False", "False"]
    monkeypatch.delenv(switch.SWITCH, raising=False)
    monkeypatch.setitem(sys.modules, "numba", None)  # as where it is not installed
    switch.compiled.cache_clear()
    assert not switch.compiled()
    switch.compiled.cache_clear()


def test_every_kernel_is_there_before_workers_are() -> None:
    pytest.importorskip("numba")
    code = "import sys; from tactilevision.compiled import compile_all; compile_all(); print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    kept = {"tactilevision." + ".".join(path.relative_to(ROOT / "tactilevision").with_suffix("").parts)
            for path in (ROOT / "tactilevision").rglob("*_kernels.py")}  # fmt: skip
    assert len(kept) > 5
    assert kept <= set(out.stdout.split())


@pytest.mark.parametrize("harm", ["none", "spoilt", "no folder"])
def test_a_cache_that_cannot_be_used_is_no_failure(harm: str, tmp_path: Path) -> None:
    pytest.importorskip("numba")
    folder = tmp_path / "kept"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    if harm == "no folder":
        folder.write_text("a file")  # in place of the folder
    else:
        subprocess.run([sys.executable, "-c", KEPT_OUT], env=environment, capture_output=True, check=True)
        kept = list(folder.rglob("*.nbi"))
        assert len(kept) == 1
        for path in kept if harm == "spoilt" else ():
            path.write_bytes(b"no index")
    out = subprocess.run(
        [sys.executable, "-c", KEPT_OUT], env=environment, capture_output=True, text=True, check=True
    )
    assert "uint8" in out.stdout
