"""The versions that decide a result's digits: they must be one on all machines."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from tactilevision.errors import ClusterError

PACKAGES = ("tactilevision", "numpy", "scipy", "opencv-contrib-python-headless")
MISSING = "none"


def versions() -> dict[str, str]:
    """Of this process."""
    return {name: _version(name) for name in PACKAGES}


def refusal(here: dict[str, str], there: dict[str, str]) -> ClusterError | None:
    """What is wrong with a worker's versions; None where they are those of this process."""
    for name in PACKAGES:
        if there.get(name, MISSING) != here[name]:
            return ClusterError(
                f"a worker has another version of {name}, so results would differ",
                where="--cluster",
                value=there.get(name, MISSING),
                remedy=f"Install {name} {here[name]} on every worker, and start the workers again.",
            )
    return None


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return MISSING
