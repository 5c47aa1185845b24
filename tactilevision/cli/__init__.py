"""The console script `tactilevision`. No logic lives here; it is the one room that may import both packages."""

from __future__ import annotations

import os
import sys


def main() -> int:
    """Run the command line; returns the exit code.

    0 done · 2 bad input (also a wrong option) · 3 nothing could be certified · 130 interrupted.
    """
    for library in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(library, "1")  # matrices are small here: threads would only wait for each other
    from tactilevision.cli.app import app
    from tactilevision.cli.console import INTERRUPTED, report_failure

    try:
        if app(standalone_mode=False) == INTERRUPTED:  # typer makes a number of what Ctrl-C raised
            return report_failure(KeyboardInterrupt())
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 1
    except BaseException as fault:
        return report_failure(fault)
    return 0


if __name__ == "__main__":
    sys.exit(main())
