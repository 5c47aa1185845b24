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
FAULT, MODULES = "TACTILEVISION_FAULT", "TACTILEVISION_MODULES"


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


def install(said: dict[str, Any], *, is_worker: bool) -> None:
    """Put a fault into this process."""
    if said.get("worker", False) == is_worker and "out" in said:
        sys.addaudithook(Hook(said["out"], said.get("at"), said.get("count")))
    if "clock_s" in said:
        now = time.time
        time.time = lambda: now() + said["clock_s"]


def run_command(words: list[str]) -> int:
    """The command line in this process; also says which modules it took, where that is asked for."""
    from tactilevision.cli import main

    sys.argv = ["tactilevision", *words]
    code = main()
    if MODULES in os.environ:
        Path(os.environ[MODULES]).write_text("\n".join(sys.modules), encoding="utf-8")
    return code


if __name__ in ("__main__", "__mp_main__"):
    install(json.loads(os.environ.get(FAULT, "{}")), is_worker=__name__ != "__main__")
if __name__ == "__main__":
    sys.exit(run_command(sys.argv[1:]))
