"""Finds what was trained beforehand: `_models` in an installed wheel, `models` beside the package in a checkout.

A user's own folder of that name is never looked into. Each file is checked against its card when it is loaded.
"""

from __future__ import annotations

from pathlib import Path

from tactilevision.errors import InputError

HERE = Path(__file__).parents[2]  # the package


def models_folder() -> Path:
    """The folder of trained methods. Raises InputError where the installation has none."""
    for folder in (HERE / "_models", HERE.parent / "models"):
        if folder.is_dir():
            return folder
    raise InputError("the trained methods are missing", where=HERE, remedy="Install tactilevision again.")


def find_model(name: str) -> Path | None:
    """The network of that name, or None where there is none."""
    path = models_folder() / f"{name}.onnx"
    return path if path.is_file() else None


def ready_models() -> tuple[str, ...]:
    """Names of the networks that came along, each of a kind of sensor."""
    return tuple(sorted(path.stem for path in models_folder().glob("*.onnx")))
