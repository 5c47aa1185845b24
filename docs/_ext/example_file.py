"""Gives the gallery's examples the `__file__` that they have as scripts; sphinx-gallery itself sets none."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[2] / "examples"


def set_file(gallery_conf: dict[str, Any], fname: str) -> None:
    """Called before each example with its path; names that a module lacks are looked up in the builtins."""
    builtins.__dict__["__file__"] = str(EXAMPLES / Path(fname).name)
