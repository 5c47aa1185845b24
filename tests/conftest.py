"""Each worker computes on one thread, and all find what one of them has made in a folder of this run."""

from __future__ import annotations

import gc
import os
import shutil
import tempfile

import pytest

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # read when numpy and torch are first imported
    os.environ.setdefault(threads, "1")


def pytest_configure(config: pytest.Config) -> None:
    gc.disable()
    if not hasattr(config, "workerinput"):  # workers are started from here, and inherit the folder's name
        folder = os.environ["TACTILEVISION_SCENES"] = tempfile.mkdtemp(prefix="tactilevision_scenes_")
        os.environ["TACTILEVISION_CACHE"] = os.path.join(folder, "cache")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


def pytest_collection_finish() -> None:
    gc.freeze()  # modules and tests stay until the end: no collection of garbage looks at them
    gc.set_threshold(50_000, 20, 100)
    gc.enable()
