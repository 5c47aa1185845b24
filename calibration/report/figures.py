"""Figures of a calibration, a comparison and a diagnosis, written with captions to a folder."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibration.diagnosis.diagnosis import Diagnosis
from calibration.diagnosis.experiment_design import PLACES
from calibration.diagnosis.press_contrast import press_gains
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.vision_depth_check import unseen_beside
from calibration.fit.least_squares import Fit
from calibration.fit.repeats import LEVEL
from calibration.inputs.deadline import Progress
from calibration.report import drawing, page
from calibration.report.drawing import ResidualMap, overlay
from calibration.report.headline import DIAGNOSED
from calibration.result.material import joint_region
from calibration.result.result import CalibrationResult
from calibration.tasks.calibrate import HistoryRow
from calibration.tasks.compare import rms_of_presses
from calibration.tasks.passport import Passport
from tactilevision.errors import RecordingError
from tactilevision.files.writing import plain_name
from tactilevision.plots import calibration as indentation, diagnosis as draw, misfit, style
from tactilevision.press.certificate import Certificate
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Estimate
from tactilevision.records.misfit import ErrorFall, ForceCurves, ResidualStrips
from tactilevision.sensors.rectification import rectify

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class FigureChoice:
    """Which figures are drawn, and how.

    `form`: one of style.FORMS, written next to the PNG. `presses`: "all" of them, a "few" (the rejected ones and
    those that fit worst), or "none".
    """

    form: str = "png"
    presses: str = "few"

    @property
    def every_press(self) -> bool:
        """Return whether each press is drawn."""
        return self.presses == "all"


STEPS = 40  # places along a fitted drift
USUAL = FigureChoice()  # PNG, a few presses


@dataclass(frozen=True, slots=True)
class FigureFolder:
    """The folder of a report's figures, and the choice of them."""

    path: Path
    choice: FigureChoice = USUAL

    def keep(self, figure: Figure, name: str, *, caption: str = "") -> str:
        """Write a figure as NAME.png, and return it as HTML for the report."""
        path = self.path / name
        style.save_figure(figure, path, form=self.choice.form)
        return page.figure(style.data_uri(path, photograph=style.holds_photographs(figure)), caption)


def of_fit(result: CalibrationResult, points: Sequence[CertifiedPoint], *, folder: FigureFolder) -> list[str]:
    """Draw force against depth with the fitted law, and E over nu."""
    fitted = result.fitted
    lines = drawing.fitted_lines(fitted)
    drawn = indentation.draw_fit(drawing.drawn_points(fitted, points), lines)
    several = len({line.name for line in lines}) > 1
    colours = "one colour a radius" if several else "black: accepted; blue: the law"
    words = f"Certified points and the fitted law ({colours}; grey: rejected); bars and bands are 95 % intervals."
    return [folder.keep(drawn, "fit.png", caption=words), _material(result, folder)]


def _material(result: CalibrationResult, folder: FigureFolder) -> str:
    """Draw E over nu: the joint region and the routes where there are any, else the curve with its intervals."""
    words = "One punch determines the curve; what is known of ν selects the part of it."
    if not result.routes:
        plain = (result.youngs_modulus_of_nu, result.youngs_modulus, result.poisson_ratio)
        return folder.keep(indentation.draw_material(*plain), "material.png", caption=words)
    curve, region = joint_region(result)
    known = [(r.name, r.poisson_ratio, r.used) for r in result.routes if r.poisson_ratio.value is not None]
    routes = [(name, nu.interval95, used) for name, nu, used in known if nu.interval95 is not None]
    found = result.material
    best = None if found is None else (found.poisson_ratio, found.youngs_modulus_MPa)
    words += " The region contains both at 95 %; where friction is unknown it includes a gel that sticks,"
    words += " where no edge is stated a rounded one."
    drawn = indentation.draw_joint(curve, region, best=best, routes=routes)
    return folder.keep(drawn, "material.png", caption=words)


WORST = 3  # accepted presses whose pictures are drawn among a few: those with the largest residuals


