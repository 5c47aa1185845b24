"""Pictures of models against measurements, kept in a folder, each with a caption that names its colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibration.report.report import Picture
    from tactilevision.cli.console import Progress
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.records import Estimate
    from tactilevision.records.misfit import ErrorFall, ForceCurves, ResidualStrips

TELLING = 4  # presses that are shown first: as many as a screen holds
SHEET = 6  # presses on a sheet of all of them
BESIDE = (
    " Plain bars: the gel beside the faces, each fall of it over the expected one, times the certified depth. "
    "Hatched: the faces themselves, of whose depth steep walls hide a part."
)
SHEETS = 12  # sheets at most; of more presses the most telling are shown


def keep_falls(falls: Sequence[ErrorFall], folder: FigureFolder) -> list[Picture]:
    """How the error falls: of the force, and of the picture's depth where that was looked at."""
    from tactilevision.plots.misfit import draw_error_fall

    kept = []
    for fall in falls:
        name = "error.png" if fall.unit == "N" else "error_depth.png"
        band = ", shaded its 95 % interval" if fall.band is not None else ""
        of = "the force" if fall.unit == "N" else "the depth that the picture reads, beside the certified one"
        repeats = f"dashed: the repeatability, how far like presses scatter{band}"
        words = f"{coloured(fall.models)} Error of {of}, rms; {repeats}.{BESIDE if fall.faces else ''}"
        kept.append(folder.keep(draw_error_fall(fall), name, caption=words))
    return kept


def keep_presses(curves: ForceCurves, thickness_mm: float, folder: FigureFolder) -> list[Picture]:
    """The presses that tell most in time and depth, and all of them as force over depth."""
    from tactilevision.plots.misfit import draw_overview, draw_presses

    kept = []
    if curves.whole:
        shown = curves.telling(TELLING)
        chosen = "on which most changes" if len(curves.models) > 1 else "that the model misses most"
        words = (
            f"The {len(shown)} presses {chosen}. Black dots: measured. {coloured(curves.models)} "
            "On the right what each model leaves, on one scale."
        )
        kept.append(folder.keep(draw_presses(curves, shown), "presses.png", caption=words))
    words = (
        f"All presses: force over depth against depth over thickness. {radii_coloured(curves)} Black: the model."
    )
    return [*kept, folder.keep(draw_overview(curves, thickness_mm), "secant.png", caption=words)]


def keep_every_press(curves: ForceCurves, folder: FigureFolder, progress: Progress) -> list[Picture]:
    """Sheets of all presses, for those who want to see each; the most telling where they are very many."""
    from tactilevision.plots.misfit import draw_presses

    if not curves.whole:
        return []
    shown = curves.telling(SHEET * SHEETS)
    sheets = [shown[k : k + SHEET] for k in range(0, len(shown), SHEET)]
    kept = []
    for number, sheet in enumerate(sheets, start=1):
        words = f"Presses {sheet[0].label} to {sheet[-1].label}. Black dots: measured. {coloured(curves.models)}"
        kept.append(folder.keep(draw_presses(curves, sheet), f"presses/sheet_{number:02d}.png", caption=words))
        progress(number, len(sheets), "presses")
    return kept


def keep_strips(shown: ResidualStrips, folder: FigureFolder) -> list[Picture]:
    """What is left against everything recorded."""
    from tactilevision.plots.misfit import draw_strips

    if not shown.strips:
        return []
    words = (
        "Measured less modelled force, the most telling first, all on one scale. "
        f"{coloured(shown.models, ends=True)} "
        "Pale dots: single readings; bars: 95 % intervals of the bins' means. "
        "p that a dependence is chance, for all panels; a trend is one of the presses' means that rise or fall."
    )
    return [folder.keep(draw_strips(shown), "residuals.png", caption=words)]


def keep_moduli(names: Sequence[str], moduli: Sequence[Estimate], folder: FigureFolder) -> list[Picture]:
    """Young's modulus under each model."""
    from tactilevision.plots.misfit import draw_moduli

    words = f"Young's modulus with its 95 % interval. {coloured(names)}"
    return [folder.keep(draw_moduli(names, moduli), "modulus.png", caption=words)]


def coloured(models: Sequence[str], *, ends: bool = False) -> str:
    """Which colour is which model, in words; with `ends` the first and the last alone."""
    from tactilevision.plots.misfit import model_colours
    from tactilevision.plots.style import COLOUR_WORDS

    names = [name.replace("+ ", "with " if place == 1 else "and with ", 1) for place, name in enumerate(models)]
    pairs = list(zip(model_colours(len(models)), names, strict=True))
    if ends and len(pairs) > 2:
        pairs = [pairs[0], (pairs[-1][0], "with all that was added")]
    said = "; ".join(f"{COLOUR_WORDS[colour]}: {name}" for colour, name in pairs)
    return f"{said[0].upper()}{said[1:]}." if said else ""


def radii_coloured(curves: ForceCurves) -> str:
    """Which colour is which radius, in words."""
    from tactilevision.plots.misfit import radius_colours
    from tactilevision.plots.style import COLOUR_WORDS

    said = "; ".join(
        f"{COLOUR_WORDS[colour]}: a = {radius:g} mm" for radius, colour in radius_colours(curves.radii_mm).items()
    )
    return f"Measured, {said}."
