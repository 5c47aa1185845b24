"""The command line with a fault inside: FAULT holds what happens, and before which event on a file of the output.

A fault may lie in the workers: a forked one has its parent's hook, a spawned one imports this as its main module.
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
    """Counts the events that write below `out`; before the one numbered `at` the process is killed.

    It acts in the process that made it or, `in_forked`, in each that was forked from it.
    """

    def __init__(self, out: str, at: int | None, count: str | None, *, in_forked: bool) -> None:
        self.out, self.at, self.count, self.seen = out, at, count, 0
        self.maker, self.in_forked = os.getpid(), in_forked

    def __call__(self, event: str, given: tuple[Any, ...]) -> None:
        """What sys.addaudithook calls."""
        if event not in EVENTS or (os.getpid() != self.maker) != self.in_forked or not self._writes(event, given):
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
    in_workers = said.get("worker", False)
    if "out" in said and (in_workers or not is_worker):
        in_forked = in_workers and not is_worker
        sys.addaudithook(Hook(said["out"], said.get("at"), said.get("count"), in_forked=in_forked))
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
