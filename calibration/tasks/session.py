"""History of an analysis: its steps, undo, and export as a script that repeats it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain, pairwise
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, PlainValidator, TypeAdapter

from tactilevision.errors import InputError
from tactilevision.files.documents import read_json
from tactilevision.files.opening import number
from tactilevision.files.writing import write_json

if TYPE_CHECKING:
    from calibration.tasks.compare import Compared, Comparison


HISTORY = "history.json"  # in a folder of results
MAX_LABEL = 80  # letters of a state's name: one line of a page
MAX_SEED = 10**9  # of a run's draws; a larger one in a file was not written by a command


def _error(value: object) -> float:
    found = number(value, what="an error", where="history.json")
    return nan if found is None else found


Text = Annotated[str, Field(pattern=r"^[^\x00]*$")]
Key = Annotated[str, Field(pattern=r"^\w[\w.-]{0,80}(:\d{1,3})?$")]  # of an effect, with the number of its terms
Error = Annotated[float, PlainValidator(_error)]  # NaN is null in a file
Unit = Literal["N", "mm"]
Seed = Annotated[int, Field(strict=True, ge=0, le=MAX_SEED)]


@dataclass(frozen=True, slots=True)
class Step:
    """One effect added to the model: its key, a private one's file, and the errors before and after.

    `rms` over the fitted presses, `held_out` over presses held out, and the repeatability, all in N, or in mm for
    an effect on the picture's depth (`unit`); NaN where unknown.
    """

    key: Key
    path: Text = ""
    rms_before_N: Error = nan
    rms_after_N: Error = nan
    held_out_before_N: Error = nan
    held_out_after_N: Error = nan
    repeatability_N: Error = nan
    unit: Unit = "N"


@dataclass(frozen=True, slots=True)
class Labelled:
    """A named state: its steps and the presses excluded."""

    name: Text
    steps: tuple[Step, ...] = ()
    left_out: tuple[Text, ...] = ()


@dataclass(frozen=True, slots=True)
class History:
    """The steps taken on these recordings, and those undone, which can be redone.

    `applied`: the folder's calibration.json is that of these steps; `seed` of the score tests; `prior`: nu was
    held to what elastomers have; `left_out`: names of presses that are not fitted; `labels`: states with a name.
    """

    recordings: tuple[Text, ...]
    steps: tuple[Step, ...] = ()
    undone: tuple[Step, ...] = field(default=())
    applied: bool = False
    seed: Seed = 0
    prior: bool = True
    left_out: tuple[Text, ...] = ()
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
        steps = [("--with", s.path or s.key) for s in self.steps]
        steps += [("--leave-out", press) for press in self.left_out]
        how = ([] if self.prior else ["--no-prior"]) + (["--seed", str(self.seed)] if self.seed else [])
        return shlex.join(["tactilevision", name, *map(as_path, self.recordings), *chain(*steps), *how])

    def script(self, out: Path | str) -> str:
        """Return a shell script that repeats the analysis with these effects and writes into `out`."""
        return f"#!/bin/sh\n# {len(self.steps)} steps\n{self.command()} {shlex.join(['--out', str(out)])}\n"


def steps_of_comparison(found: Comparison, files: Mapping[str, str]) -> list[Step]:
    """Return a step for each effect added, with the errors before and after; `files` of private ones by key."""
    from calibration.effects import written

    steps = []
    kinds: tuple[tuple[Unit, tuple[Compared, ...]], ...] = (("N", found.models), ("mm", found.pictured))
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
        return TypeAdapter(History).validate_python(read_json(path))
    except (OSError, ValueError) as fault:
        why = " ".join(str(fault).split())[:160]
        raise InputError("this is no history of an analysis", where=path, value=why) from fault


def as_path(name: str) -> str:
    """Return a recording's path as a command takes it: one that begins with "-" is not an option."""
    return f"./{name}" if name.startswith("-") else name
