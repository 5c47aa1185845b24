"""`tactilevision diagnose` and `compare`: where the model fails, what is missing, and what adding it does."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.measure import beside_the_punch, take

if TYPE_CHECKING:
    from calibration.diagnosis.diagnosis import Diagnosis
    from calibration.inputs.observations import Observations
    from calibration.model.stages import Effect
    from calibration.session import Step
    from calibration.tasks.compare import Compared
    from tactilevision.cli.measure import Taken
    from tactilevision.records import Estimate

Recordings = Annotated[list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one sensor.")]
With = Annotated[
    list[str] | None, typer.Option("--with", metavar="KEY", help="An effect that is in from the start.")
]
Private = Annotated[
    list[Path] | None, typer.Option("--effect", metavar="FILE.py", help="An effect of your own; the file is run.")
]
Seed = Annotated[int, typer.Option(help="Of the bootstrap and the permutations.")]


def diagnose(
    recordings: Recordings,
    out: console.OutOption = Path("diagnosis_out"),
    known: With = None,
    private: Private = None,
    apply: Annotated[bool, typer.Option("--apply", help="Write calibration.json with the effects found.")] = False,
    prior: console.PriorOption = True,
    seed: Seed = 0,
    form: console.FormatOption = console.FigureFormat.PNG,
    json: console.JsonOption = None,
) -> None:
    """Find out what is missing from the model: which effect, how sure, and what to measure next."""
    import numpy as np

    from calibration.laws.flat_punch import elastomer_bound
    from calibration.report.diagnosis_report import diagnosis_page, summary
    from calibration.session import Step
    from calibration.tasks import diagnose as method
    from tactilevision.cli.findings import drawn_cards, evidence, reliefs
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.files import staged, write_json, write_text

    taken, bulge = _with_nu(take(recordings))
    own, bound = _private(private), elastomer_bound(prior)
    with console.progress_bar("diagnosing"):
        found = method.diagnose(
            _data(taken), np.random.default_rng(seed), effects=own, known=_known(known), bulge=bulge, bound=bound
        )
    steps = [*(Step(key, "") for key in known or ()), *_steps(found, own, private)]
    surfaces = reliefs(taken)
    content = found.as_json() | {"height_map": [c.as_json() for one in surfaces for c in one.covariates]}
    with staged(out) as stage:
        write_json(stage / "diagnosis.json", content)
        _keep_history(recordings, steps, stage, out)
        if apply:
            write_json(stage / "calibration.json", found.after.as_json())
        title = "Diagnosis of " + ", ".join(one.recording.name for one in taken)
        figures = FigureFolder(stage, form)
        pictures = evidence(found, surfaces, folder=figures)
        write_text(
            stage / "report.html",
            diagnosis_page(title, found, figures=pictures, cards=drawn_cards(found, own, folder=figures)),
        )
    console.warn(found.after.warnings)
    console.say(*summary(found), f"wrote {out / 'report.html'}, and the tables and figures beside it")
    console.hand_over(content, json)


def _steps(found: Diagnosis, own: Sequence[Effect], private: Sequence[Path] | None) -> list[Step]:
    """A step for each effect that was added, with the errors before and after it."""
    from calibration.effects import written
    from calibration.session import Step

    named = {e.key: e for e in found.fitted.model.effects}
    errors, added = found.errors, [e.key for e in found.effects if e.key in named]
    return [
        Step(written(named[key]), _path_of(key, own, private), errors.before, errors.after, *held, errors.floor)
        for key, held in zip(added, pairwise(found.held_out), strict=True)
    ]


def compare(
    recordings: Recordings,
    out: console.OutOption = Path("comparison_out"),
    known: Annotated[
        list[str] | None, typer.Option("--with", metavar="KEY", help="An effect to add, in this order.")
    ] = None,
    private: Private = None,
    prior: console.PriorOption = True,
    seed: Seed = 0,
    form: console.FormatOption = console.FigureFormat.PNG,
    json: console.JsonOption = None,
) -> None:
    """Add effects one after the other and watch the error, on presses left out, beside the repeatability."""
    import numpy as np

    from calibration.laws.flat_punch import elastomer_bound
    from calibration.tasks import compare as method
    from tactilevision.files import staged, write_json
    from tactilevision.plots import diagnosis as draw
    from tactilevision.plots import style

    own = _private(private)
    taken, bulge = _with_nu(take(recordings))
    rng = np.random.default_rng(seed)
    bound = elastomer_bound(prior)
    found = method.compare(_data(taken), [*_known(known), *own], rng=rng, bulge=bulge, bound=bound)
    left_out = [f"{key} is left out: {why}" for key, why in found.left_out]
    console.warn(left_out)
    names = [model.effects[-1].replace("_", " ") if model.effects else "base" for model in found.models]
    steps = [_step_of(before, model, own, private) for before, model in pairwise(found.models)]
    with staged(out) as stage:
        write_json(stage / "comparison.json", found.as_json())
        _keep_history(recordings, steps, stage, out)
        drawn = draw.draw_waterfall(
            names, [model.held_out_N for model in found.models], repeatability_N=found.models[-1].repeatability_N
        )
        style.save_figure(drawn, stage / "error.png", form=form)
    console.say(*(_model_line(name, model) for name, model in zip(names, found.models, strict=True)))
    console.say(*left_out, f"wrote {out / 'comparison.json'} and {out / 'error.png'}")
    console.hand_over(found.as_json(), json)


def _step_of(before: Compared, model: Compared, own: Sequence[Effect], private: Sequence[Path] | None) -> Step:
    """The last effect of `model`, and what it did to the errors."""
    from calibration.session import Step

    key = model.effects[-1]
    rms, held_out = (before.rms_N, model.rms_N), (before.held_out_N, model.held_out_N)
    return Step(key, _path_of(key, own, private), *rms, *held_out, model.repeatability_N)


def _model_line(name: str, model: Compared) -> str:
    """One model's name, its error and the repeatability."""
    from calibration.report import wording

    error = wording.fit_error(model.held_out_N, model.rms_N)
    return f"{name:24s} {error}, {wording.repeatability(model.repeatability_N)}"


