"""Commands `calibrate`, `passport` and `plan`: E and nu from presses, over weeks, and presses for a goal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Literal

import typer

from calibration.report.figures import FigureChoice
from calibration.report.passport_report import passport_lines
from calibration.report.report import summary
from calibration.result.result import in_words
from calibration.tasks.plan import Design, Forecast, Goal, Margin, Plan, design_of, faces_of, plan as find_plan
from tactilevision.batch.tree import find_recordings
from tactilevision.cli import console
from tactilevision.errors import InputError
from tactilevision.files.runs import output_lock
from tactilevision.pipeline import calibrate_each
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Pair
from tactilevision.records.rig import Gel
from tactilevision.result_folders import write_calibrations, write_passport


def calibrate(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one sensor, or folders of them.")
    ],
    out: console.OutOption = Path("calibration_out"),
    law: Annotated[
        Literal["default", "paper"],
        typer.Option(help="Fit from first principles at the true a/h, or by the published route (paper)."),
    ] = "default",
    prior: console.PriorOption = True,
    test: Annotated[bool, typer.Option("--test/--no-test", help="Test whether the law explains the data.")] = True,
    cluster: console.ClusterOption = None,
    form: console.FormatOption = "png",
    pictures: console.PicturesOption = "few",
    json: console.JsonOption = None,
) -> None:
    """Certify each press, then fit Young's modulus and Poisson's ratio; writes tables, JSON and a report.

    Of several recordings the newest one's result stands in OUT itself, each older one's in a folder of its own;
    history.csv says whether the gel has changed.
    """
    paths = [path for given in recordings for path in find_recordings(given)]
    outcomes = calibrate_each(paths, law=law, prior=prior, test=test, cluster=cluster, listener=console)
    for row in write_calibrations(outcomes, out, law=law, choice=FigureChoice(form, pictures), listener=console):
        moved = "has changed" if row.moved else "no significant change"
        console.say(f"{row.date} {row.recording}: stiffness {100 * row.change:+.1f} % since the first, {moved}")
    latest = outcomes[-1]
    for one in outcomes:
        said = one.result.warnings if one.result is not None else ()
        of = "" if one is latest else f"{one.certified.recording.name}: "
        console.warn([f"{of}{line.removeprefix(of)}" for line in said if line not in one.certified.warnings])
    if latest.result is not None:
        console.say(*summary(latest.result))
    else:
        console.say(*in_words(latest.certified.points))
    console.say(f"wrote {out / 'report.html'}, and the tables and figures next to it")
    console.hand_over(latest.content, json)
    if latest.fault is not None:
        raise latest.fault


def passport(
    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="RECORDING...", help="Recordings of one sensor in order of time, or folders."),
    ],
    out: console.OutOption = Path("passport_out"),
    ledger: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Keep entries of all sensors in this SQLite file, and go on from them."),
    ] = None,
    tolerance: Annotated[
        float, typer.Option(min=0.1, max=100, help="Tolerate this error of E by ageing, percent.")
    ] = 5.0,
    form: console.FormatOption = "png",
    json: console.JsonOption = None,
) -> None:
    """Follow a gel over weeks: E and nu with their dates, the change, and when to recalibrate.

    Recordings that are in the ledger already are not calibrated again.
    """
    with output_lock(ledger, file=True) if ledger is not None else nullcontext():
        found = write_passport(
            recordings,
            out,
            ledger=ledger,
            tolerance=tolerance / 100,
            choice=FigureChoice(form),
            listener=console,
        )
    console.say(f"{found.sensor}: {len(found.entries)} recordings", *passport_lines(found))
    console.warn(found.warnings)
    console.say(f"wrote {out / 'passport.html'} and passport.json" + (f"; {ledger}" if ledger is not None else ""))
    console.hand_over(found.as_json(), json)


# `tactilevision plan`: how many presses of which heights give E within a goal, before any is made.

Numbers = Annotated[str | None, typer.Option(metavar="LIST", help="List lengths in mm, with commas between.")]
Range = Annotated[str | None, typer.Option(metavar="VALUE", help="Give a guess, or two ends of a range: .1,.4.")]
Size = Annotated[float | None, typer.Option(help="State a length in mm; by default as the recording does.")]


def plan(
    recording: Annotated[Path | None, typer.Argument(help="Its files state gel, indenters and noise.")] = None,
    radius: Numbers = None,
    heights: Numbers = None,
    thickness: Size = None,
    thickness_std: Size = None,
    pad_radius: Size = None,
    edge_radius: Size = None,
    height_std: Size = None,
    modulus: Range = None,
    poisson_ratio: Range = None,
    poisson_ratio_std: Annotated[float | None, typer.Option(help="State the std of nu.")] = None,
    lubricated: Annotated[bool, typer.Option("--lubricated", help="Plan for lubricated presses.")] = False,
    repeats: Annotated[int | None, typer.Option(help="Plan so many a height; by default as recorded.")] = None,
    depth_noise: Annotated[float | None, typer.Option(help="State the std of a press's depth, mm.")] = None,
    force_noise: Annotated[float | None, typer.Option(help="State the std of a press's force, N.")] = None,
    gain_noise: Annotated[float | None, typer.Option(help="State the std of a press's force, percent.")] = None,
    within: Annotated[float, typer.Option(help="Reach this half width of E's 95 % interval, percent.")] = 3.0,
    within_nu: Annotated[float | None, typer.Option(help="Also reach this half width of nu.")] = None,
    within_c: Annotated[float | None, typer.Option(help="Also reach this half width of c, percent.")] = None,
    json: console.JsonOption = None,
) -> None:
    """Forecast E, nu and c from a design, and find the fewest presses that reach a goal.

    Give --radius, --heights and --thickness, or a RECORDING that states them.
    """
    usual = _usual(recording, thickness)
    faces = faces_of(usual, console.numbers("--radius", radius), console.numbers("--heights", heights))
    gel = {"thickness_mm": thickness, "thickness_std_mm": thickness_std, "radius_mm": pad_radius}
    design = usual.with_stated(
        faces,
        gel=gel | {"poisson_ratio_std": poisson_ratio_std},
        each_face={"edge_radius_mm": edge_radius, "height_std_mm": height_std},
        noise={"depth_std_mm": depth_noise, "force_std_N": force_noise, "gain": _share(gain_noise)},
        repeats=repeats,
        youngs_modulus_MPa=_range("--modulus", modulus),
        poisson_ratio=_range("--poisson-ratio", poisson_ratio),
        lubricated=lubricated or None,
    )
    found = find_plan(design, goal=Goal(within / 100, within_nu, _share(within_c)))
    console.say(*_report(found))
    console.hand_over(found.as_json(), json)


def _usual(path: Path | None, thickness_mm: float | None) -> Design:
    """Return the design of a recording, or one of a gel of this thickness alone."""
    if path is not None:
        recording = read_recording(path)
        console.warn(recording.warnings)
        return design_of(recording)
    if thickness_mm is None:
        remedy = "Give it in mm, or name a recording."
        raise InputError("the gel's thickness is needed", where="--thickness", remedy=remedy)
    return Design(Gel(thickness_mm), ())


def _share(percent: float | None) -> float | None:
    return None if percent is None else percent / 100


def _range(name: str, text: str | None) -> Pair | None:
    numbers = console.numbers(name, text)
    if len(numbers) > 2:
        raise InputError("one number, or the two ends of a range, are needed", where=name, value=text)
    return (numbers[0], numbers[-1]) if numbers else None


def _report(found: Plan) -> Iterator[str]:
    """Yield the table, the answer, and its assumptions."""
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
        number = f"{least.design.presses} presses" if least is not None else "not enough"
        yield f"  {remedy.action}: {number} (E {_percent(remedy.limit.youngs_modulus)} with any number)"


def _goal(goal: Goal) -> str:
    parts = [f"E within {100 * goal.youngs_modulus:g} %"] if goal.youngs_modulus is not None else []
    parts += [f"nu within {goal.poisson_ratio:g}"] if goal.poisson_ratio is not None else []
    parts += [f"c within {100 * goal.c:g} %"] if goal.c is not None else []
    return " and ".join(parts)
