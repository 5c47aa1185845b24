"""`tactilevision diagnose` and `compare`: where the model fails, what is missing, and what adding it does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.measure import take

if TYPE_CHECKING:
    from calibration.diagnosis import Diagnosis
    from calibration.report import Picture
    from calibration.stages import Effect

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
    seed: Seed = 0,
    json: console.JsonOption = None,
) -> None:
    """Find out what is missing from the model: which effect, how sure, and what to measure next."""
    import numpy as np

    from calibration import diagnose as method
    from calibration.calibrate import observe
    from calibration.diagnosis_report import diagnosis_page, summary
    from calibration.steps import History, Step
    from tactilevision.files import staged, write_json, write_text

    taken = take(recordings)
    own = _private(private)
    with console.progress_bar("diagnosing"):
        data = observe([one.measured for one in taken])
        found = method.diagnose(data, np.random.default_rng(seed), effects=own, known=_known(known))
    history = History(tuple(str(path) for path in recordings))
    for effect in found.effects:
        history = history.add(Step(effect.key, "", found.errors.before, found.errors.after))
    with staged(out) as stage:
        write_json(stage / "diagnosis.json", found.as_json())
        history.save(stage / "history.json")
        write_text(stage / "repeat.sh", history.script())
        if apply:
            write_json(stage / "calibration.json", found.after.as_json())
        title = "Diagnosis of " + ", ".join(one.recording.name for one in taken)
        write_text(stage / "report.html", diagnosis_page(title, found, _figures(found, stage)))
    console.warn(found.after.warnings)
    console.say(*summary(found), f"wrote {out / 'report.html'}, and the tables and figures beside it")
    console.hand_over(found.as_json(), json)


def compare(
    recordings: Recordings,
    out: console.OutOption = Path("comparison_out"),
    known: Annotated[
        list[str] | None, typer.Option("--with", metavar="KEY", help="An effect to add, in this order.")
    ] = None,
    private: Private = None,
    seed: Seed = 0,
    json: console.JsonOption = None,
) -> None:
    """Add effects one after the other and watch the error, in and out of sample, beside the repeats' floor."""
    import numpy as np

    from calibration import compare as method
    from calibration.calibrate import observe
    from tactilevision.files import staged, write_json
    from tactilevision.plots import diagnosis as draw
    from tactilevision.plots import style

    data = observe([one.measured for one in take(recordings)])
    found = method.compare(data, [*_known(known), *_private(private)], np.random.default_rng(seed))
    console.warn([f"{key} could not be fitted and is left out: {why}" for key, why in found.left_out])
    names = [model.effects[-1].replace("_", " ") if model.effects else "base" for model in found.models]
    with staged(out) as stage:
        write_json(stage / "comparison.json", found.as_json())
        drawn = draw.draw_waterfall(names, [model.held_out_N for model in found.models], found.models[-1].floor_N)
        style.save_png(drawn, stage / "error.png")
    for name, model in zip(names, found.models, strict=True):
        console.say(
            f"{name:24s} rms {1e3 * model.rms_N:7.2f} mN, held out {1e3 * model.held_out_N:7.2f} mN, "
            f"floor {1e3 * model.floor_N:6.2f} mN"
        )
    console.say(f"wrote {out / 'comparison.json'} and {out / 'error.png'}")
    console.hand_over(found.as_json(), json)


def new_effect(
    path: Annotated[Path, typer.Argument(help="Python file to write.")],
    key: Annotated[str, typer.Option(help="The effect's name.")] = "my_effect",
) -> None:
    """Write a template of an effect of your own, for --effect."""
    from calibration.private import new_effect as write

    write(path, key)
    console.say(f"wrote {path}; use it with: tactilevision diagnose RECORDING --effect {path}")


def _known(keys: Sequence[str] | None) -> list[Effect]:
    from calibration.effects import get_effect

    return [get_effect(key) for key in keys or ()]


def _private(paths: Sequence[Path] | None) -> list[Effect]:
    from calibration.private import load_effect

    return [load_effect(path) for path in paths or ()]


def _figures(found: Diagnosis, folder: Path) -> list[Picture]:
    import numpy as np

    from calibration.drawing import confusability, drawn_points, fitted_lines, residual_panels
    from calibration.screen import screen
    from tactilevision.cli.pictures import keep
    from tactilevision.plots import diagnosis as draw
    from tactilevision.plots.indentation import draw_fit

    kept = []
    for name, fitted in (("before", found.base), ("after", found.fitted)):
        if name == "before" or found.effects:
            drawn = draw_fit(drawn_points(fitted), fitted_lines(fitted))
            kept.append(keep(drawn, folder / f"fit_{name}.png", f"The measurements and the model, {name}."))
    base = screen(found.base, (), np.random.default_rng(0))
    panels = draw.draw_residuals(residual_panels(found.base, base.covariates))
    kept.append(
        keep(panels, folder / "residuals.png", "What the base model leaves; red where it is not by chance.")
    )
    errors = found.errors
    names = [
        "base",
        *([" + ".join(e.key.replace("_", " ") for e in found.effects)] if found.effects else []),
    ]
    held = [errors.held_out_before, errors.held_out_after][: len(names)]
    fall = draw.draw_waterfall(names, held, errors.floor)
    kept.append(keep(fall, folder / "error.png", "Error on presses that the fit did not see."))
    table = confusability(found)
    if table is not None:
        drawn = draw.draw_confusability(*table)
        kept.append(
            keep(drawn, folder / "confusability.png", "Below 3 std two effects cannot be told apart here.")
        )
    return kept
