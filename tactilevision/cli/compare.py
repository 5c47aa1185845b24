"""`tactilevision compare`: effects added one after the other, and what that does to the error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.analysis import (
    ANSWERED,
    LeftOut,
    Recordings,
    Seed,
    Settings,
    TimeLimit,
    keep_history,
    named_effects,
    next_commands,
    observed,
    treated,
    with_nu,
)
from tactilevision.cli.measure import take
from tactilevision.cli.steps import forget_found

if TYPE_CHECKING:
    from calibration.tasks.compare import Compared, Comparison

Chosen = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        "--effect",
        metavar="KEY|FILE.py",
        help="An effect to add, in this order: a key, or the file of one of your own, which is run.",
    ),
]


def compare(
    recordings: Recordings,
    out: console.OutOption = Path("comparison_out"),
    chosen: Chosen = None,
    prior: console.PriorOption = True,
    seed: Seed = 0,
    form: console.FormatOption = console.FigureFormat.PNG,
    json: console.JsonOption = None,
    time_limit: TimeLimit = None,
    left_out: LeftOut = None,
) -> None:
    """Add effects one after the other and watch the error, on presses left out, beside the repeatability."""
    import numpy as np

    from calibration.inputs.deadline import Deadline
    from calibration.laws.flat_punch import elastomer_bound
    from calibration.session import steps_of_comparison
    from calibration.tasks import compare as method
    from tactilevision.cli.comparison import content_of, write_comparison
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.files import staged

    deadline, aside = Deadline.after(time_limit), tuple(left_out or ())
    effects, files = named_effects(chosen)
    taken, bulge = with_nu(take(recordings, answered=ANSWERED))
    data, again = observed(taken, aside), treated(taken, effects, aside)
    with console.progress_bar("fitting") as progress:
        rng, bound = np.random.default_rng(seed), elastomer_bound(prior)
        found = method.compare(
            data, effects, rng=rng, bulge=bulge, bound=bound, treated=again, progress=progress, deadline=deadline
        )
    commands = next_commands(recordings, found, files, prior=prior, left_out=aside)
    title = "Comparison of " + ", ".join(one.recording.name for one in taken)
    passed_over = [f"{key} is left out: {why}" for key, why in found.left_out]
    with staged(out) as stage:
        write_comparison(found, FigureFolder(stage, form), title=title, try_next=commands)
        steps = steps_of_comparison(found, files)
        keep_history(recordings, steps, stage, out=out, settings=Settings(seed, prior, left_out=aside))
    forget_found(out)
    console.warn(passed_over)
    console.say(*lines_of(found), *passed_over, *(f"{words}: {text}" for words, text in commands))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures beside it")
    console.hand_over(content_of(found), json)


def lines_of(found: Comparison) -> list[str]:
    """One line a model: its name, its error and the repeatability."""
    from calibration.report.comparison_report import column

    return [
        *(_model_line(column(model), model) for model in found.models),
        *(_picture_line(column(model), model) for model in found.pictured),
    ]


def _picture_line(name: str, model: Compared) -> str:
    from calibration.diagnosis.vision_depth_check import face_error_mm

    error, repeats = (f"{1e3 * one:.1f} µm" for one in (model.held_out_N, model.repeatability_N))
    if model.fitted.data.slopes is not None:
        error = f"{error} beside the faces, {1e3 * face_error_mm(model.fitted):.1f} µm at the faces"
    return f"{name:24s} error on presses left out {error}, repeatability {repeats}"


def _model_line(name: str, model: Compared) -> str:
    from calibration.report import wording

    error = wording.fit_error(model.held_out_N, model.rms_N)
    E = "" if model.material is None else f", E {wording.estimate(model.material.youngs_modulus)}"
    return f"{name:24s} {error}, {wording.repeatability(model.repeatability_N)}{E}"
