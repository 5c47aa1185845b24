"""The command line with a fault inside: FAULT holds what happens, and before which event on a file of the output.

Workers import this module, too, as the main module of their parent, so that the fault may lie in them.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

EVENTS = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate")  # as CPython audits them
FAULT = "TACTILEVISION_FAULT"


class Hook:
    """Counts the events that write below `out`; before the one numbered `at` the process is killed."""

    def __init__(self, out: str, at: int | None, count: str | None) -> None:
        self.out, self.at, self.count, self.seen = out, at, count, 0

    def __call__(self, event: str, given: tuple[Any, ...]) -> None:
        """What sys.addaudithook calls."""
        if event not in EVENTS or not self._writes(event, given):
            return
        if self.seen == self.at:
            os.kill(os.getpid(), signal.SIGKILL)
        self.seen += 1
        if self.count is not None:
            handle = os.open(self.count, os.O_WRONLY | os.O_CREAT | os.O_APPEND)  # outside `out`: not counted
            os.write(handle, b".")
            os.close(handle)

    def _writes(self, event: str, given: tuple[Any, ...]) -> bool:
        name = given[0]
        if not isinstance(name, str | bytes | os.PathLike) or not os.fsdecode(name).startswith(self.out + os.sep):
            return False
        return event != "open" or bool(given[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def install() -> None:
    """Put the fault that the environment states into this process."""
    said = json.loads(os.environ.get(FAULT, "{}"))
    is_worker = __name__ != "__main__"
    if said.get("worker", False) == is_worker and "out" in said:
        sys.addaudithook(Hook(said["out"], said.get("at"), said.get("count")))
    if "clock_s" in said:
        now = time.time
        time.time = lambda: now() + said["clock_s"]


install()

if __name__ == "__main__":
    from tactilevision.cli import main

    sys.argv[0] = str(Path(sys.argv[0]).with_name("tactilevision"))
    sys.exit(main())