def shown_presses(
    result: CalibrationResult | None, points: Sequence[CertifiedPoint], choice: FigureChoice
) -> set[str]:
    """Return the presses to draw: of a few, the rejected ones and the accepted ones with the largest residuals."""
    if choice.presses == "none":
        return set()
    if choice.every_press or result is None:
        return {point.press for point in points}
    fitted = result.fitted
    errors = dict(zip(fitted.data.presses.label, rms_of_presses(fitted).tolist(), strict=True))
    worst = sorted(errors, key=errors.__getitem__, reverse=True)[:WORST]
    return {point.press for point in points} - set(errors) | set(worst)


def of_presses(
    recording: Recording,
    certificate: Certificate,
    *,
    shown: Collection[str],
    folder: FigureFolder,
    progress: Progress,
) -> list[str]:
    """Draw each of the presses `shown` that has evidence."""
    pictures = []
    for number, point in enumerate(certificate.points, start=1):
        evidence = certificate.evidence.get(point.press)
        if evidence is not None and point.press in shown:
            rgb = None
            if evidence.frame_index is not None:
                try:
                    rgb = rectify(recording.sensor, read_frame(recording, evidence.frame_index).rgb)
                except RecordingError:
                    rgb = None  # a damaged frame
            figure = indentation.draw_press(evidence, point, rgb=rgb)
            words = "; ".join(finding.text for finding in evidence.findings)
            name = f"presses/{picture_name(point.press, number)}"
            caption = f"Press {point.press}: " + (words or "no objection.")
            pictures.append(folder.keep(figure, name, caption=caption))
        progress(number, len(certificate.points))
    return pictures


def picture_name(label: str, number: int) -> str:
    """Return the file's name of the picture of a press, whose label may be any text."""
    plain = plain_name(label)
    return f"{plain}.png" if plain == label else f"{number:03d}_{plain}.png"


def of_history(rows: Sequence[HistoryRow], folder: FigureFolder) -> None:
    """Draw E over time."""
    names = [row.date or row.recording for row in rows]
    drawn = indentation.draw_history(
        names, [row.youngs_modulus for row in rows], moved=[row.moved for row in rows]
    )
    folder.keep(drawn, "history.png")


def of_ageing(found: Passport, folder: FigureFolder) -> str:
    """Draw the change of the stiffness and E over time; nothing where no recording has a stiffness."""
    line, each = found.ageing.line, [(one, one.own) for one in found.entries if one.own is not None]
    if not each:
        return ""
    entries, owns = zip(*each, strict=True)
    days = np.array([(one.date - entries[0].date).days for one in entries], float)
    log_c = np.log([own.value for own in owns])
    std = np.array([own.std / own.value for own in owns])
    drawn, begin = None, log_c[0]
    if line is not None:
        at = np.linspace(0, days[-1], STEPS)
        weight = 1 / (std**2 + line.scatter**2)
        begin = np.average(log_c - line.rate * days, weights=weight)
        drawn = line.band(at)
    words = "Above: the change of the stiffness c since the first recording, by its own noise alone. "
    words += "Below: E with all of its uncertainty, most of which the recordings share."
    figure = indentation.draw_ageing(
        days,
        np.expm1(log_c - begin),
        std,
        line=drawn,
        modulus=[one.numbers["youngs_modulus_MPa"] for one in entries],
        dates=(str(entries[0].date), str(entries[-1].date)),
    )
    return folder.keep(figure, "ageing.png", caption=words)


# Figures of models against measurements, with captions that name their colours.

SHOWN = 4  # presses in the first figure
SHEET = 6  # presses on a sheet
OUTSIDE = (
    " Plain bars: the gel outside the faces, its measured over its expected fall, times the certified depth. "
    "Hatched: the faces themselves, of whose depth steep walls hide a part."
)
SHEETS = 12  # sheets at most; of more presses those with the largest differences are shown


