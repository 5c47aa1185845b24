"""History of an analysis: its steps, undo, and export as a script that repeats it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain, pairwise
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactilevision.errors import InputError
from tactilevision.files.documents import read_json
from tactilevision.files.opening import number
from tactilevision.files.writing import write_json

if TYPE_CHECKING:
    from calibration.tasks.compare import Comparison


_KEY = re.compile(r"\w[\w.-]{0,80}(:\d{1,3})?")  # of an effect, with the number of its terms
UNITS = ("N", "mm")  # of a step's errors: of the force, and of the reconstructed depth
MAX_LABEL = 80  # letters of a state's name: one line of a page
MAX_SEED = 10**9  # of a run's draws; a larger one in a file was not written by a command
ERRORS = ("rms_before_N", "rms_after_N", "held_out_before_N", "held_out_after_N", "repeatability_N")  # of a Step


@dataclass(frozen=True, slots=True)
class Step:
    """One effect added to the model: its key, a private one's file, and the errors before and after.

    `rms` over the fitted presses, `held_out` over presses held out, and the repeatability, all in N, or in mm for
    an effect on the picture's depth (`unit`); NaN where unknown.
    """

    key: str
    path: str = ""
    rms_before_N: float = nan
    rms_after_N: float = nan
    held_out_before_N: float = nan
    held_out_after_N: float = nan
    repeatability_N: float = nan
    unit: str = "N"


@dataclass(frozen=True, slots=True)
class Labelled:
    """A named state: its steps and the presses excluded."""

    name: str
    steps: tuple[Step, ...] = ()
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class History:
    """The steps taken on these recordings, and those undone, which can be redone.

    `applied`: the folder's calibration.json is that of these steps; `seed` of the score tests; `prior`: nu was
    held to what elastomers have; `left_out`: names of presses that are not fitted; `labels`: states with a name.
    """

    recordings: tuple[str, ...]
    steps: tuple[Step, ...] = ()
    undone: tuple[Step, ...] = field(default=())
    applied: bool = False
    seed: int = 0
    prior: bool = True
    left_out: tuple[str, ...] = ()
    labels: tuple[Labelled, ...] = ()

    def add(self, step: Step) -> History:
        """Return the history with one more step and without undone ones."""
        if step.key in (s.key for s in self.steps):
            raise InputError("this effect is in the model already", where="history", value=step.key)
        return replace(self, steps=(*self.steps, step), undone=())

    def undo(self) -> History:
        """Return the history without the last step. Raises InputError where there is none."""
        if not self.steps:
            raise InputError("there is no step to undo", where="history")
        return replace(self, steps=self.steps[:-1], undone=(*self.undone, self.steps[-1]))

    def redo(self) -> History:
        """Return the history with the step that was undone last. Raises InputError where there is none."""
        if not self.undone:
            raise InputError("there is no step to redo", where="history")
        return replace(self, steps=(*self.steps, self.undone[-1]), undone=self.undone[:-1])

    def remove(self, key: str) -> History:
        """Return the history without the step of this key, which can be redone. Raises InputError without one."""
        step = next((one for one in self.steps if one.key == key), None)
        if step is None:
            raise InputError("this effect is not in the model", where="history", value=key)
        rest = tuple(one for one in self.steps if one is not step)
        return replace(self, steps=rest, undone=(*self.undone, step))

    def label(self, name: str) -> History:
        """Return the history with this state under a name, which another state loses."""
        if not name.strip() or len(name) > MAX_LABEL or not name.isprintable():
            remedy = f"{MAX_LABEL} letters at most."
            raise InputError("a state's name is one line of text", where="label", value=name, remedy=remedy)
        others = tuple(one for one in self.labels if one.name != name)
        return replace(self, labels=(*others, Labelled(name, self.steps, self.left_out)))

    def as_json(self) -> dict[str, Any]:
        """Return the content of history.json."""
        return asdict(self)

    def save(self, path: Path | str) -> None:
        """Write history.json."""
        write_json(path, self.as_json())

    def with_effects(self, keys: Sequence[str], files: Mapping[str, str]) -> History:
        """Return the history with these effects as its steps; `files` of private ones by key."""
        return replace(self, steps=tuple(Step(key, files.get(key, "")) for key in keys), undone=())

    def command(self, name: str = "compare") -> str:
        """Return the command that repeats the analysis with these effects, as a shell takes it."""
        steps = [("--effect", s.path) if s.path else ("--with", s.key) for s in self.steps]
        steps += [("--leave-out", press) for press in self.left_out]
        how = ([] if self.prior else ["--no-prior"]) + (["--seed", str(self.seed)] if self.seed else [])
        return shlex.join(["tactilevision", name, *map(as_path, self.recordings), *chain(*steps), *how])

    def script(self, out: Path | str) -> str:
        """Return a shell script that repeats the analysis with these effects and writes into `out`."""
        return f"#!/bin/sh\n# {len(self.steps)} steps\n{self.command()} {shlex.join(['--out', str(out)])}\n"


def steps_of_comparison(found: Comparison, files: Mapping[str, str]) -> list[Step]:
    """Return a step for each effect added, with the errors before and after; `files` of private ones by key."""
    from calibration.effects import written

    steps, kinds = [], (("N", found.models), ("mm", found.pictured))
    for unit, before, model in ((unit, *pair) for unit, models in kinds for pair in pairwise(models)):
        key = model.effects[-1]
        kept = (effect for effect in model.fitted.model.effects if effect.key == key)
        named = next((written(effect) for effect in kept), key)  # what frames read anew cure is not fitted
        rms, held_out = (before.rms_N, model.rms_N), (before.held_out_N, model.held_out_N)
        steps.append(Step(named, files.get(key, ""), *rms, *held_out, model.repeatability_N, unit))
    return steps


def load_history(path: Path | str) -> History:
    """Read what `History.save` wrote. Raises InputError for a file that is missing or not a history."""
    if not Path(path).is_file():
        raise InputError(
            "there is no history of an analysis here",
            where=path,
            remedy="Name a folder that `tactilevision diagnose` or `compare` wrote.",
        )
    try:
        content = read_json(path)
        return History(
            tuple(map(_text, content["recordings"])),
            tuple(map(_step, content["steps"])),
            tuple(map(_step, content["undone"])),
            applied=content.get("applied") is True,
            seed=_seed(content.get("seed", 0)),
            prior=content.get("prior") is not False,
            left_out=tuple(map(_text, content.get("left_out", ()))),
            labels=tuple(map(_labelled, content.get("labels", ()))),
        )
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise InputError("this is no history of an analysis", where=path, value=str(fault)) from fault


def _labelled(row: dict[str, Any]) -> Labelled:
    return Labelled(_text(row["name"]), tuple(map(_step, row["steps"])), tuple(map(_text, row["left_out"])))


def _step(row: dict[str, Any]) -> Step:
    def error(name: str) -> float:
        found = number(row.get(name), what=name, where="history.json")
        return nan if found is None else found

    key = _text(row["key"])
    if not _KEY.fullmatch(key):
        raise ValueError(f"{key!r} is no effect's key")
    unit = row.get("unit", "N")
    if unit not in UNITS:
        raise ValueError(f"{unit!r} is no unit of an error")
    return Step(key, _text(row["path"]), **{name: error(name) for name in ERRORS}, unit=unit)


def _seed(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_SEED:
        raise TypeError(f"{str(value)[:30]} is no seed")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str) or "\0" in value:
        raise TypeError(f"{value!r} is no text")
    return value


def as_path(name: str) -> str:
    """Return a recording's path as a command takes it: one that begins with "-" is not an option."""
    return f"./{name}" if name.startswith("-") else name