def _step_errors(step: Step) -> str:
    """What a step did to the error; on the presses fitted where none could be left out, or none was on file."""
    from calibration.report import wording

    if not isfinite(step.held_out_after_N):
        return f"rms {1e3 * step.rms_before_N:.2f} -> {1e3 * step.rms_after_N:.2f} mN"
    after = wording.fit_error(step.held_out_after_N, step.rms_after_N)
    return f"from {1e3 * step.held_out_before_N:.1f} to {after}, {wording.repeatability(step.repeatability_N)}"


def new_effect(
    path: Annotated[Path, typer.Argument(help="Python file to write.")],
    key: Annotated[str, typer.Option(help="The effect's name.")] = "my_effect",
) -> None:
    """Write a template of an effect of your own, for --effect."""
    from calibration.effects.support.private import new_effect as write

    write(path, key)
    console.say(f"wrote {path}; use it with: tactilevision diagnose RECORDING --effect {path}")


def _known(keys: Sequence[str] | None) -> list[Effect]:
    from calibration.effects import get_effect

    return [get_effect(key) for key in keys or ()]


def _private(paths: Sequence[Path] | None) -> list[Effect]:
    from calibration.effects.support.private import load_effect

    return [load_effect(path) for path in paths or ()]


def _with_nu(taken: Sequence[Taken]) -> tuple[list[Taken], Estimate | None]:
    """The recordings as a calibration takes them, and nu as the sharpest of their pictures reads it."""

    read = [beside_the_punch(one) for one in taken]
    known = [bulge for _, bulge in read if bulge is not None and bulge.value is not None and bulge.std]
    return [one for one, _ in read], min(known, key=lambda bulge: bulge.std or 0.0, default=None)


def _data(taken: Sequence[Taken]) -> Observations:
    """The curves of these recordings where there are any, else the certified points."""
    from calibration.inputs.gather import observe_all
    from calibration.tasks.calibrate import observe

    sets = [one.measured for one in taken]
    return observe_all(sets) if any(one.curves for one in sets) else observe(sets)


def _path_of(key: str, own: Sequence[Effect], paths: Sequence[Path] | None) -> str:
    """The file of a private effect; empty for one of the catalogue."""
    return next(
        (str(path.resolve()) for effect, path in zip(own, paths or (), strict=True) if effect.key == key), ""
    )


def _keep_history(recordings: Sequence[Path], steps: Sequence[Step], folder: Path, out: Path) -> None:
    """history.json, and the script that repeats these steps from wherever it is run; both end up in `out`."""
    from calibration.session import History
    from tactilevision.files import write_text

    history = History(tuple(str(path.resolve()) for path in recordings))
    for step in steps:
        history = history.add(step)
    history.save(folder / "history.json")
    write_text(folder / "repeat.sh", history.script(_again_in(out)))


def _again_in(folder: Path) -> Path:
    """Where a repeated analysis goes: beside what it repeats, which stays."""
    return folder.resolve() / "repeated"


def steps(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="What diagnose or compare wrote.")],
    undo: Annotated[bool, typer.Option("--undo", help="Take the last step back.")] = False,
    redo: Annotated[bool, typer.Option("--redo", help="Put back the step taken back last.")] = False,
) -> None:
    """The steps of an analysis: show them, take one back, and write the script that repeats them (repeat.sh)."""
    from calibration.session import load_history
    from tactilevision.files import write_text

    history = load_history(folder / "history.json")
    if undo:
        history = history.undo()
    if redo:
        history = history.redo()
    history.save(folder / "history.json")
    script = history.script(_again_in(folder))
    write_text(folder / "repeat.sh", script)
    for number, step in enumerate(history.steps, start=1):
        console.say(f"{number}. + {step.key.replace('_', ' ')}: {_step_errors(step)}")
    for step in reversed(history.undone):
        console.say(f"   taken back: {step.key.replace('_', ' ')}")
    console.say(script.splitlines()[-1])
    if (undo or redo) and (folder / "calibration.json").is_file():
        console.say(
            f"{folder / 'calibration.json'} is as --apply wrote it: steps change no calibration. Diagnose "
            "again without --apply, or calibrate, for one without the effect."
        )
