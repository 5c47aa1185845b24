"""`tactilevision calibrate RECORDING...`: frames and forces, or points, or curves, into E and nu."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactilevision.cli import console
from tactilevision.cli.measure import Taken, beside_the_punch, oldest_first, take, with_what_was_read

if TYPE_CHECKING:
    from calibration.result.result import CalibrationResult
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.errors import TactilevisionError


class LawName(StrEnum):
    """Which law turns depth and force into a material."""

    DEFAULT = "default"
    PAPER = "paper"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of one recording; `result` is None where its presses fix no material, and `fault` says why."""

    taken: Taken
    content: dict[str, Any]
    result: CalibrationResult | None = None
    fault: TactilevisionError | None = None


def calibrate(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one sensor, or folders of them.")
    ],
    out: console.OutOption = Path("calibration_out"),
    law: Annotated[
        LawName,
        typer.Option(help="default: kappa from first principles at the true a/h; paper: the published route."),
    ] = LawName.DEFAULT,
    prior: console.PriorOption = True,
    cluster: console.ClusterOption = None,
    form: console.FormatOption = console.FigureFormat.PNG,
    json: console.JsonOption = None,
) -> None:
    """Certify each press, then fit Young's modulus and Poisson's ratio; writes tables, JSON and a report.

    Of several recordings the newest one's result stands in OUT itself, each older one's in a folder of its own;
    history.csv says whether the gel has changed.
    """
    from tactilevision.cli import pictures
    from tactilevision.files import plain_name, staged

    outcomes = _outcomes(_below(recordings), law.value, prior=prior, cluster=cluster)
    with staged(out) as stage:
        _write(outcomes[-1], stage, form)
        if not _holds_a_recording(out):
            _describe(outcomes[-1].taken, stage)
        for number, outcome in enumerate(outcomes[:-1], start=1):
            older = f"{number:02d}_{plain_name(outcome.taken.recording.name)}"
            _write(outcome, stage / older, form)
            if not _holds_a_recording(out / older):
                _describe(outcome.taken, stage / older)
        if sum(outcome.result is not None for outcome in outcomes) > 1:
            _write_history(outcomes, law.value, pictures.FigureFolder(stage, form))
        earlier = _left_by_an_earlier_run(out, stage)
    for path in earlier:
        path.unlink(missing_ok=True)
    latest = outcomes[-1]
    _tell(latest, out)
    console.hand_over(latest.content, json)
    if latest.fault is not None:
        raise latest.fault


def _below(paths: Sequence[Path]) -> list[Path]:
    """The recordings in each folder that is none itself, in its place."""
    from tactilevision.batch.tree import find_sources
    from tactilevision.recording import layout

    def inside(path: Path) -> list[Path]:
        if not path.is_dir() or (path / layout.SETTINGS).exists():
            return []
        return [one for one in find_sources(path) if (one / layout.SETTINGS).exists()]

    return [one for path in paths for one in inside(path) or [path]]


def _outcomes(paths: Sequence[Path], law: str, *, prior: bool, cluster: str | None) -> list[Outcome]:
    """Of each recording, the oldest first; on a cluster each is a task of its own, which writes nothing."""
    if cluster is None:
        return [calibrate_one(taken, law, prior=prior) for taken in take(paths)]
    from tactilevision.cli.on_cluster import each_on_cluster

    given = oldest_first(paths)
    found = each_on_cluster(_there, given, law, prior, cluster=cluster, title="calibrating recordings")
    return [
        replace(one, taken=replace(one.taken, recording=recording))
        for one, recording in zip(found, given, strict=True)
    ]


def _there(path: Path, law: str, prior: bool) -> Outcome:
    """Of one recording, as it travels: without what made its maps, which is large."""
    outcome = calibrate_one(take([path])[0], law, prior=prior)
    return replace(outcome, taken=replace(outcome.taken, reconstructor=None))


def calibrate_one(taken: Taken, law: str, *, prior: bool = True) -> Outcome:
    """Raises InputError where the measurements were wrong as they came, before any press was looked at."""
    from calibration.laws.flat_punch import elastomer_bound
    from calibration.tasks.calibrate import calibrate as fit_material
    from tactilevision.errors import InputError, NothingCertified

    clock = taken.certificate.clock_offset if taken.certificate else None
    taken, bulge = beside_the_punch(taken) if law == LawName.DEFAULT else (taken, None)
    try:
        bound = elastomer_bound(prior)
        result = fit_material(taken.measured, law=law, clock_offset=clock, bulge=bulge, bound=bound)
    except (NothingCertified, InputError) as fault:
        looked_at = taken.certificate is not None
        if isinstance(fault, InputError) and not looked_at and all(point.accepted for point in taken.points):
            raise
        return Outcome(taken, _unfixed(taken, law, str(fault)), fault=fault)
    result = with_what_was_read(result, [taken])
    return Outcome(taken, result.as_json(), result)