def keep_falls(falls: Sequence[ErrorFall], folder: FigureFolder) -> list[str]:
    """Draw the error of each model: of the force, and of the picture's depth where that was examined."""
    kept = []
    for fall in falls:
        name = "error.png" if fall.unit == "N" else "error_depth.png"
        band = ", shaded its 95 % interval" if fall.band is not None else ""
        of = "the force" if fall.unit == "N" else "the reconstructed depth, compared with the certified one"
        repeats = f"dashed: the repeatability, the scatter of equal presses{band}"
        words = f"{coloured(fall.models)} Error of {of}, rms; {repeats}.{OUTSIDE if fall.faces else ''}"
        kept.append(folder.keep(misfit.draw_error_fall(fall), name, caption=words))
    return kept


def keep_presses(curves: ForceCurves, thickness_mm: float, folder: FigureFolder) -> list[str]:
    """Draw the presses with the largest differences in time and depth, and all of them as force over depth."""
    kept = []
    if curves.whole:
        shown = curves.most_changed(SHOWN)
        chosen = "that change most" if len(curves.models) > 1 else "with the largest residuals"
        words = (
            f"The {len(shown)} presses {chosen}. Black dots: measured. {coloured(curves.models)} "
            "On the right the residual of each model, on one scale."
        )
        kept.append(folder.keep(misfit.draw_presses(curves, shown), "presses.png", caption=words))
    words = (
        f"All presses: force over depth against depth over thickness. {radii_coloured(curves)} Black: the model."
    )
    return [*kept, folder.keep(misfit.draw_overview(curves, thickness_mm), "secant.png", caption=words)]


def keep_every_press(curves: ForceCurves, folder: FigureFolder, progress: Progress) -> list[str]:
    """Draw sheets of all presses, or of those with the largest differences where they are very many."""
    if not (curves.whole and folder.choice.every_press):
        return []
    shown = curves.most_changed(SHEET * SHEETS)
    sheets = [shown[k : k + SHEET] for k in range(0, len(shown), SHEET)]
    kept = []
    for number, sheet in enumerate(sheets, start=1):
        words = f"Presses {sheet[0].label} to {sheet[-1].label}. Black dots: measured. {coloured(curves.models)}"
        kept.append(
            folder.keep(misfit.draw_presses(curves, sheet), f"presses/sheet_{number:02d}.png", caption=words)
        )
        progress(number, len(sheets), "presses")
    return kept


def keep_strips(shown: ResidualStrips, folder: FigureFolder) -> list[str]:
    """Draw the residuals against everything recorded."""
    if not shown.strips:
        return []
    words = (
        "Measured less modelled force, the most significant first, all on one scale. "
        f"{coloured(shown.models, ends=True)} "
        "Pale dots: single readings; triangles: presses beyond the panel, the farthest by name; bars: 95 % "
        "intervals of the bins' means. "
        "p-values account for all panels; a trend is one of the presses' means that rise or fall."
    )
    return [folder.keep(misfit.draw_strips(shown), "residuals.png", caption=words)]


def keep_moduli(gels: Mapping[str, CalibrationResult], over: Estimate | None, folder: FigureFolder) -> list[str]:
    """Draw Young's modulus under each model, and that `over` what a diagnosis does not exclude."""
    words = f"Young's modulus with its 95 % interval, with unseen. {coloured(list(gels))}"
    moduli = {name: one.youngs_modulus for name, one in gels.items()}
    moduli |= {} if over is None else {DIAGNOSED: over}
    drawn = misfit.draw_moduli(list(moduli), list(moduli.values()), models=len(gels))
    return [folder.keep(drawn, "modulus.png", caption=words)]


def coloured(models: Sequence[str], *, ends: bool = False) -> str:
    """Return the colours of the models in words; with `ends` of the first and the last alone."""
    names = [name.replace("+ ", "with " if place == 1 else "and with ", 1) for place, name in enumerate(models)]
    pairs = list(zip(misfit.model_colours(len(models)), names, strict=True))
    if ends and len(pairs) > 2:
        pairs = [pairs[0], (pairs[-1][0], "the full model")]
    said = "; ".join(f"{style.COLOUR_WORDS[colour]}: {name}" for colour, name in pairs)
    return f"{said[0].upper()}{said[1:]}." if said else ""


