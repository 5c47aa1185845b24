"""Command `plan`: how many presses of which heights give E within a goal, before any is made."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from calibration.tasks.plan import Design, Forecast, Goal, Margin, Plan, design_of, faces_of, plan as find_plan
from tactilevision.cli import console, options
from tactilevision.errors import InputError
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Pair
from tactilevision.records.rig import Gel


def plan(given: options.Plan) -> None:
    """Forecast E, nu and c from a design, and find the fewest presses that reach a goal."""
    usual = _usual(given.recording, given.thickness)
    faces = faces_of(usual, console.numbers("--radius", given.radius), console.numbers("--heights", given.heights))
    gel = {"thickness_mm": given.thickness, "thickness_std_mm": given.thickness_std, "radius_mm": given.pad_radius}
    noise = {"depth_std_mm": given.depth_noise, "force_std_N": given.force_noise}
    design = usual.with_stated(
        faces,
        gel=gel | {"poisson_ratio_std": given.poisson_ratio_std},
        each_face={"edge_radius_mm": given.edge_radius, "height_std_mm": given.height_std},
        noise=noise | {"gain": _share(given.gain_noise)},
        repeats=given.repeats,
        youngs_modulus_MPa=_range("--modulus", given.modulus),
        poisson_ratio=_range("--poisson-ratio", given.poisson_ratio),
        lubricated=given.lubricated or None,
    )
    found = find_plan(design, goal=Goal(given.within / 100, given.within_nu, _share(given.within_c)))
    console.say(*_report(found))
    console.hand_over(found.as_json(), given.json)


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
