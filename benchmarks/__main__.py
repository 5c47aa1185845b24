"""Runs every benchmark of this folder that has a main: python -m benchmarks."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from pathlib import Path


def main() -> None:
    """One after the other, by name; the blind test is run by itself (python -m benchmarks.blind)."""
    for found in pkgutil.iter_modules([str(Path(__file__).parent)]):
        if found.ispkg or found.name.startswith("__"):
            continue
        run = getattr(importlib.import_module(f"benchmarks.{found.name}"), "main", None)
        if run is not None:
            print(f"\n{found.name}\n{'=' * len(found.name)}")
            run(*([] for asked in inspect.signature(run).parameters.values() if asked.default is asked.empty))


if __name__ == "__main__":
    main()
