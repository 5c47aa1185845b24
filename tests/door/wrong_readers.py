"""Readers of the tests that run in a child process, and go wrong there."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tactilevision.files.child import Answer, asked


def working(path: str, what: str) -> Iterator[Answer]:
    """Readers that go wrong in their own ways."""
    yield (os.getpid(),)
    if what == "ask":
        for word in asked():
            yield (word,)
    if what == "write":
        Path(path).with_name("written").write_text("text")
    if what == "files":
        kept = [os.open(path, os.O_RDONLY) for _ in range(1000)]
        yield (len(kept),)
    if what == "memory":
        yield (len(bytearray(600_000_000)),)
    if what == "die":
        os.kill(os.getpid(), signal.SIGSEGV)
    if what == "sleep":
        time.sleep(1000)
    if what == "answer":
        yield (np.zeros(200_000_000, np.uint8),)
    if what == "words":
        yield ("x" * 10_000_000,)
    if what == "object":
        yield (object(),)
    while what == "work":
        pass
