"""A folder to work in: commands are run as a user runs them, and what was run once is not run again."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_frames"


class CommandError(RuntimeError):
    """A command of the digest ended with an error."""


@dataclass
class Workspace:
    """Results of commands below `folder`, by what was asked."""

    folder: Path
    done: dict[tuple[str, ...], Path] = field(default_factory=dict)

    def run(self, command: str, *arguments: object) -> Path:
        """Run `tactilevision COMMAND ARGUMENTS` and return its folder of results.

        What the command says to a program lies in it as said.json. Raises CommandError where it fails.
        """
        key = (command, *map(str, arguments))
        if key not in self.done:
            out = self._new_folder()
            target = out / "method.npz" if command == "train" else out
            said = () if command == "train" else ("--json", str(out / "said.json"))
            self._python("tactilevision", [*key, "--out", str(target), *said])
            self.done[key] = out
        return self.done[key]

    def simulate(self, *arguments: object) -> Path:
        """A recording made by `tactilevision simulate`."""
        return self._make("tactilevision", ("simulate",), arguments)

    def draw(self, *arguments: object) -> Path:
        """A recording made by the blind test's own path: `python -m benchmarks.blind.make`."""
        return self._make("benchmarks.blind.make", (), arguments)

    def thin(self, recording: Path, frames: Sequence[str], settings: tuple[str, str] = ("", "")) -> Path:
        """A copy of a recording that keeps only some frames; one text of its settings may be replaced."""
        key = ("thin", str(recording), *frames, *settings)
        if key not in self.done:
            out = self._new_folder() / recording.name
            shutil.copytree(recording, out, ignore=shutil.ignore_patterns("frames", "truth.toml"))
            (out / "frames").mkdir()
            for name in frames:
                shutil.copy(recording / "frames" / name, out / "frames" / name)
            with (recording / "frames.csv").open(encoding="utf-8", newline="") as file:
                head, *rows = csv.reader(file)
            with (out / "frames.csv").open("w", encoding="utf-8", newline="") as file:
                csv.writer(file).writerows([head, *(row for row in rows if row[0] in frames)])
            text = (out / "recording.toml").read_text(encoding="utf-8")
            (out / "recording.toml").write_text(text.replace(*settings) if settings[0] else text, encoding="utf-8")
            self.done[key] = out
        return self.done[key]

    def steps(self, folder: Path, *arguments: object) -> Path:
        """A copy of an analysis after `tactilevision steps COPY ARGUMENTS`."""
        key = ("steps", str(folder), *map(str, arguments))
        if key not in self.done:
            out = self._new_folder() / folder.name
            shutil.copytree(folder, out)
            self._python("tactilevision", ["steps", str(out), *map(str, arguments)])
            self.done[key] = out
        return self.done[key]

    def _make(self, module: str, words: tuple[str, ...], arguments: Sequence[object]) -> Path:
        key = (module, *words, *map(str, arguments))
        if key not in self.done:
            out = self._new_folder() / "recording"
            self._python(module, [*words, str(out), *map(str, arguments)])
            self.done[key] = out
        return self.done[key]

    def _new_folder(self) -> Path:
        out = self.folder / f"{len(self.done):02d}"
        out.mkdir(parents=True)
        return out

    @staticmethod
    def _python(module: str, arguments: Sequence[str]) -> None:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
        ended = subprocess.run([sys.executable, "-m", module, *arguments], cwd=ROOT, env=environment, check=False,
                               capture_output=True, text=True)  # fmt: skip
        if ended.returncode:
            raise CommandError(f"{module} {' '.join(arguments)} ended with {ended.returncode}:\n{ended.stderr}")
