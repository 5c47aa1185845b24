"""Whether there is a GPU, told without loading torch where there is none."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

DRIVERS = ("/dev/nvidiactl", "/dev/kfd", "/dev/dxg")  # CUDA, ROCm, Windows' subsystem for Linux


def find_gpu() -> str | None:
    """Torch's name of the GPU to use; None without a driver, without torch, or where torch finds none."""
    driver = any(Path(path).exists() for path in DRIVERS)
    if os.name == "nt":
        driver = (Path(os.environ.get("SYSTEMROOT", "C:/Windows")) / "System32" / "nvcuda.dll").exists()
    if not driver or find_spec("torch") is None:
        return None
    import torch

    return "cuda" if torch.cuda.is_available() else None