def radii_coloured(curves: ForceCurves) -> str:
    """Return the colours of the radii in words."""
    said = "; ".join(
        f"{style.COLOUR_WORDS[colour]}: a = {radius:g} mm"
        for radius, colour in misfit.radius_colours(curves.radii_mm).items()
    )
    return f"Measured, {said}."


# Figures of a diagnosis.


def keep_odd_presses(found: Diagnosis, folder: FigureFolder) -> list[str]:
    """Draw how far each press lies from the others, where some are odd."""
    offsets = drawing.own_offsets(found)
    if offsets is None:
        return []
    words = "How far each press lies from the others, as an offset of its depth. Blue: like the others"
    words += "; orange: it cannot be one of them." if any(offsets.odd) else "."
    return [folder.keep(draw.draw_offsets(offsets), "offsets.png", caption=words)]


def keep_pad(found: Diagnosis, folder: FigureFolder) -> list[str]:
    """Draw the presses on the pad, where their stiffness depends on the place."""
    contrast, base = found.presses.contrast, found.fits.base
    if contrast is None or contrast.covariate not in PLACES:
        return []
    presses = base.data.presses
    named = np.isin(np.array(presses.label), contrast.presses)
    place = np.nan_to_num(np.column_stack([presses.x_mm, presses.y_mm]))
    drawn = draw.draw_pad(place, press_gains(base), presses.label, named)
    words = "Relative stiffness of each press about the base model, at its place. Orange: the presses that differ."
    return [folder.keep(drawn, "pad.png", caption=words)]


def keep_confusable_effects(found: Diagnosis, folder: FigureFolder) -> list[str]:
    """Draw the separation of the effects."""
    table = drawing.confusability(found)
    if table is None:
        return []
    words = (
        "Separation, in std, of each row's effect, if present, from the best that the column's effect could do "
        "instead; below 3 the two look alike."
    )
    return [folder.keep(draw.draw_confusability(*table), "confusability.png", caption=words)]


def keep_reconstructed_depth(found: Diagnosis, reliefs: Sequence[ResidualMap], folder: FigureFolder) -> list[str]:
    """Draw the picture's depth over the certified one, and the residual of the height maps."""
    kept, seen, sight = [], drawing.sighting(found), found.search.sight
    if seen is not None and sight is not None:
        words = (
            "The depth that the picture reads over the certified one; 1 is right. Squares: punch faces; dots: "
            "slopes next to them. Orange: as read"
        )
        words += "; blue: corrected by what was found." if seen.corrected is not None else "."
        words = f"{words} {unseen_beside(sight.base.data)}".strip()
        kept.append(folder.keep(draw.draw_sighting(seen), "reconstructed.png", caption=words))
    for number, one in enumerate(reliefs):
        words = (
            f"Height maps less what is expected. {_dependence(one)} Red: deeper than expected; blue: less deep; "
            "grey: not compared. Lengths are in radii of the punch, whose axis is the middle."
        )
        drawn = draw.draw_residual_map(one.residual_mm, one.axis, count=one.count)
        kept.append(folder.keep(drawn, f"height_map_{number}.png", caption=words))
    return kept


def _dependence(one: ResidualMap) -> str:
    """Return what the height maps' residual depends on, in a sentence."""
    on = {"azimuth": "the direction", "radius": "the distance from the punch"}
    said = []
    for scored in one.covariates:
        key = scored.key.removeprefix("height map: ")
        depends = "depends" if scored.p_adjusted < LEVEL else "does not depend"
        said.append(f"{depends} on {on.get(key, key)} (p = {scored.p_adjusted:.2g})")
    return f"The residual {', and '.join(said)}." if said else ""


def keep_overlay(base: Fit, candidate: Candidate, folder: FigureFolder) -> str:
    """Draw the residual that a candidate would leave, over the residuals without it and with it."""
    key = candidate.effect.key
    name = key.replace("_", " ")
    words = f"Orange: residual without it; black: what {name} explains of it; blue: residual with {name}."
    return folder.keep(draw.draw_overlay(overlay(base, candidate), name), f"candidates/{key}.png", caption=words)
