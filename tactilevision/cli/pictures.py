"""The pictures of a calibration, written into its folder and handed to the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibration.report.report import Picture
from tactilevision.cli.console import Progress
from tactilevision.files import plain_name
from tactilevision.plots import indentation, style
from tactilevision.plots.press import draw_press

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibration.result.result import CalibrationResult
    from calibration.tasks.history import HistoryRow
    from tactilevision.certificate.certificate import Certificate
    from tactilevision.recording import Recording
    from tactilevision.records import CertifiedPoint


@dataclass(frozen=True, slots=True)
class FigureFolder:
    """Where the figures of a report go: each as PNG, and in `form` beside it where that is another."""

    path: Path
    form: str = "png"

    def keep(self, figure: Figure, name: str, *, caption: str = "") -> Picture:
        """Write a figure as NAME.png, and give it to the report."""
        path = self.path / name
        style.save_figure(figure, path, form=self.form)
        return Picture(style.data_uri(path), caption)


def of_fit(result: CalibrationResult, points: Sequence[CertifiedPoint], *, folder: FigureFolder) -> list[Picture]:
    """Force against depth with the fitted law, and E over nu."""
    from calibration.report.drawing import drawn_points, fitted_lines

    fitted = result.fitted
    lines = fitted_lines(fitted)
    drawn = indentation.draw_fit(drawn_points(fitted, points), lines)
    several = len({line.name for line in lines}) > 1
    colours = "one colour a radius" if several else "black: accepted; blue: the law"
    words = f"Certified points and the fitted law ({colours}; grey: rejected); bars and bands are 95 % intervals."
    return [folder.keep(drawn, "fit.png", caption=words), _material(result, folder)]


def _material(result: CalibrationResult, folder: FigureFolder) -> Picture:
    """E over nu: the joint region and the routes where there are any, else the curve with its intervals."""
    words = "One punch fixes the curve; what is known of ν picks the part of it."
    if not result.routes:
        plain = (result.youngs_modulus_of_nu, result.youngs_modulus, result.poisson_ratio)
        return folder.keep(indentation.draw_material(*plain), "material.png", caption=words)
    from calibration.result.joint_region import joint_picture
    from tactilevision.plots.joint import draw_joint

    seen = joint_picture(result)
    routes = [(band.name, band.interval, band.used) for band in seen.bands]
    words += " The region holds both at 95 %; where friction is unknown it reaches down to a gel that sticks,"
    words += " where no edge is stated up to a rounded one."
    drawn = draw_joint(seen.curve, seen.region, best=seen.best, routes=routes)
    return folder.keep(drawn, "material.png", caption=words)


def of_presses(
    recording: Recording, certificate: Certificate, *, folder: FigureFolder, progress: Progress
) -> list[Picture]:
    """One strip for each press that left evidence."""
    from tactilevision.errors import RecordingError
    from tactilevision.recording import read_frame
    from tactilevision.sensors import rectify

    pictures = []
    for number, point in enumerate(certificate.points, start=1):
        evidence = certificate.evidence.get(point.press)
        if evidence is not None:
            rgb = None
            if evidence.frame_index is not None:
                try:
                    rgb = rectify(recording.sensor, read_frame(recording, evidence.frame_index).rgb)
                except RecordingError:
                    rgb = None  # a torn frame has no picture; the strip says so
            figure = draw_press(evidence, point, rgb=rgb)
            words = "; ".join(finding.text for finding in evidence.findings)
            name = f"presses/{picture_name(point.press, number)}"
            caption = f"Press {point.press}: " + (words or "nothing against it.")
            pictures.append(folder.keep(figure, name, caption=caption))
        progress(number, len(certificate.points))
    return pictures


def picture_name(label: str, number: int) -> str:
    """A file's name for the picture of a press: a label may be any text, also one that a folder cannot hold."""
    plain = plain_name(label)
    return f"{plain}.png" if plain == label else f"{number:03d}_{plain}.png"


def of_history(rows: Sequence[HistoryRow], folder: FigureFolder) -> None:
    """E over time."""
    names = [row.date or row.recording for row in rows]
    drawn = indentation.draw_history(
        names, [row.youngs_modulus for row in rows], moved=[row.moved for row in rows]
    )
    folder.keep(drawn, "history.png")
