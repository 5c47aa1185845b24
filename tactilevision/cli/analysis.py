"""What `diagnose`, `compare` and `steps` have in common: measurements, effects as named, the history they keep."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from calibration.diagnosis.diagnosis import Diagnosis
    from calibration.model.stages import Effect
    from calibration.tasks.compare import Comparison
    from calibration.tasks.session import History, Step

FIND, TRY = "to find what is missing", "to try"  # what a command that is suggested is for
OWN = ".py"  # how the file of an effect of one's own ends

Recordings = Annotated[list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one sensor.")]
Private = Annotated[
    list[Path] | None, typer.Option("--effect", metavar="FILE.py", help="An effect of your own; the file is run.")
]
Seed = Annotated[int, typer.Option(min=0, max=10**9, help="Of the bootstrap and the permutations.")]
LeftOut = Annotated[
    list[str] | None, typer.Option("--leave-out", metavar="PRESS", help="A press that is not fitted (repeatable).")
]
TimeLimit = Annotated[
    float | None,
    typer.Option("--time-limit", min=1, metavar="SECONDS", help="End with the best answer so far, and say so."),
]


@dataclass(frozen=True, slots=True)
class Settings:
    """How an analysis was asked for, as its history keeps it."""

    seed: int
    prior: bool
    applied: bool = False
    left_out: tuple[str, ...] = ()


def named_effects(names: Sequence[str | Path] | None) -> tuple[list[Effect], dict[str, str]]:
    """Effects in the order named, by key or by the file of one's own; and the file of each that has one."""
    from calibration.effects import get_effect
    from calibration.effects.private import load_effect

    effects, files = [], {}
    for name in names or ():
        own = str(name).endswith(OWN)
        effects.append(load_effect(name) if own else get_effect(str(name)))
        if own:
            files[effects[-1].key] = str(Path(name).resolve())
    return effects, files


def compare_command(
    recordings: Sequence[Path | str],
    names: Sequence[str],
    files: Mapping[str, str],
    *,
    prior: bool = True,
    left_out: Sequence[str] = (),
) -> str:
    """The command that adds these effects, as a shell takes it."""
    from calibration.tasks.session import as_path

    options = [
        word for name in names for word in (("--effect", files[name]) if name in files else ("--with", name))
    ]
    paths = [as_path(str(recording)) for recording in recordings]
    held = [word for press in left_out for word in ("--leave-out", press)] + ([] if prior else ["--no-prior"])
    return shlex.join(["tactilevision", "compare", *paths, *options, *held])


def keep_history(
    recordings: Sequence[Path], steps: Sequence[Step], folder: Path, *, out: Path, settings: Settings
) -> None:
    """history.json, and the script that repeats these steps from wherever it is run; both end up in `out`."""
    from calibration.tasks.session import History

    names, how = tuple(str(path.resolve()) for path in recordings), settings
    history = History(names, applied=how.applied, seed=how.seed, prior=how.prior, left_out=how.left_out)
    for step in steps:
        history = history.add(step)
    write_history(history, folder, out)


def write_history(history: History, folder: Path, out: Path) -> None:
    """The same of a history that is there."""
    from tactilevision.files.writing import write_text

    history.save(folder / "history.json")
    write_text(folder / "repeat.sh", history.script(again_in(out)))


def again_in(folder: Path) -> Path:
    """Where a repeated analysis goes: beside what it repeats, which stays."""
    return folder.resolve() / "repeated"


def next_commands(
    recordings: Sequence[Path | str],
    found: Comparison,
    files: Mapping[str, str],
    *,
    prior: bool,
    left_out: Sequence[str],
) -> list[tuple[str, str]]:
    """Return commands to try after a comparison: a diagnosis of the base model alone, then instrument errors."""
    from calibration.effects import PLAIN
    from calibration.tasks.session import steps_of_comparison

    added = [step.key for step in steps_of_comparison(found, files)]
    said: list[tuple[str, str]] = []
    if not added and not left_out:
        held = [] if prior else ["--no-prior"]
        said.append((FIND, shlex.join(["tactilevision", "diagnose", *map(str, recordings), *held])))
    for key in found.suggested:
        words = f"{TRY} {getattr(PLAIN[key], 'words', key)}"
        said.append((words, compare_command(recordings, [*added, key], files, prior=prior, left_out=left_out)))
    return said


def commands_of(
    recordings: Sequence[Path], found: Diagnosis, files: Mapping[str, str], *, prior: bool
) -> list[str]:
    """What a diagnosis suggests to try, as commands: each candidate, and the plain error of an UNKNOWN."""
    from calibration.effects import written

    fitted = {effect.key: written(effect) for effect in found.fits.fitted.model.effects}
    named = [fitted.get(effect.key, effect.key) for effect in found.effects]
    plain = [found.remainder.plain.effect.key] if found.remainder.plain is not None else []
    sets = [[key] for key in found.candidates] if len(found.candidates) > len(named) else [named]
    return [compare_command(recordings, keys, files, prior=prior) for keys in (*sets, plain) if keys]
