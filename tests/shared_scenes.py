"""What is costly to make is made once a run: the worker that comes first stores it, the others read it."""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import pytest
from filelock import FileLock

from tactilevision.cli import main
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.storage import save_method
from tactilevision.recording.read import read_recording

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"
PAPER = SAMPLE.parent / "paper_points"
P = ParamSpec("P")
T = TypeVar("T")


def scenes() -> Path:
    """The folder of this run's scenes, the same for all workers."""
    return Path(os.environ["TACTILEVISION_SCENES"])


def shared(make: Callable[P, T]) -> Callable[P, T]:
    """`make`, whose results are computed once a run for equal arguments. Every call returns its own copy."""

    @wraps(make)
    def read(*args: P.args, **named: P.kwargs) -> T:
        key = "_".join(map(str, (make.__module__, make.__name__, *args, *named.items()))).replace("/", "-")
        path = scenes() / f"{key}.pickle"
        with FileLock(f"{path}.lock"):
            if not path.exists():
                made = pickle.dumps(make(*args, **named))
                path.write_bytes(made)
        found: T = pickle.loads(path.read_bytes())  # noqa: S301 - written by this run
        return found

    return read


@shared
def calibrated_points() -> Path:
    """The results of `calibrate` on the sample paper_points, for tests that only read them."""
    out = scenes() / "calibrated_points"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", "calibrate", str(PAPER), "--out", str(out)])
        assert main() == 0
    return out


@shared
def sample_reconstructor() -> Reconstructor:
    """The light of the sample gelslim3, calibrated on its own balls."""
    return build_reconstructor(read_recording(SAMPLE), "polynomial")


@shared
def rendered_reconstructor() -> Reconstructor:
    """The light of the sample that a path tracer rendered."""
    return build_reconstructor(read_recording(SAMPLE.parent / "rendered_shadows"), "polynomial")


@shared
def sample_method() -> Path:
    """That light as `calibrate` keeps it: for commands whose own fitting of it is not what is tested."""
    method = sample_reconstructor().referenced
    assert method is not None
    return save_method(method, scenes() / "sample_method.npz")
