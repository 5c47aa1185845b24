"""The light of the sample that a path tracer drew: its reconstructor and its lamps, found once for all tests."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Any

from shared_scenes import shared

from tactilevision.heightmap.build import calibrate_light
from tactilevision.heightmap.lamps import find_lamps
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.illumination.lamps import Lamps
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "rendered_shadows"
TRUTH: dict[str, Any] = tomllib.loads((SAMPLE / "truth.toml").read_text())
MM_PER_PX = (0.0634, 0.0634)


@shared
def rendered_reconstructor() -> Reconstructor:
    return calibrate_light(read_recording(SAMPLE), "polynomial")


@lru_cache
def found_lamps() -> Lamps:
    lamps = find_lamps(read_recording(SAMPLE), rendered_reconstructor())
    assert lamps is not None
    return lamps
