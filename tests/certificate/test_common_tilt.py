"""An indenter that is tilted in its mount tilts each face by as much; a map that errs, by what the depth is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactilevision.press.rejection import _tilt, mount_tilt

DEPTHS_MM = np.repeat([0.14, 0.27, 0.41, 0.54], 3)


def test_a_tilted_mount_is_told_from_a_map_that_errs_with_depth() -> None:
    noise = 3e-4 * np.random.default_rng(0).standard_normal((12, 2))
    found = mount_tilt(np.array([0.001, 0.008]) + noise, DEPTHS_MM)
    assert found is not None
    assert found == pytest.approx([0.001, 0.008], abs=1e-3)
    assert mount_tilt(np.outer(DEPTHS_MM, [0.0, 0.02]) + noise, DEPTHS_MM) is None
    assert mount_tilt(noise, DEPTHS_MM) is None


def test_one_depth_few_presses_and_faces_unseen_tell_nothing() -> None:
    tilts = np.full((12, 2), 0.008)
    assert mount_tilt(tilts, np.full(12, 0.3)) is None
    assert mount_tilt(tilts[:3], DEPTHS_MM[[0, 4, 8]]) is None
    assert mount_tilt(np.full((12, 2), np.nan), DEPTHS_MM) is None
    scattered = tilts * np.where(np.arange(12) % 2, 1, -1)[:, None]
    assert mount_tilt(scattered, DEPTHS_MM) is None, "presses that tilt to all sides are no mount"


@pytest.mark.parametrize(("other", "reason"), [([6.5e-3, -1.5e-3], ""), ([-1.7e-3, 0.6e-3], "tilt")])
def test_a_face_whose_wall_is_read_two_ways_is_tilted_if_it_is_so_in_both(other: list[float], reason: str) -> None:
    """Most frames of a hold read the wall otherwise than other presses do, five as they do."""
    tilts = np.array([*[[-1.7e-3, 0.6e-3]] * 7, *[other] * 5])
    track = SimpleNamespace(depth_mm=np.full(12, 0.3), tilts=tilts, footprint=SimpleNamespace(radius_mm=1.5))
    press: Any = SimpleNamespace(track=track, distance_mm=3.0, depth_mm=0.27)
    recording: Any = SimpleNamespace(tilt=np.array([6.8e-3, -1.6e-3]), tilt_scatter=7e-4)
    found = _tilt(press, recording, SimpleNamespace())  # type: ignore[arg-type]
    assert (found.reason if found else "") == reason
