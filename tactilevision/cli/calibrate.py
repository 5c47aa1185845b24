"""`tactilevision calibrate RECORDING...`: frames and forces, or points, or curves, into E and nu."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console

if TYPE_CHECKING:
    from calibration.data import Measured
    from calibration.result import CalibrationResult
    from tactilevision.press.certificate import Certificate
    from tactilevision.recording import Recording
    from tactilevision.records import CertifiedPoint


class LawName(StrEnum):
    """Which law turns depth and force into a material."""

    DEFAULT = "default"
    PAPER = "paper"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one recording; `result` is None where nothing could be certified, and `why` says so."""

    recording: Recording
    certificate: Certificate | None
    result: CalibrationResult | None = None
    why: str = ""

    @property
    def points(self) -> tuple[CertifiedPoint, ...]:
        """Certified just now, or as the recording brought them."""
        return self.recording.points if self.certificate is None else self.certificate.points

    @property
    def measured(self) -> Measured:
        """What the fit gets."""
        from calibration.data import Measured

        curves = self.recording.curves if self.certificate is None else ()
        return Measured(self.recording, self.points, curves)


def calibrate(
    recordings: Annotated[list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one sensor.")],
    out: console.OutOption = Path("calibration_out"),
    law: Annotated[
        LawName,
        typer.Option(help="default: kappa from first principles at the true a/h; paper: the published route."),
    ] = LawName.DEFAULT,
    json: console.JsonOption = None,
) -> None:
    """Certify each press, then fit Young's modulus and Poisson's ratio; writes tables, JSON and a report.

    Of several recordings each has its own folder in OUT; the newest one's result stands in OUT itself, and
    history.csv says whether the gel has changed.
    """
    from tactilevision.errors import NothingCertified
    from tactilevision.files import staged
    from tactilevision.recording import read_recording

    opened = sorted((read_recording(path) for path in recordings), key=lambda one: str(one.date or ""))
    outcomes = [_calibrate_one(recording, law.value) for recording in opened]
    with staged(out) as stage:
        _write(outcomes[-1], stage)
        if len(outcomes) > 1:
            for number, outcome in enumerate(outcomes, start=1):
                _write(outcome, stage / f"{number:02d}_{outcome.recording.name}")
            _write_history(outcomes, law.value, stage)
    latest = outcomes[-1]
    _tell(latest, out)
    if latest.result is None:
        raise NothingCertified(latest.why)
    console.hand_over(latest.result.as_json(), json)


def _calibrate_one(recording: Recording, law: str) -> Outcome:
    from calibration.calibrate import calibrate as fit_material
    from tactilevision.errors import NothingCertified

    console.warn(recording.warnings)
    outcome = Outcome(recording, _certify(recording) if recording.frame_names else None)
    clock = outcome.certificate.clock_offset if outcome.certificate else None
    try:
        return replace(outcome, result=fit_material(outcome.measured, law=law, clock_offset=clock))
    except NothingCertified as fault:
        return replace(outcome, why=str(fault))


def _certify(recording: Recording) -> Certificate:
    from tactilevision.press.certify import certify
    from tactilevision.reconstruct import build_reconstructor

    with console.progress_bar("calibrating the light"):
        reconstructor = build_reconstructor(recording)
    with console.progress_bar("certifying presses") as progress:
        certificate = certify(recording, reconstructor, progress=progress)
    console.warn([*reconstructor.warnings, *certificate.warnings])
    return certificate


def _write(outcome: Outcome, folder: Path) -> None:
    from calibration.report import calibration_page
    from tactilevision.cli import pictures
    from tactilevision.files import write_json, write_text
    from tactilevision.recording import write_curves, write_points

    certificate, result = outcome.certificate, outcome.result
    if outcome.points:
        write_points(folder, outcome.points)
    if certificate is not None and certificate.curves:
        write_curves(folder, certificate.curves)
    if result is not None:
        write_json(folder / "calibration.json", result.as_json())
    with console.progress_bar("drawing") as progress:
        fits = pictures.of_fit(result, outcome.points, folder) if result is not None else []
        presses = pictures.of_presses(outcome.recording, certificate, folder, progress) if certificate else []
    notes = [*outcome.recording.warnings, *(certificate.warnings if certificate else ())]
    title = f"Calibration of {outcome.recording.name}"
    write_text(
        folder / "report.html",
        calibration_page(title, result, outcome.points, figures=fits, presses=presses, notes=notes),
    )


def _write_history(outcomes: Sequence[Outcome], law: str, folder: Path) -> None:
    from calibration.history import history
    from tactilevision.cli import pictures
    from tactilevision.recording import write_table

    rows = history([outcome.measured for outcome in outcomes if outcome.result is not None], law=law)
    flat = [row.as_row() for row in rows]
    write_table(folder / "history.csv", {column: [row[column] for row in flat] for column in flat[0]})
    pictures.of_history(rows, folder)
    for row in rows:
        moved = "has moved" if row.moved else "no change that can be told"
        console.say(f"{row.date} {row.recording}: stiffness {100 * row.change:+.1f} % since the first, {moved}")


def _tell(outcome: Outcome, out: Path) -> None:
    from calibration.report import summary

    if outcome.result is not None:
        console.warn(outcome.result.warnings)
        console.say(*summary(outcome.result))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures beside it")