def _unfixed(taken: Taken, law: str, why: str) -> dict[str, Any]:
    """calibration.json of a recording whose presses fix no material."""
    from calibration.result.undetermined import unfixed_as_json

    gel, clock = taken.recording.sensor.gel, taken.certificate.clock_offset if taken.certificate else None
    return unfixed_as_json(gel, taken.points, why=why, law=law, clock_offset=clock, warnings=taken.warnings)


def _write(outcome: Outcome, folder: Path, form: str) -> None:
    from calibration.report.report import calibration_page
    from tactilevision.cli import pictures
    from tactilevision.files import write_json, write_text
    from tactilevision.recording import write_curves, write_points

    taken, result = outcome.taken, outcome.result
    recording, certificate = taken.recording, taken.certificate
    if taken.points:
        write_points(folder, taken.points)
    if certificate is not None and certificate.curves:
        write_curves(folder, certificate.curves)
    write_json(folder / "calibration.json", outcome.content)
    with console.progress_bar("drawing") as progress:
        figures = pictures.FigureFolder(folder, form)
        fits = pictures.of_fit(result, taken.points, folder=figures) if result is not None else []
        presses = (
            pictures.of_presses(recording, certificate, folder=figures, progress=progress) if certificate else []
        )
    notes = taken.warnings if result is None else ()
    title, why = f"Calibration of {recording.name}", str(outcome.fault)
    write_text(
        folder / "report.html",
        calibration_page(title, result, points=taken.points, figures=fits, presses=presses, notes=notes, why=why),
    )


def _left_by_an_earlier_run(out: Path, stage: Path) -> list[Path]:
    """What an earlier calibration wrote into `out` and this one does not: it would be taken for part of these
    results.
    """
    if not (out / "calibration.json").exists():
        return []
    forms = [one.value for one in console.FigureFormat]
    names = ["history.csv", *(f"{name}.{form}" for name in ("fit", "material", "history") for form in forms)]
    names += [f"presses/{path.name}" for form in forms for path in (out / "presses").glob(f"*.{form}")]
    if not _holds_a_recording(out):
        names += ["points.csv", "curves.csv"]
    return [out / name for name in names if not (stage / name).exists()]


def _holds_a_recording(folder: Path) -> bool:
    """True where recording.toml is somebody's own, not one that an earlier calibration left."""
    from tactilevision.recording import layout

    measured = any((folder / name).exists() for name in (layout.PRESSES, layout.FORCES, layout.FRAME_TABLE))
    return (folder / layout.SETTINGS).exists() and (measured or not (folder / "calibration.json").exists())


def _describe(taken: Taken, folder: Path) -> None:
    """Gel and indenters beside the points, so that what was written is itself a recording of points or curves."""
    from tactilevision.recording.write import write_settings

    sensor = replace(taken.recording.sensor, rectification=None)  # there are no frames here to rectify
    write_settings(replace(taken.recording, path=folder, sensor=sensor))


def _write_history(outcomes: Sequence[Outcome], law: str, figures: FigureFolder) -> None:
    from calibration.tasks.history import history
    from tactilevision.cli import pictures
    from tactilevision.recording import write_table

    rows = history([outcome.taken.measured for outcome in outcomes if outcome.result is not None], law=law)
    flat = [row.as_row() for row in rows]
    write_table(figures.path / "history.csv", {column: [row[column] for row in flat] for column in flat[0]})
    pictures.of_history(rows, figures)
    for row in rows:
        moved = "has moved" if row.moved else "no change that can be told"
        console.say(f"{row.date} {row.recording}: stiffness {100 * row.change:+.1f} % since the first, {moved}")


def _tell(outcome: Outcome, out: Path) -> None:
    from calibration.report.report import summary
    from calibration.result.undetermined import in_words

    if outcome.result is not None:
        console.warn([line for line in outcome.result.warnings if line not in outcome.taken.warnings])
        console.say(*summary(outcome.result))
    else:
        console.say(*in_words(outcome.taken.points))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures beside it")
