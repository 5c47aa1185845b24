"""The pictures of a diagnosis, written into its folder and handed to its page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from tactilevision.cli import console, misfit_pictures as keep

if TYPE_CHECKING:
    from calibration.diagnosis.diagnosis import Diagnosis
    from calibration.fit.least_squares import Fit
    from calibration.model.stages import Effect
    from calibration.report.diagnosis_report import Drawn, Evidence
    from calibration.report.drawing import Card
    from calibration.report.report import Picture
    from calibration.report.residual_maps import ResidualMap
    from tactilevision.cli.measure import Taken
    from tactilevision.cli.pictures import FigureFolder


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
    from tactilevision.files import write_text

    shown = evidence(found, private, reliefs, folder=folder)
    write_text(folder.path / "report.html", diagnosis_page(title, found, shown, commands=commands))


def evidence(
    found: Diagnosis, private: Sequence[Effect], reliefs: Sequence[ResidualMap], *, folder: FigureFolder
) -> Evidence:
    """Every picture of the page."""
    from calibration.report.diagnosis_report import Evidence, after_words
    from calibration.report.drawing import cards, plain_card
    from calibration.report.error_fall import BASE, error_fall_of_diagnosis, error_fall_of_sight
    from calibration.report.force_curves import force_curves

    fits = shown_fits(found)
    curves = force_curves(fits)
    fall = error_fall_of_diagnosis(found)
    plain = plain_card(found)
    before_after = {BASE: found.before.youngs_modulus, after_words(found): found.after.youngs_modulus}
    with console.progress_bar("drawing") as progress:
        return Evidence(
            misfit=[
                *_of_odd_presses(found, folder),
                *keep.keep_presses(curves, found.base.data.gel.thickness_mm, folder),
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
    """The plain law's fit, and the last one's where effects of the force were added."""
    from calibration.report.error_fall import BASE

    named = [e.key.replace("_", " ") for e in found.effects if e.key in found.fitted.model.keys]
    return {BASE: found.base} | ({f"+ {' + '.join(named)}": found.fitted} if named else {})


def _strips(found: Diagnosis, fits: dict[str, Fit], folder: FigureFolder) -> list[Picture]:
    from calibration.report.residual_strips import residual_strips

    scored = [found.covariates_before, found.covariates][: len(fits)]
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
    from calibration.report.diagnosis_report import Drawn
    from tactilevision.plots.diagnosis import draw_overlay

    if card.overlay is None:
        return Drawn(card, None)
    name = _words(card.overlay.key)
    words = f"Orange: what is left without it; black: what {name} explains of it; blue: what is left with {name}."
    return Drawn(card, folder.keep(draw_overlay(card.overlay), f"candidates/{card.key}.png", caption=words))


def reliefs(taken: Sequence[Taken]) -> list[ResidualMap]:
    """What the height maps of each recording with frames leave."""
    from calibration.report.residual_maps import Surface, residual_map

    found = []
    for one in taken:
        if one.certificate is None or one.recording.sensor.gel is None:
            continue
        surfaces = []
        for point in one.certificate.points:
            evidence = one.certificate.evidence.get(point.press)
            if not point.accepted or evidence is None or evidence.height_map is None or evidence.footprint is None:
                continue
            indenter = one.recording.indenters[point.indenter]
            surfaces.append(
                Surface(
                    evidence.height_map,
                    evidence.footprint.centre_mm,
                    indenter.radius_mm,
                    point.depth_mm,
                    indenter.bevel,
                )
            )
        left = residual_map(surfaces, one.recording.sensor.gel)
        found += [left] if left is not None else []
    return found


def _words(key: str) -> str:
    return key.replace("_", " ")
