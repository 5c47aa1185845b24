"""The libraries of the extra `logs`, imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from tactilevision.errors import InputError


def library(name: str) -> Any:
    """A module by its dotted name. Raises InputError where its package is missing."""
    try:
        return import_module(name)
    except ImportError as fault:
        raise InputError(
            f"the package {name.partition('.')[0]} is missing",
            where="logs and data sets",
            remedy="Install it: pip install 'tactilevision[logs]'.",
        ) from fault
