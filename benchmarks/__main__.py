"""Runs the benchmarks of this folder, or the smallest case of each: python -m benchmarks [--quick] [name ...]."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys
import time
from collections.abc import Sequence

import benchmarks


def main(arguments: Sequence[str] = ()) -> None:
    """Run them by name; packages are imported, and run by themselves (python -m benchmarks.blind)."""
    names, quick = [one for one in arguments if one != "--quick"], "--quick" in arguments
    found = [one.name for one in pkgutil.walk_packages(benchmarks.__path__, "benchmarks.")]
    for path in (one for one in found if not one.endswith("__main__")):
        module, name = importlib.import_module(path), path.partition(".")[2]
        if "." in name or not hasattr(module, "main") or (names and name not in names):
            continue
        print(f"\n{name}\n{'=' * len(name)}", flush=True)
        began = time.perf_counter()
        if quick:
            module.quick()
        else:
            asked = inspect.signature(module.main).parameters.values()
            module.main(*([] for one in asked if one.default is one.empty))
        print(f"({time.perf_counter() - began:.0f} s)", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
