"""What every card says beside its figures: when, with which versions, under which licence."""

from __future__ import annotations

import datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

PACKAGES = ("numpy", "torch", "kornia", "onnxruntime")


def provenance(data: str, *, licence: str) -> dict[str, Any]:
    """`data`: what a method was made from; `licence` of the method's file."""
    return {
        "data": data,
        "date": datetime.datetime.now(tz=datetime.UTC).date().isoformat(),
        "licence": licence,
        "versions": {name: found for name in ("tactilevision", *PACKAGES) if (found := _version(name))},
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
