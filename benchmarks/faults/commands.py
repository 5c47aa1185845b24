"""The five commands on recordings so small that a run takes seconds, and what of their results is the clock's."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
FRAMES = 28  # of the small recording: more than are done before a second process starts
PICTURES = "frames/*.png"


@dataclass(frozen=True, slots=True)
class Command:
    """`arguments` without the output; `source` is the recording it reads, `target` how the output is named.

    `changing` are files of the recording that may change while it is read. `workers` is how many processes
    write. `weight` is the command's part of all kills; long ones have less. `file` is the only result in the
    folder of a command that writes one file; `grows` one that is written row by row.
    """

    name: str
    arguments: tuple[str, ...]
    source: Path | None = None
    target: tuple[str, ...] = ("--out",)
    changing: str = ""
    workers: int = 1
    weight: int = 2
    file: str = ""
    grows: str = ""

    def line(self, out: Path) -> list[str]:
        """The words after the program's name."""
        return [*self.arguments, *self.target, str(out / self.file)]


def prepare(folder: Path) -> dict[str, Command]:
    """Make the recordings below `folder`; all commands by name."""
    every = (*frame_commands(folder / "frames"), *point_commands(folder / "points"))
    return {command.name: command for command in every}


def frame_commands(frames: Path) -> tuple[Command, ...]:
    """Height maps and forces of a small recording, which is made in the folder `frames`."""
    _small_recording(frames)
    method, material = str(DATA / "methods" / "polynomial.npz"), str(DATA / "calibration.json")
    read = (str(frames), "--even-so", "--method", method, "--pictures")
    return (
        Command("depth tiff", ("depth", *read, "0", "--workers", "2"), frames, changing=PICTURES, workers=2),
        Command(
            "depth zarr", ("depth", *read, "1", "--workers", "1", "--format", "zarr"), frames, changing=PICTURES
        ),
        Command(
            "force", ("force", *read, "0", "--workers", "1", "--calibration", material), frames, changing=PICTURES
        ),
    )


def point_commands(points: Path) -> tuple[Command, ...]:
    """What is made of certified points, which are simulated in the folder `points`; and a table of four cases."""
    _run(["simulate", str(points), "--frames", "points", "--presses", "1", "--no-faults"])
    grid = ("--law", "neo-hooke", "--friction", "inf", "--poisson-ratio", "0.3,0.45", "--a-over-h", "0.2,0.3")
    return (
        Command("calibrate", ("calibrate", str(points)), points, changing="points.csv"),
        Command("diagnose", ("diagnose", str(points)), points, changing="points.csv", weight=1),
        Command("tabulate", ("tabulate", *grid, "--edge-over-h", "0.1", "--workers", "1"), target=(), weight=1),
    )


def _small_recording(folder: Path) -> Path:
    """Two pictures of 112 x 84 px, blended with a little noise into more; forces and presses beside them."""
    shutil.copytree(DATA / "small", folder)
    settings = folder / "recording.toml"
    text = settings.read_text(encoding="utf-8").replace('shape = "disc"', 'shape = "unbounded"')
    settings.write_text(text.replace("radius_mm = 15.0\n", ""), encoding="utf-8")
    first, last = (np.asarray(cv2.imread(str(p)), float) for p in sorted((folder / "frames").iterdir()))
    shutil.rmtree(folder / "frames")
    (folder / "frames").mkdir()
    rng, names = np.random.default_rng(0), [f"{number:03d}.png" for number in range(FRAMES)]
    for number, name in enumerate(names):
        share = np.sin(np.pi * number / FRAMES)
        blended = (1 - share) * first + share * last + rng.normal(0, 1, first.shape)
        cv2.imwrite(str(folder / "frames" / name), blended.round().clip(0, 255).astype(np.uint8))
    rows = [f"{name},{1 + 0.1 * number:.3f}" for number, name in enumerate(names)]
    (folder / "frames.csv").write_text("\n".join(("frame,time_s", *rows)) + "\n", encoding="utf-8")
    times = np.arange(0.5, 5, 0.005)
    readings = [f"{t:.4f},0.01,0.0,{max(0.0, np.sin(np.pi * (t - 1) / 2.8)):.4f}" for t in times]
    table = "\n".join(("time_s,fx_N,fy_N,fz_N", *readings)) + "\n"
    (folder / "forces.csv").write_text(table, encoding="utf-8")
    return folder


def _run(words: list[str]) -> None:
    subprocess.run([sys.executable, "-m", "tactilevision", *words], check=True, capture_output=True, cwd=ROOT)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder by its name, without the clock's (`ms`, the date) and the folder's name."""
    here = os.fsencode(folder.resolve())
    return {
        str(path.relative_to(folder)): _timeless(path).replace(here, b"OUT")
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.is_symlink()
    }


def visible(found: Mapping[str, bytes]) -> dict[str, bytes]:
    """What a user takes for results: nothing hidden, but all of a store, whose own files may be hidden."""
    return {name: data for name, data in found.items() if not _is_hidden(name.partition(".zarr/")[0])}


def _is_hidden(name: str) -> bool:
    return any(part.startswith(".") for part in name.split("/"))


def nearly_same(one: Path, other: Path, name: str) -> bool:
    """Whether a file of numbers differs in the last digits of float32 alone (1e-6 mm, MPa)."""
    pair = [_numbers(folder, name) for folder in (one, other)]
    if pair[0] is None or pair[1] is None:
        return False
    return all(np.allclose(a, b, rtol=1e-5, atol=1e-6, equal_nan=True) for a, b in zip(*pair, strict=True))


def _numbers(folder: Path, name: str) -> list[np.ndarray] | None:
    path = folder / name
    if path.suffix == ".tiff":
        return [np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))]
    if path.suffix == ".npz":
        with np.load(path) as file:
            return [file[key] for key in file.files if file[key].dtype.kind == "f"]
    store, _, rest = name.partition(".zarr/")
    if rest.count("/") == 1:
        import zarr

        chunk = int(rest.split("/")[1].split(".")[0])
        return [np.asarray(zarr.open_group(folder / f"{store}.zarr", mode="r")[rest.split("/")[0]][chunk])]
    return None


def _without(*names_and_data: str | bytes) -> bytes:
    *names, data = names_and_data
    assert isinstance(data, bytes)
    rows = list(csv.reader(io.StringIO(data.decode())))
    kept = [column for column, name in enumerate(rows[0]) if name not in names]
    return "\n".join(",".join(row[column] for column in kept) for row in rows).encode()


def _without_date(data: bytes) -> bytes:
    card = json.loads(data)
    return json.dumps({key: value for key, value in card.items() if key != "date"}).encode()


TIMELESS: Mapping[str, Callable[[bytes], bytes]] = {
    "depth.csv": partial(_without, "ms"),
    "live.csv": partial(_without, "age_ms", "time_s"),
    "punch.json": _without_date,
}


def _timeless(path: Path) -> bytes:
    data = path.read_bytes()
    try:
        return TIMELESS.get(path.name, bytes)(data)
    except (ValueError, IndexError, UnicodeDecodeError):  # half a file: it differs as it stands
        return data
