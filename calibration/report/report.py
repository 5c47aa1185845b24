"""The report of a calibration: what came out, what it rests on, what was left out, each with its picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.fit.identifiability import main_radius
from calibration.report import page, wording
from calibration.result.result import CalibrationResult
from tactilevision.records.certified import CertifiedPoint

DEPTHS = (
    "As machined: how far the bevel stands back from the punch's face. Certified: that, less what the gel "
    "rises to meet the bevel."
)
PRESS_COLUMNS = (
    "press",
    "indenter",
    "verdict",
    "certified depth (mm)",
    "as machined (mm)",
    "force (N)",
    "sideways (N)",
)


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture as a data URI, and the words under it."""

    data_uri: str
    caption: str


def summary(result: CalibrationResult) -> list[str]:
    """What a person at the terminal needs to see."""
    law = {"paper": "the published route (a reproduction: log law for nu, a/h taken as 0.8)"}.get(
        result.law, result.law.replace("_", " ")
    )
    lines = [
        f"Young's modulus  E  = {wording.estimate(result.youngs_modulus)}",
        f"Poisson's ratio  nu = {wording.estimate(result.poisson_ratio)}, from {source_in_words(result)}",
        f"stiffness        c  = {wording.estimate(result.c)}",
        f"slope         beta  = {wording.estimate(result.beta)}",
        (f"R^2 = {result.r_squared:.4f}, " if math.isfinite(result.r_squared) else "")
        + f"{wording.fit_error(result.held_out_N, result.rms_error_N)}, "
        f"{wording.repeatability(result.noise_floor_N)}, law: {law}",
    ]
    if result.clock_offset.value is not None:
        lines.append(f"F/T clock minus camera clock = {wording.estimate(result.clock_offset)}")
    total = len(result.presses_accepted) + len(result.presses_rejected)
    lines.append(f"{len(result.presses_accepted)} of {total} presses accepted")
    lines += [f"  rejected {press}: {str(reason).replace('_', ' ')}" for press, reason in result.presses_rejected]
    return lines


def source_in_words(result: CalibrationResult) -> str:
    """Where nu comes from."""
    return {
        "bulge": "the rise of the gel beside the punch",
        "beta": "beta by the published log law",
        "radii": "punches of several radii",
        "prior": "prior knowledge, not these data",
    }.get(result.poisson_ratio_source, result.poisson_ratio_source)


def calibration_page(
    title: str,
    result: CalibrationResult | None,
    *,
    points: Sequence[CertifiedPoint],
    figures: Sequence[Picture] = (),
    presses: Sequence[Picture] = (),
    notes: Sequence[str] = (),
    why: str = "none of them can be trusted",
) -> str:
    """The page for one recording; `result` is None where its presses fix no material, and `why` says so.

    `notes`: what was said before that, which a result holds in its warnings.
    """
    if result is None:
        head = page.paragraph("The presses of this recording fix no material: " + why, kind="lead bad")
        details = page.section("Notes", page.listing(notes))
    else:
        head, details = _lead(result) + _head(result), _details(result)
    return page.page(
        title,
        head,
        page.section("Force against depth", *(page.figure(p.data_uri, p.caption) for p in figures)),
        details,
        page.section("Presses", _press_table(points), page.paragraph(DEPTHS, kind="soft")) if points else "",
        page.folded(
            f"Pictures of each press ({len(presses)}): frame, height map, signal of the bevel, force",
            *(page.figure(p.data_uri, p.caption) for p in presses),
        ),
    )


def _lead(result: CalibrationResult) -> str:
    """What a reader in a hurry takes away."""
    E, nu = wording.estimate(result.youngs_modulus), wording.estimate(result.poisson_ratio)
    kept = len(result.presses_accepted)
    presses = f"{kept} of {kept + len(result.presses_rejected)} presses"
    return page.paragraph(f"Young's modulus E is {E}, Poisson's ratio ν {nu}, from {presses}.", kind="lead")


def _head(result: CalibrationResult) -> str:
    rows = [
        ("Young's modulus E", wording.estimate(result.youngs_modulus), ""),
        ("Poisson's ratio ν", wording.estimate(result.poisson_ratio), f"from {source_in_words(result)}"),
        ("stiffness c", wording.estimate(result.c), "force over depth P/w at first touch: what one punch fixes"),
        ("slope β", wording.estimate(result.beta), "how P/w grows with depth over thickness: c (1 + β w/h)"),
        ("reduced modulus", wording.estimate(result.reduced_modulus), "E/(1 − ν²)"),
        ("clock of the force sensor", wording.estimate(result.clock_offset), "less that of the camera"),
        *_error_rows(result),
    ]
    return page.table(("", "value and 95 % interval", ""), rows)


def _error_rows(result: CalibrationResult) -> list[tuple[str, str, str]]:
    """The error on presses left out, and the repeatability that it is held against."""
    name, error = "error on presses left out (rms)", result.held_out_N
    if not math.isfinite(error):
        name, error = "error on the presses fitted (rms)", result.rms_error_N
    line = f"R² of the line {result.r_squared:.4f}" if math.isfinite(result.r_squared) else ""
    rows = [(name, f"{1e3 * error:.1f} mN", line)]
    if math.isfinite(result.noise_floor_N):
        scatter = f"{1e3 * result.noise_floor_N:.1f} mN"
        rows.append(("repeatability (std)", scatter, "how far the forces of like presses scatter"))
    return rows


ROUTES = {
    "bulge": "the rise of the gel beside the punch",
    "radii": "punches of several radii",
    "prior": "known beforehand",
    "beta": "the published law of β",
}


def _routes(result: CalibrationResult) -> str:
    """A table of what each route to nu says."""
    rows = [
        (ROUTES.get(r.name, r.name), wording.estimate(r.poisson_ratio), "used" if r.used else "not used")
        for r in result.routes
    ]
    return page.table(("route to ν", "value and 95 % interval", ""), rows)


def _details(result: CalibrationResult) -> str:
    return (
        page.section("Poisson's ratio by route", _routes(result))
        + page.section("Warnings", page.listing(result.warnings))
        + page.section("What this rests on", page.listing(result.assumptions))
        + page.section("Computed with", page.paragraph(_versions(result), kind="soft"))
    )


def _versions(result: CalibrationResult) -> str:
    versions = result.as_json()["versions"]
    radius = main_radius(result.fitted)
    return ", ".join(f"{name} {number}" for name, number in versions.items()) + f"; punch radius {radius:g} mm"


def _press_table(points: Sequence[CertifiedPoint]) -> str:
    rows = [
        (
            point.press,
            point.indenter,
            "accepted" if point.accepted else _why(point),
            _with_std(point.depth_mm, point.depth_std_mm),
            wording.number(point.depth_uncorrected_mm, point.depth_std_mm),
            _with_std(point.fz_N, point.fz_std_N),
            wording.number(float(np.hypot(point.fx_N, point.fy_N)), point.fz_std_N),
        )
        for point in points
    ]
    return page.table(PRESS_COLUMNS, rows, numbers=(3, 4, 5, 6))


def _why(point: CertifiedPoint) -> str:
    """Why a press was rejected, in a sentence where one was kept, else in a word."""
    words = point.reason.replace("_", " ")
    said = point.details.findings.partition("; ")[0].removeprefix(f"{point.reason}: ")
    return f"rejected ({words}): {said}" if said else f"rejected: {words}"


def _with_std(value: float, std: float) -> str:
    text = wording.number(value, std)
    return f"{text} ± {wording.number(std, std)}" if np.isfinite(value) and np.isfinite(std) else text
