"""Tractions of many frames on disk: filled by many processes a frame at a time, then put in place as a whole.

tractions.npz     of the good frames: frame (N,) names, t_x, t_y, t_z (N, rows, columns) float32 in MPa, mm_per_px,
                  first_mm
tractions.zarr    of all frames, NaN where a frame gave none: the same fields; scale and place as attributes
"""

from __future__ import annotations

import os
import shutil
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tactilevision.exports.zarr_store import Singles, begin_frames, end_frames, settle, write_frame
from tactilevision.files import replacing, told_as_output
from tactilevision.force.nodes import NodeGrid

FIELDS = ("t_x", "t_y", "t_z")
Form = Literal["npz", "zarr"]


@dataclass(frozen=True, slots=True)
class TractionStore:
    """Where tractions go: `out`/tractions.FORM, by way of a scratch beside it."""

    out: Path
    form: Form
    grid: NodeGrid

    @property
    def path(self) -> Path:
        """The finished store."""
        return self.out / f"tractions.{self.form}"

    @property
    def scratch(self) -> Path:
        """The store that is being filled."""
        return self.out / f".tractions.{self.form}-unfinished"

    def settle(self) -> None:
        """Put right what killed runs have left, those in the other form, too."""
        if self.form == "zarr":
            settle(self.path)
            replace(self, form="npz").scratch.unlink(missing_ok=True)
        else:
            shutil.rmtree(replace(self, form="zarr").scratch, ignore_errors=True)

    def begin(self, frames: Sequence[str]) -> None:
        """Make the scratch, empty."""
        if self.form == "zarr":
            units = dict.fromkeys(FIELDS, "MPa")
            begin_frames(self.scratch, frames, fields=units, shape=self.grid.shape, about=self._about())
            return
        shape = (len(frames), len(FIELDS), *self.grid.shape)
        with told_as_output(self.scratch):
            np.lib.format.open_memmap(self.scratch, mode="w+", dtype=np.float32, shape=shape).flush()
            if hasattr(os, "posix_fallocate"):  # a full disk is told now, not by a signal that ends a worker
                with self.scratch.open("r+b") as file:
                    os.posix_fallocate(file.fileno(), 0, self.scratch.stat().st_size)

    def write(self, number: int, fields: dict[str, Singles]) -> None:
        """One frame's fields, (rows, columns) each."""
        if self.form == "zarr":
            write_frame(self.scratch, number, fields=fields)
            return
        stack = np.lib.format.open_memmap(self.scratch, mode="r+")
        stack[number] = np.stack([fields[name] for name in FIELDS])
        stack.flush()

    def exists(self) -> bool:
        """Whether the scratch is there."""
        return self.scratch.exists()

    def end(self, frames: Sequence[str], good: Sequence[int]) -> None:
        """Put the store in place; `good` are the numbers of the frames that have tractions."""
        if self.form == "zarr":
            end_frames(self.scratch, self.path)
            return
        stack = np.lib.format.open_memmap(self.scratch, mode="r")
        with replacing(self.path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as packed:
            whole = {"frame": np.array([frames[number] for number in good], dtype=np.str_)} | {
                name: np.array(value) for name, value in self._about().items()
            }
            for name, values in whole.items():
                with packed.open(f"{name}.npy", "w") as file:
                    np.lib.format.write_array(file, values, allow_pickle=False)
            for part, name in enumerate(FIELDS):
                header = {"descr": "<f4", "fortran_order": False, "shape": (len(good), *self.grid.shape)}
                with packed.open(f"{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array_header_1_0(file, header)
                    for number in good:  # never more than one frame in memory
                        file.write(stack[number, part].tobytes())
        self.scratch.unlink()

    def _about(self) -> dict[str, Any]:
        step = self.grid.spacing_mm
        return {"mm_per_px": [step, step], "first_mm": [float(self.grid.x_mm[0]), float(self.grid.y_mm[0])]}
