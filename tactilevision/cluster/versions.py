"""The versions that decide a result's digits: they must be one on all machines."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from tactilevision.compiled import SWITCH, compiled
from tactilevision.errors import ClusterError

PACKAGES = ("tactilevision", "numpy", "scipy", "opencv-contrib-python-headless")
KERNELS = "numba"  # none, too, where it is there and not used
MISSING = "none"


def versions() -> dict[str, str]:
    """Of this process."""
    told = {name: _version(name) for name in PACKAGES}
    return told | {KERNELS: _version(KERNELS) if compiled() else MISSING}


def refusal(here: dict[str, str], there: dict[str, str]) -> ClusterError | None:
    """What is wrong with a worker's versions; None where they are those of this process."""
    for name in (*PACKAGES, KERNELS):
        if there.get(name, MISSING) != here[name]:
            return ClusterError(
                f"a worker has another version of {name}, so results would differ",
                where="--cluster",
                value=there.get(name, MISSING),
                remedy=f"{_to_share(name, here[name])}, and start the workers again.",
            )
    return None


def _to_share(name: str, wanted: str) -> str:
    """What makes a version one on all machines: numba's may also be left out on all."""
    if name != KERNELS:
        return f"Install {name} {wanted} on every worker"
    without = f"{SWITCH}=0 on all machines"
    return f"Set {without}" if wanted == MISSING else f"Use numba {wanted} on every worker, or set {without}"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return MISSING
