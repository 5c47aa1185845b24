"""The pictures of a diagnosis, written into its folder and handed to its page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibration.diagnosis.diagnosis import Diagnosis
    from calibration.diagnosis.residual_maps import ResidualMap
    from calibration.model.stages import Effect
    from calibration.report.diagnosis_report import Drawn
    from calibration.report.report import Picture
    from tactilevision.cli.measure import Taken
    from tactilevision.cli.pictures import FigureFolder

RED_IS = "red: a pattern that is not chance; grey: single readings; bars: 95 % intervals of the bins' means"


def evidence(found: Diagnosis, reliefs: Sequence[ResidualMap], *, folder: FigureFolder) -> list[Picture]:
    """Where the model fails, how the error falls, what the picture says, what can be told apart."""
    return [
        *_of_the_misfit(found, folder),
        *_of_the_picture(found, reliefs, folder),
        *_of_the_fits(found, folder),
        *_of_what_looks_alike(found, folder),
    ]


def _of_the_misfit(found: Diagnosis, folder: FigureFolder) -> list[Picture]:
    """Presses that stand out, residuals over what was recorded, and the error on presses left out."""
    from calibration.report.drawing import own_offsets, residual_panels
    from tactilevision.plots import diagnosis as draw

    kept, offsets = [], own_offsets(found)
    if offsets is not None:
        words = (
            "How far each press lies from the others, as an offset of its depth; red: it cannot be one of them."
        )
        kept.append(folder.keep(draw.draw_offsets(offsets), "presses.png", caption=words))
    panels = draw.draw_residuals(residual_panels(found.base, found.covariates_before))
    words = f"What the plain law leaves, the most telling first ({RED_IS})."
    kept.append(folder.keep(panels, "residuals.png", caption=words))
    count, errors = len(found.held_out), found.errors
    if count > 1:
        names = ["base", *(_words(e.key) for e in found.effects if e.key in found.fitted.model.keys)]
        fall = draw.draw_waterfall(names[:count], found.held_out, repeatability_N=errors.floor)
        words = "Error on presses left out of the fit; dashed: the repeatability, how far like presses scatter."
        kept.append(folder.keep(fall, "error.png", caption=words))
    return kept


def _of_the_fits(found: Diagnosis, folder: FigureFolder) -> Iterator[Picture]:
    """The model before, and after where something was added."""
    from calibration.report.drawing import drawn_points, fitted_lines
    from tactilevision.plots.indentation import draw_fit

    for name, fitted in (("before", found.base), ("after", found.fitted)):
        if name == "before" or fitted is not found.base:
            drawn = draw_fit(drawn_points(fitted), fitted_lines(fitted))
            yield folder.keep(drawn, f"fit_{name}.png", caption=f"The measurements and the model, {name}.")


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
            "The depth that the picture gives, of each face and of the slopes beside it, over the certified one;"
        )
        words = f"{words} 1 is right. {picture_lacks(found)}".strip()
        kept.append(folder.keep(draw.draw_sighting(seen), "reconstructed.png", caption=words))
    for number, one in enumerate(reliefs):
        p = ", ".join(f"{c.key.removeprefix('height map: ')} p = {c.p_adjusted:.2g}" for c in one.covariates)
        drawn = draw.draw_residual_map(one.residual_mm, one.axis, count=one.count)
        kept.append(folder.keep(drawn, f"height_map_{number}.png", caption=f"What the height maps leave ({p})."))
    return kept


def drawn_cards(found: Diagnosis, private: Sequence[Effect], *, folder: FigureFolder) -> list[Drawn]:
    """Each candidate with what it would leave, over what is left."""
    from calibration.report.diagnosis_report import Drawn
    from calibration.report.drawing import cards
    from tactilevision.plots.diagnosis import draw_overlay

    made = []
    for card in cards(found, private):
        picture = None
        if card.overlay is not None:
            words = f"What the plain law leaves, and what {_words(card.key)} alone would."
            picture = folder.keep(draw_overlay(card.overlay), f"candidates/{card.key}.png", caption=words)
        made.append(Drawn(card, picture))
    return made


def reliefs(taken: Sequence[Taken]) -> list[ResidualMap]:
    """What the height maps of each recording with frames leave."""
    from calibration.diagnosis.residual_maps import Surface, residual_map

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
