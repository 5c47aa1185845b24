"""Work that nobody waits for any more ends where it stands; what must be whole is whole."""

from __future__ import annotations

import threading
import time

import pytest

from calibration.workbench.analysis import SIGNAL, Dropping

pytestmark = pytest.mark.skipif(SIGNAL is None, reason="the system has no signal for it")
LONG_S = 20.0  # s: far longer than a drop takes


def toil() -> None:
    """Work that catches whatever a fit may catch."""
    until = time.monotonic() + LONG_S
    while time.monotonic() < until:
        try:
            sum(range(1000))
        except Exception:  # noqa: S112 -- as a fit does
            continue


def test_work_is_dropped_by_its_name_and_the_next_is_done() -> None:
    dropping, began = Dropping(), time.monotonic()
    with dropping.armed():
        for what in ("another", "background"):
            threading.Timer(0.1, dropping.drop, (what,)).start()
        assert not dropping.run("background", toil)
        assert dropping.run("action", lambda: None)
        dropping.drop("background")
        assert dropping.run("action", lambda: time.sleep(0.05)), "a drop that came late drops nothing"
    assert time.monotonic() - began < LONG_S / 2


def test_what_must_be_whole_is_done_first() -> None:
    dropping, done = Dropping(), []

    def job() -> None:
        with dropping.whole():
            dropping.drop("job")
            time.sleep(0.05)
            done.append("whole")
        done.append("never")

    def kept() -> None:
        dropping.keep()
        dropping.drop("job")
        time.sleep(0.05)
        done.append("kept")

    with dropping.armed():
        assert not dropping.run("job", job)
        assert dropping.run("job", kept)
    assert done == ["whole", "kept"]
