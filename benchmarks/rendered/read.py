"""Whole recordings read by `tactilevision calibrate --no-prior`, beside the truth that only this file opens.

python -m benchmarks.rendered --read FOLDER... [--results FOLDER]

What FOLDER keeps is of one revision of the library: other sources calibrate into another folder beside it.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Answer:
    """A quantity: its `truth`, the `value` read, `std`, and whether the 95 % interval of this `width` `holds`."""

    truth: float
    value: float
    std: float
    width: float
    holds: bool

    @property
    def off(self) -> float:
        """Read less true."""
        return self.value - self.truth

    @property
    def share(self) -> float:
        """Off as a share of the truth."""
        return self.off / self.truth


@dataclass(frozen=True, slots=True)
class Reading:
    """One recording: nu, E in MPa, c in N/mm, the clock in s, and presses good, lost, bad, and named rightly."""

    name: str
    nu: Answer
    modulus: Answer
    c: Answer
    clock: Answer
    good: int
    lost: tuple[str, ...]
    bad: int
    named: int
    flags: tuple[str, ...]


ROOT = Path(__file__).parents[2]
SOURCES = ("tactilevision", "calibration", "models")  # folders that decide what a calibration says
QUANTITIES = ("poisson_ratio", "youngs_modulus_MPa", "c_N_per_mm", "clock_offset_s")
ASKED: tuple[tuple[str, float, Callable[[Reading], bool]], ...] = (  # what, share of recordings, whether one does
    ("c within 1.5 %", 18 / 20, lambda one: abs(one.c.share) < 0.015),
    ("nu within .0075", 18 / 20, lambda one: abs(one.nu.off) < 0.0075),
    ("E within 3 %", 17 / 20, lambda one: abs(one.modulus.share) < 0.03),
    ("interval of c holds", 18 / 20, lambda one: one.c.holds),
    ("interval of nu holds", 18 / 20, lambda one: one.nu.holds),
    ("interval of E holds", 18 / 20, lambda one: one.modulus.holds),
    ("interval of nu under .04", 16 / 20, lambda one: one.nu.width < 0.04),
    ("clock within 5 ms", 19 / 20, lambda one: abs(one.clock.off) < 0.005),
    ("no good press lost", 18 / 20, lambda one: not one.lost),
    ("every bad press named", 1.0, lambda one: one.named == one.bad),
)


def report(folders: Sequence[Path], *, results: Path | None) -> None:
    """A row for each recording, then how many do what is asked. What these sources left in `results` is kept."""
    if results is None:
        with tempfile.TemporaryDirectory() as scratch:
            report(folders, results=Path(scratch))
        return
    results = results / revision(ROOT)
    readings = []
    print("| recording | nu | off | E off | c off | clock off | good kept | bad named |\n" + 8 * "|---" + "|")
    for folder in folders:
        readings.append(scored(folder, calibrated(folder, results / f"{folder.name}-{content(folder)}")))
        print(_row(readings[-1]), flush=True)
    for what, share, does in ASKED:
        print(f"{what}: {sum(map(does, readings))} of {len(readings)} (asked {share * len(readings):.1f})")
    offs = [one.nu.off for one in readings]
    print(f"nu off on average {sum(offs) / len(offs):+.4f}")


def revision(root: Path) -> str:
    """The first twelve digits of the SHA-256 of all sources: it changes with any of them, committed or not."""
    files = (one for name in SOURCES for one in (root / name).rglob("*"))
    return _digest((one for one in files if "__pycache__" not in one.parts), root)


def content(recording: Path) -> str:
    """The same of a recording's files: another recording of the same name has another."""
    return _digest(recording.rglob("*"), recording)


def _digest(paths: Iterable[Path], root: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(one for one in paths if one.is_file()):
        digest.update(f"{path.relative_to(root)}\n{path.stat().st_size}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def calibrated(folder: Path, out: Path) -> dict[str, Any]:
    """The calibration.json of a recording; what it states of nu beforehand is not used."""
    if not (out / "calibration.json").is_file():
        command = [sys.executable, "-m", "tactilevision", "calibrate", str(folder), "--no-prior", "--out"]
        subprocess.run([*command, str(out)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    found: dict[str, Any] = json.loads((out / "calibration.json").read_text(encoding="utf-8"))
    return found


def scored(folder: Path, found: dict[str, Any]) -> Reading:
    """What was found in a recording beside its truth."""
    truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
    nu, modulus, c, clock = (_answer(found[key], truth[key]) for key in QUANTITIES)
    bad = {(one["press"], one["reason"]) for one in truth["presses_rejected"]}
    named = {(one["press"], one["reason"]) for one in found["presses_rejected"]}
    lost = tuple(one for one in truth["presses_accepted"] if one not in found["presses_accepted"])
    good, rightly, flags = len(truth["presses_accepted"]), len(bad & named), tuple(found["flags"])
    return Reading(folder.name, nu, modulus, c, clock, good, lost, len(bad), rightly, flags)


def _answer(found: dict[str, Any], truth: float) -> Answer:
    low, high = found["interval95"]
    return Answer(truth, found["value"], found["std"], high - low, low <= truth <= high)


def _row(one: Reading) -> str:
    """A row of the table; ! beside what its interval does not hold."""
    nu = f"{one.nu.truth:.4f} | {one.nu.off:+.4f} ± {one.nu.std:.4f}{_missed(one.nu)}"
    shares = " | ".join(f"{100 * answer.share:+.1f} %{_missed(answer)}" for answer in (one.modulus, one.c))
    clock = f"{1e3 * one.clock.off:+.1f} ms{_missed(one.clock)}"
    presses = f"{one.good - len(one.lost)} of {one.good} | {one.named} of {one.bad}"
    return f"| {one.name} | {nu} | {shares} | {clock} | {presses} |"


def _missed(answer: Answer) -> str:
    return "" if answer.holds else " !"
