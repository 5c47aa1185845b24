"""Run the commands `diagnose` and `new-effect`, and write the pictures of a diagnosis."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console, pictures as keep
from tactilevision.cli.analysis import (
    Private,
    Recordings,
    Seed,
    Settings,
    TimeLimit,
    commands_of,
    keep_history,
    named_effects,
)
from tactilevision.cli.compare import forget_found, keep_calibration

if TYPE_CHECKING:
    from calibration.diagnosis.diagnosis import Diagnosis
    from calibration.fit.least_squares import Fit
    from calibration.model.stages import Effect
    from calibration.report.diagnosis_report import Drawn, Evidence
    from calibration.report.drawing import Card, ResidualMap
    from calibration.report.page import Picture
    from calibration.tasks.session import Step
    from tactilevision.cli.pictures import FigureFolder


# `tactilevision diagnose`: where the model fails, what is missing, and how sure that is.

With = Annotated[
    list[str] | None,
    typer.Option("--with", metavar="KEY|FILE.py", help="An effect that is in from the start."),
]


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
    from calibration.inputs.deadline import Deadline
    from calibration.report.diagnosis_report import summary
    from calibration.tasks.session import Step
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.files.writing import staged, write_json
    from tactilevision.pipeline import certify_recordings, diagnose_recording, height_residuals

    deadline = Deadline.after(time_limit)
    (sure, sure_files), (own, own_files) = named_effects(known), named_effects(private)
    taken = certify_recordings(recordings, scale_doubt=False, cluster=cluster, listener=console)
    found = diagnose_recording(
        taken,
        effects=own,
        known=sure,
        prior=prior,
        seed=seed,
        deadline=deadline,
        workers=workers,
        cluster=cluster,
        listener=console,
    )
    files = sure_files | own_files
    steps = [*(Step(effect.key, files.get(effect.key, "")) for effect in sure), *steps_of(found, files)]
    commands = commands_of(recordings, found, files, prior=prior)
    surfaces = height_residuals(taken)
    content = found.as_json() | {"height_map": [c.as_json() for one in surfaces for c in one.covariates]}
    with staged(out) as stage:
        write_json(stage / "diagnosis.json", content)
        keep_history(recordings, steps, stage, out=out, settings=Settings(seed, prior, apply))
        if apply:
            keep_calibration(out, stage)
            write_json(stage / "calibration.json", found.material.after.as_json())
        title = "Diagnosis of " + ", ".join(one.recording.name for one in taken)
        figures = FigureFolder(stage, form)
        write_diagnosis(found, figures, title=title, private=own, reliefs=surfaces, commands=commands)
    forget_found(out)
    console.say(*summary(found), *(f"to try: {text}" for text in commands))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures next to it")
    console.hand_over(content, json)


def steps_of(found: Diagnosis, files: Mapping[str, str]) -> list[Step]:
    """A step for each effect that was added, with the errors before and after it; `files` of one's own by key."""
    from calibration.effects import written
    from calibration.report.misfit import error_fall_of_sight
    from calibration.tasks.session import Step

    named = {e.key: e for e in found.fits.fitted.model.effects}
    errors, added = found.errors, [e.key for e in found.effects if e.key in named]
    steps = [
        Step(written(named[key]), files.get(key, ""), errors.before, errors.after, *held, errors.floor)
        for key, held in zip(added, pairwise(found.errors.held_out_N), strict=True)
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
    from calibration.effects.private import new_effect as write

    write(path, key)
    console.say(f"wrote {path}; use it with: tactilevision diagnose RECORDING --effect {path}")


# The pictures of a diagnosis, written into its folder and handed to its page.

SHOWN = 0.05  # p of a dependence that is said to be there


def write_diagnosis(
    found: Diagnosis,
    folder: FigureFolder,
    *,
    title: str,
    private: Sequence[Effect],
    reliefs: Sequence[ResidualMap],
    commands: Sequence[str],
) -> None:
    """The figures and report.html."""
    from calibration.report.diagnosis_report import diagnosis_page
    from tactilevision.files.writing import write_text

    shown = evidence(found, private, reliefs, folder=folder)
    write_text(folder.path / "report.html", diagnosis_page(title, found, shown, commands=commands))


def evidence(
    found: Diagnosis, private: Sequence[Effect], reliefs: Sequence[ResidualMap], *, folder: FigureFolder
) -> Evidence:
    """Every picture of the page."""
    from calibration.report.diagnosis_report import Evidence, after_words
    from calibration.report.drawing import cards, plain_card
    from calibration.report.misfit import BASE, error_fall_of_diagnosis, error_fall_of_sight, force_curves

    fits = shown_fits(found)
    curves = force_curves(fits)
    fall = error_fall_of_diagnosis(found)
    plain = plain_card(found)
    before_after = {
        BASE: found.material.before.youngs_modulus,
        after_words(found): found.material.after.youngs_modulus,
    }
    with console.progress_bar("drawing") as progress:
        return Evidence(
            misfit=[
                *_of_odd_presses(found, folder),
                *keep.keep_presses(curves, found.fits.base.data.gel.thickness_mm, folder),
                *_strips(found, fits, folder),
            ],
            fall=keep.keep_falls([*([fall] if len(fall.models) > 1 else []), *error_fall_of_sight(found)], folder),
            picture=_of_the_picture(found, reliefs, folder),
            material=keep.keep_moduli(list(before_after), list(before_after.values()), folder),
            alike=list(_of_what_looks_alike(found, folder)),
            every_press=keep.keep_every_press(curves, folder, progress),
            cards=[_drawn(card, folder) for card in cards(found, private)],
            plain=None if plain is None else _drawn(plain, folder),
        )


def shown_fits(found: Diagnosis) -> dict[str, Fit]:
    """Return the base model's fit, and the last one's where effects of the force were added."""
    from calibration.report.misfit import BASE

    named = [e.key.replace("_", " ") for e in found.effects if e.key in found.fits.fitted.model.keys]
    return {BASE: found.fits.base} | ({f"+ {' + '.join(named)}": found.fits.fitted} if named else {})


def _strips(found: Diagnosis, fits: dict[str, Fit], folder: FigureFolder) -> list[Picture]:
    from calibration.report.misfit import residual_strips

    scored = [found.search.covariates_before, found.search.covariates][: len(fits)]
    return keep.keep_strips(residual_strips(fits, scored), folder)


def _of_odd_presses(found: Diagnosis, folder: FigureFolder) -> list[Picture]:
    """Presses that stand out."""
    from calibration.report.drawing import own_offsets
    from tactilevision.plots.diagnosis import draw_offsets

    offsets = own_offsets(found)
    if offsets is None:
        return []
    words = "How far each press lies from the others, as an offset of its depth. Blue: like the others"
    words += "; orange: it cannot be one of them." if any(offsets.odd) else "."
    return [folder.keep(draw_offsets(offsets), "offsets.png", caption=words)]


def _of_what_looks_alike(found: Diagnosis, folder: FigureFolder) -> Iterator[Picture]:
    """The table of effects that could stand for each other."""
    from calibration.report.drawing import confusability
    from tactilevision.plots.diagnosis import draw_confusability

    table = confusability(found)
    if table is not None:
        words = (
            "By how many std each row's effect, if it is there, parts from the best that the column's could do "
            "instead; below 3 they look alike."
        )
        yield folder.keep(draw_confusability(*table), "confusability.png", caption=words)


def _of_the_picture(found: Diagnosis, reliefs: Sequence[ResidualMap], folder: FigureFolder) -> list[Picture]:
    """The picture's depth over the certified one, and what the height maps leave, where there are any."""
    from calibration.report.drawing import picture_lacks, sighting
    from tactilevision.plots import diagnosis as draw

    kept, seen = [], sighting(found)
    if seen is not None:
        words = (
            "The depth that the picture reads over the certified one; 1 is right. Squares: punch faces; dots: "
            "slopes beside them. Orange: as read"
        )
        words += "; blue: corrected by what was found." if seen.corrected is not None else "."
        words = f"{words} {picture_lacks(found)}".strip()
        kept.append(folder.keep(draw.draw_sighting(seen), "reconstructed.png", caption=words))
    for number, one in enumerate(reliefs):
        words = (
            f"Height maps less what is expected. {relief_words(one)} Red: deeper than expected; blue: less deep; "
            "grey: not compared. Lengths are in radii of the punch, whose axis is the middle."
        )
        drawn = draw.draw_residual_map(one.residual_mm, one.axis, count=one.count)
        kept.append(folder.keep(drawn, f"height_map_{number}.png", caption=words))
    return kept


def relief_words(one: ResidualMap) -> str:
    """What the height maps' residual depends on, in a sentence."""
    on = {"azimuth": "the direction", "radius": "the distance from the punch"}
    said = []
    for scored in one.covariates:
        key = scored.key.removeprefix("height map: ")
        depends = "depends" if scored.p_adjusted < SHOWN else "does not depend"
        said.append(f"{depends} on {on.get(key, key)} (p = {scored.p_adjusted:.2g})")
    return f"What is left {', and '.join(said)}." if said else ""


def _drawn(card: Card, folder: FigureFolder) -> Drawn:
    """A candidate with what it would leave, over what is left without it and with it."""
    from calibration.effects import PLAIN
    from calibration.report.diagnosis_report import Drawn
    from tactilevision.plots.diagnosis import draw_overlay

    if card.overlay is None:
        return Drawn(card, None)
    name = "the instrument error" if card.key in PLAIN else _words(card.key)
    words = f"Orange: residual without it; black: what {name} explains of it; blue: residual with {name}."
    picture = draw_overlay(card.overlay, name)
    return Drawn(card, folder.keep(picture, f"candidates/{card.key}.png", caption=words))


def _words(key: str) -> str:
    return key.replace("_", " ")
