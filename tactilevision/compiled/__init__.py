"""Whether numba is there to compile loops: what takes a frame many short calls of numpy then takes one.

    if compiled():
        from tactilevision.heightmap.edge_kernels import fitted

Files of kernels are named *_kernels.py and use this file's `kernel`; they are imported where `compiled()` says so
and nowhere else. Every kernel stands for numpy code beside its call and gives the same to float rounding.
TACTILEVISION_COMPILED=0 in the environment leaves numba alone.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

Kernel = TypeVar("Kernel", bound=Callable[..., Any])
PACKAGE = Path(__file__).parents[1]
SWITCH = "TACTILEVISION_COMPILED"
OPTIONS: dict[str, Any] = {"fastmath": {"contract", "reassoc"}, "error_model": "numpy"}  # sums in any order
# types of arrays that are read alone
BYTES2, BYTES3 = (f"Array(uint8, {n}, 'C', True)" for n in (2, 3))
LINE32, PLANE, PLANES = (f"Array(float32, {n}, 'C', True)" for n in (1, 2, 3))
LINE, LINES = (f"Array(float64, {n}, 'C', True)" for n in (1, 2))


@lru_cache(maxsize=1)
def compiled() -> bool:
    """Whether kernels are to be used in this process; the first to ask waits for numba to be loaded."""
    if os.environ.get(SWITCH) == "0":
        return False
    try:
        import numba  # noqa: F401
    except ImportError:  # not there, or not made for this numpy
        return False
    return True


def compile_all() -> None:
    """Compile every kernel, or read what is kept: before frames come, or workers that would compile it each."""
    if compiled():
        for path in sorted(PACKAGE.rglob("*_kernels.py")):
            import_module(".".join((PACKAGE.name, *path.relative_to(PACKAGE).with_suffix("").parts)))


def kernel(*arguments: str) -> Callable[[Kernel], Kernel]:
    """Compiles a function for `arguments`, numba's names of types, and keeps it for later processes if it can.

    Kept code that cannot be read, or no folder to keep it in, is no failure: it is compiled anew. Without
    arguments: a part of other kernels, compiled into them.
    """

    def made(function: Kernel) -> Kernel:
        from numba import njit

        signature = f"({', '.join(arguments)},)"
        done: Kernel
        if not arguments:
            done = njit(**OPTIONS)(function)
            return done
        try:
            done = njit(signature, cache=True, **OPTIONS)(function)
        except Exception:  # what a spoilt cache raises depends on its bytes
            done = njit(signature, **OPTIONS)(function)
        return done

    return made
