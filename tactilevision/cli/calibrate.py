"""Run the commands `calibrate` and `plan`: E and nu from presses, and presses for a goal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tactilevision.cli import console
from tactilevision.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.inputs.observations import Measured
    from calibration.tasks.plan import Design, Forecast, Goal, Margin, Plan, PressNoise
    from tactilevision.cli.pictures import FigureFolder
    from tactilevision.pipeline import Calibrated, CertifiedRecording
    from tactilevision.records.measured import Pair
    from tactilevision.records.rig import Gel, Indenter


# `tactilevision calibrate RECORDING...`: frames and forces, or points, or curves, into E and nu.


class LawName(StrEnum):
    """Which law turns depth and force into a material."""

    DEFAULT = "default"
    PAPER = "paper"


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
    from tactilevision.files.writing import plain_name, staged
    from tactilevision.pipeline import calibrate_each

    paths = _below(recordings)
    outcomes = calibrate_each(paths, law=law.value, prior=prior, cluster=cluster, listener=console)
    with staged(out) as stage:
        _write(outcomes[-1], stage, form)
        if not _holds_a_recording(out):
            _describe(outcomes[-1].certified, stage)
        for number, outcome in enumerate(outcomes[:-1], start=1):
            older = f"{number:02d}_{plain_name(outcome.certified.recording.name)}"
            _write(outcome, stage / older, form)
            if not _holds_a_recording(out / older):
                _describe(outcome.certified, stage / older)
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


def _write(outcome: Calibrated, folder: Path, form: str) -> None:
    from calibration.report.report import calibration_page
    from tactilevision.cli import pictures
    from tactilevision.files.writing import write_json, write_text
    from tactilevision.recording.write import write_curves, write_points

    certified, result = outcome.certified, outcome.result
    recording, certificate = certified.recording, certified.certificate
    if certified.points:
        write_points(folder, certified.points)
    if certificate is not None and certificate.curves:
        write_curves(folder, certificate.curves)
    write_json(folder / "calibration.json", outcome.content)
    with console.progress_bar("drawing") as progress:
        figures = pictures.FigureFolder(folder, form)
        fits = pictures.of_fit(result, certified.points, folder=figures) if result is not None else []
        presses = (
            pictures.of_presses(recording, certificate, folder=figures, progress=progress) if certificate else []
        )
    notes = certified.warnings if result is None else ()
    title, why = f"Calibration of {recording.name}", str(outcome.fault)
    write_text(
        folder / "report.html",
        calibration_page(
            title, result, points=certified.points, figures=fits, presses=presses, notes=notes, why=why
        ),
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


def _describe(certified: CertifiedRecording, folder: Path) -> None:
    """Gel and indenters beside the points, so that what was written is itself a recording of points or curves."""
    from tactilevision.recording.write import write_settings

    sensor = replace(certified.recording.sensor, rectification=None)  # there are no frames here to rectify
    write_settings(replace(certified.recording, path=folder, sensor=sensor))


def _write_history(outcomes: Sequence[Calibrated], law: str, figures: FigureFolder) -> None:
    from calibration.tasks.calibrate import history
    from tactilevision.cli import pictures
    from tactilevision.recording.write import write_table

    rows = history([outcome.certified.measured for outcome in outcomes if outcome.result is not None], law=law)
    flat = [row.as_row() for row in rows]
    write_table(figures.path / "history.csv", {column: [row[column] for row in flat] for column in flat[0]})
    pictures.of_history(rows, figures)
    for row in rows:
        moved = "has moved" if row.moved else "no change that can be told"
        console.say(f"{row.date} {row.recording}: stiffness {100 * row.change:+.1f} % since the first, {moved}")


def _tell(outcome: Calibrated, out: Path) -> None:
    from calibration.report.report import summary
    from calibration.result.result import in_words

    if outcome.result is not None:
        console.warn([line for line in outcome.result.warnings if line not in outcome.certified.warnings])
        console.say(*summary(outcome.result))
    else:
        console.say(*in_words(outcome.certified.points))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures next to it")


# `tactilevision plan`: how many presses of which heights give E within a goal, before any is made.

Numbers = Annotated[str | None, typer.Option(metavar="LIST", help="Numbers (mm) with commas between.")]
Range = Annotated[str | None, typer.Option(metavar="VALUE", help="A guess, or the two ends of a range: .1,.4")]
Size = Annotated[float | None, typer.Option(help="A length in mm; left out: as the recording states, or unknown.")]


def plan(
    recording: Annotated[
        Path | None, typer.Argument(metavar="[RECORDING]", help="Takes gel, indenters and noise from its files.")
    ] = None,
    radius: Numbers = None,
    heights: Numbers = None,
    thickness: Size = None,
    thickness_std: Size = None,
    pad_radius: Size = None,
    edge_radius: Size = None,
    height_std: Size = None,
    modulus: Range = None,
    poisson_ratio: Range = None,
    poisson_ratio_std: Annotated[
        float | None, typer.Option(help="nu is known beforehand with this std; left out: it is not.")
    ] = None,
    lubricated: Annotated[bool, typer.Option("--lubricated", help="The presses will be.")] = False,
    repeats: Annotated[
        int | None, typer.Option(help="Presses of each height as given; left out: the recording's, or 3.")
    ] = None,
    depth_noise: Annotated[float | None, typer.Option(help="Std of one press's depth, mm.")] = None,
    force_noise: Annotated[float | None, typer.Option(help="Std of one press's force, N.")] = None,
    gain_noise: Annotated[float | None, typer.Option(help="Std of one press's force, percent of it.")] = None,
    within: Annotated[float, typer.Option(help="Half width of E's 95 % interval to reach, percent.")] = 3.0,
    within_nu: Annotated[float | None, typer.Option(help="Also that of nu, in units of nu.")] = None,
    within_c: Annotated[float | None, typer.Option(help="Also that of c, percent.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write the plan here too, as JSON.")] = None,
) -> None:
    """Forecast E, nu and c from a design, and find the fewest presses that reach a goal.

    Give --radius, --heights and --thickness, or a RECORDING that states them.
    """
    from calibration.tasks.plan import Goal, plan as find_plan
    from tactilevision.files.writing import write_json

    design = _read(recording) if recording is not None else _blank(thickness)
    gel = _gel(design.gel, thickness, thickness_std, pad_radius)
    guess = _range("--poisson-ratio", poisson_ratio, design.poisson_ratio)
    if poisson_ratio_std is not None:
        gel = replace(gel, poisson_ratio=sum(guess) / 2, poisson_ratio_std=poisson_ratio_std)
    design = replace(
        design,
        gel=gel,
        indenters=_faces(
            design, _numbers("--radius", radius), _numbers("--heights", heights), edge_radius, height_std
        ),
        repeats=design.repeats if repeats is None else repeats,
        youngs_modulus_MPa=_range("--modulus", modulus, design.youngs_modulus_MPa),
        poisson_ratio=guess,
        noise=_noise(design.noise, depth_noise, force_noise, gain_noise),
        lubricated=lubricated or design.lubricated,
    )
    found = find_plan(design, goal=Goal(within / 100, within_nu, None if within_c is None else within_c / 100))
    console.say(*_report(found))
    if out is not None:
        write_json(out, found.as_json())
        console.say(f"wrote {out}")


def _blank(thickness_mm: float | None) -> Design:
    from calibration.tasks.plan import Design
    from tactilevision.records.rig import Gel

    if thickness_mm is None:
        raise InputError(
            "the gel's thickness is needed", where="--thickness", remedy="Give it in mm, or name a recording."
        )
    return Design(Gel(thickness_mm), ())


def _read(path: Path) -> Design:
    """Gel, punch faces, noise, and what its points say of E."""
    from calibration.inputs.observations import TYPICAL_FORCE_N, TYPICAL_ZERO_MM, Measured
    from calibration.tasks.plan import Design, PressNoise
    from tactilevision.recording.read import read_recording

    recording = read_recording(path)
    console.warn(recording.warnings)
    gel = recording.sensor.gel
    if gel is None:
        raise InputError("the recording states no gel", where=path, remedy="Add [sensor.gel] to recording.toml.")
    faces = tuple(one for one in recording.indenters.values() if one.shape == "flat_cylinder")
    force = recording.force_std_N
    noise = PressNoise(recording.depth_std_mm or TYPICAL_ZERO_MM, force[2] if force else TYPICAL_FORCE_N)
    nu = gel.poisson_ratio
    design = Design(gel, faces, noise=noise)
    if recording.presses and faces:
        design = replace(design, repeats=max(round(len(recording.presses) / len(recording.indenters)), 1))
    if nu is not None:
        design = replace(design, poisson_ratio=(nu, nu))
    wet = bool(recording.presses) and all(press.lubricated == 1 for press in recording.presses)
    design = replace(design, lubricated=wet)
    return _from_points(design, Measured(recording, recording.points)) if recording.points else design


def _from_points(design: Design, measured: Measured) -> Design:
    """The design with E of the size that certified points have, and the errors that they share."""
    from calibration.inputs.gather import observe_points
    from calibration.laws.flat_punch import starting_modulus

    data = observe_points(measured)
    modulus = starting_modulus(data)
    return replace(design, youngs_modulus_MPa=(modulus, modulus), shared=data.shared)


def _gel(gel: Gel, thickness: float | None, std: float | None, pad_radius: float | None) -> Gel:
    gel = replace(gel, thickness_mm=gel.thickness_mm if thickness is None else thickness)
    gel = replace(gel, thickness_std_mm=gel.thickness_std_mm if std is None else std)
    return gel if pad_radius is None else replace(gel, shape="disc", radius_mm=pad_radius)


def _faces(
    design: Design,
    radii: tuple[float, ...],
    heights: tuple[float, ...],
    edge_mm: float | None,
    height_std_mm: float | None,
) -> tuple[Indenter, ...]:
    """A face for each radius and height, else as the recording states it; its own where neither is given."""
    from tactilevision.records.rig import Indenter

    stated = {one.radius_mm: one for one in design.indenters}
    faces = tuple(one for one in design.indenters if one.height_mm is not None)
    if radii or heights:
        heights = heights or tuple(sorted({one.height_mm for one in faces if one.height_mm is not None}))
        faces = tuple(
            replace(stated.get(a, Indenter("")), name=f"radius {a:g} height {h:g}", radius_mm=a, height_mm=h)
            for a in radii or sorted(stated)
            for h in heights
        )
    if not faces:
        raise InputError(
            "radii and step heights are needed",
            where="--radius, --heights",
            remedy="Give both in mm: --heights .2,.4",
        )
    if edge_mm is not None:
        faces = tuple(replace(face, edge_radius_mm=edge_mm) for face in faces)
    return faces if height_std_mm is None else tuple(replace(face, height_std_mm=height_std_mm) for face in faces)


def _noise(noise: PressNoise, depth: float | None, force: float | None, gain: float | None) -> PressNoise:
    return replace(
        noise,
        depth_std_mm=noise.depth_std_mm if depth is None else depth,
        force_std_N=noise.force_std_N if force is None else force,
        gain=noise.gain if gain is None else gain / 100,
    )


def _numbers(name: str, text: str | None) -> tuple[float, ...]:
    """Numbers between commas, each once, in rising order."""
    if text is None:
        return ()
    try:
        return tuple(sorted({float(part) for part in text.split(",")}))
    except ValueError as fault:
        raise InputError("numbers with commas between are needed", where=name, value=text) from fault


def _range(name: str, text: str | None, usual: Pair) -> Pair:
    numbers = _numbers(name, text)
    if len(numbers) > 2:
        raise InputError("one number, or the two ends of a range, are needed", where=name, value=text)
    return (numbers[0], numbers[-1]) if numbers else usual


def _report(found: Plan) -> Iterator[str]:
    """The table, the answer, and what it rests on."""
    rows = [("as given", found.as_given), ("all heights", found.all_heights), ("fewest presses", found.fewest)]
    shown = [(name, row) for name, row in (*rows, ("any number", found.limit)) if row is not None]
    yield f"{'':<15}{'heights (mm)':<26}{'presses':>9}{'E':>9}{'nu':>10}{'c':>9}"
    for name, row in shown:
        yield _row(name, row, endless=row is found.limit)
    yield "half widths of 95 % intervals (*: there is no value; half of what stays possible)"
    yield ""
    yield from _answer(found)
    yield from (f"assumed: {line}" for line in found.assumptions)


def _row(name: str, row: Forecast, *, endless: bool) -> str:
    heights = ", ".join(f"{height:g}" for height in row.design.heights_mm)
    size = "" if endless else f"{len(row.design.indenters)} x {row.design.repeats}"
    nu = "open" if row.nu_is_open else f"{row.poisson_ratio.half_width:.4f}"
    return f"{name:<15}{heights:<26}{size:>9}{_percent(row.youngs_modulus):>9}{nu:>10}{_percent(row.c):>9}"


def _percent(margin: Margin) -> str:
    return f"{100 * margin.half_width:.1f} %" + ("" if margin.std is not None else "*")


def _answer(found: Plan) -> Iterator[str]:
    goal = _goal(found.goal)
    if found.fewest is not None:
        design = found.fewest.design
        heights = ", ".join(f"{height:g}" for height in design.heights_mm)
        each = "each height" if len(design.radii_mm) == 1 else "each height and radius"
        yield f"{design.presses} presses reach {goal}: {design.repeats} of {each}, {heights} mm"
        return
    yield f"no number of presses reaches {goal}"
    if found.limit.nu_is_open:
        yield "nu stays open, and E with it: they fix the stiffness c and the curve E(nu), not both"
    for remedy in found.remedies:
        least = remedy.least
        told = f"{least.design.presses} presses" if least is not None else "not enough"
        yield f"  {remedy.action}: {told} (E {_percent(remedy.limit.youngs_modulus)} with any number)"


def _goal(goal: Goal) -> str:
    parts = [f"E within {100 * goal.youngs_modulus:g} %"] if goal.youngs_modulus is not None else []
    parts += [f"nu within {goal.poisson_ratio:g}"] if goal.poisson_ratio is not None else []
    parts += [f"c within {100 * goal.c:g} %"] if goal.c is not None else []
    return " and ".join(parts)
