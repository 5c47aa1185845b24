"""`tactilevision diagnose`: where the model fails, what is missing, and how sure that is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.analysis import (
    ANSWERED,
    Private,
    Recordings,
    Seed,
    Settings,
    TimeLimit,
    commands_of,
    keep_history,
    named_effects,
    not_in_frames,
    observed,
    taken_with_nu,
)
from tactilevision.cli.measure import with_what_was_read
from tactilevision.cli.steps import forget_found, keep_calibration

if TYPE_CHECKING:
    from calibration.diagnosis.diagnosis import Diagnosis
    from calibration.session import Step
    from tactilevision.cli.measure import Taken

With = Annotated[
    list[str] | None,
    typer.Option("--with", metavar="KEY|FILE.py", help="An effect that is in from the start."),
]

ABSENT = "the frames show none, where the balls tell how they would look"  # why an effect is ruled out


def diagnose(
    recordings: Recordings,
    out: console.OutOption = Path("diagnosis_out"),
    known: With = None,
    private: Private = None,
    apply: Annotated[bool, typer.Option("--apply", help="Write calibration.json with the effects found.")] = False,
    prior: console.PriorOption = True,
    workers: console.WorkersOption = None,
    cluster: console.ClusterOption = None,
    seed: Seed = 0,
    form: console.FormatOption = console.FigureFormat.PNG,
    json: console.JsonOption = None,
    time_limit: TimeLimit = None,
) -> None:
    """Find out what is missing from the model: which effect, how sure, and what to measure next."""

    from calibration.inputs.deadline import Deadline, Watch
    from calibration.laws.flat_punch import elastomer_bound
    from calibration.report.diagnosis_report import summary
    from calibration.session import Step
    from calibration.tasks import diagnose as method
    from tactilevision.cli.findings import reliefs, write_diagnosis
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.cluster.steps import step_pool
    from tactilevision.files import staged, write_json

    deadline, bound = Deadline.after(time_limit), elastomer_bound(prior)
    (sure, sure_files), (own, own_files) = named_effects(known), named_effects(private)
    taken, bulge = taken_with_nu(recordings, cluster=cluster)
    with step_pool(workers, cluster) as each, console.progress_bar("diagnosing:") as progress:
        watch, data = Watch(progress, deadline, each), observed(taken)
        asked = partial(method.diagnose, data, effects=own, known=sure, bulge=bulge, bound=bound, watch=watch)
        alone = _asked_of_frames(asked, taken, seed)
    found, files = _with_what_was_read(alone, taken), sure_files | own_files
    steps = [*(Step(effect.key, files.get(effect.key, "")) for effect in sure), *steps_of(found, files)]
    commands = commands_of(recordings, found, files, prior=prior)
    surfaces = reliefs(taken)
    content = found.as_json() | {"height_map": [c.as_json() for one in surfaces for c in one.covariates]}
    with staged(out) as stage:
        write_json(stage / "diagnosis.json", content)
        keep_history(recordings, steps, stage, out=out, settings=Settings(seed, prior, apply))
        if apply:
            keep_calibration(out, stage)
            write_json(stage / "calibration.json", found.after.as_json())
        title = "Diagnosis of " + ", ".join(one.recording.name for one in taken)
        figures = FigureFolder(stage, form)
        write_diagnosis(found, figures, title=title, private=own, reliefs=surfaces, commands=commands)
    forget_found(out)
    console.warn(alone.after.warnings)
    console.say(*summary(found), *(f"to try: {text}" for text in commands))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures beside it")
    console.hand_over(content, json)


def _asked_of_frames(asked: Callable[..., Diagnosis], taken: Sequence[Taken], seed: int) -> Diagnosis:
    """What was asked; once more without what is named, where the frames rule it out."""
    import numpy as np

    found = asked(np.random.default_rng(seed))
    absent = not_in_frames(taken, found)
    if not absent:
        return found
    again = asked(np.random.default_rng(seed), ruled_out=absent)
    return replace(again, not_testable={**again.not_testable, **dict.fromkeys(absent, ABSENT)})


def _with_what_was_read(found: Diagnosis, taken: Sequence[Taken]) -> Diagnosis:
    before, after = (with_what_was_read(one, taken, answered=ANSWERED) for one in (found.before, found.after))
    return replace(found, before=before, after=after)


def steps_of(found: Diagnosis, files: Mapping[str, str]) -> list[Step]:
    """A step for each effect that was added, with the errors before and after it; `files` of one's own by key."""
    from calibration.effects import written
    from calibration.report.error_fall import error_fall_of_sight
    from calibration.session import Step

    named = {e.key: e for e in found.fitted.model.effects}
    errors, added = found.errors, [e.key for e in found.effects if e.key in named]
    steps = [
        Step(written(named[key]), files.get(key, ""), errors.before, errors.after, *held, errors.floor)
        for key, held in zip(added, pairwise(found.held_out), strict=True)
    ]
    for fall in error_fall_of_sight(found):
        keys = [e.key for e in found.effects if e.key not in named]
        for key, held in zip(keys, pairwise(fall.error), strict=True):
            steps.append(Step(key, "", nan, nan, *held, fall.repeatability, fall.unit))
    return steps


def new_effect(
    path: Annotated[Path, typer.Argument(help="Python file to write.")],
    key: Annotated[str, typer.Option(help="The effect's name.")] = "my_effect",
) -> None:
    """Write a template of an effect of your own, for --effect."""
    from calibration.effects.support.private import new_effect as write

    write(path, key)
    console.say(f"wrote {path}; use it with: tactilevision diagnose RECORDING --effect {path}")
