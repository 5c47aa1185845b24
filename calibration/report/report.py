"""Report of a calibration: the material, its assumptions, excluded presses, and their pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from calibration.fit.identifiability import main_radius
from calibration.report import page, wording
from calibration.report.page import Picture
from calibration.result.result import CalibrationResult
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import KILO

DEPTHS = (
    "As machined: distance of the bevel from the punch's face. Certified: that, less the rise of the gel at the "
    "bevel."
)
SOURCES = {
    "bulge": "the rise of the gel next to the punch",
    "beta": "beta by the published log law",
    "radii": "punches of several radii",
    "prior": "prior knowledge, not these data",
}
PRESS_COLUMNS = (
    "press",
    "indenter",
    "verdict",
    "certified depth (mm)",
    "as machined (mm)",
    "force (N)",
    "tangential (N)",
)


def summary(result: CalibrationResult) -> list[str]:
    """Return the lines for the terminal."""
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
    """Return the source of nu in words."""
    return SOURCES.get(result.poisson_ratio_source, result.poisson_ratio_source)


def calibration_page(
    title: str,
    result: CalibrationResult | None,
    *,
    points: Sequence[CertifiedPoint],
    figures: Sequence[Picture] = (),
    presses: Sequence[Picture] = (),
    notes: Sequence[str] = (),
    why: str = "all of them were rejected",
) -> str:
    """Return the page of one recording; `result` is None where its presses determine no material, with `why`.

    `notes`: warnings without a result.
    """
    if result is None:
        head = page.paragraph("The presses of this recording determine no material: " + why, kind="lead bad")
        details = page.section("Notes", page.listing(notes))
    else:
        head, details = _lead(result) + _head(result), _details(result)
    return page.page(
        title,
        head,
        page.section("Force against depth", *page.figures(figures)),
        details,
        page.section("Presses", _press_table(points), page.paragraph(DEPTHS, kind="soft")) if points else "",
        page.folded(
            f"Pictures of each press ({len(presses)}): frame, height map, signal of the bevel, force",
            *page.figures(presses),
        ),
    )


def _lead(result: CalibrationResult) -> str:
    """Return the result in one sentence."""
    E, nu = wording.estimate(result.youngs_modulus), wording.estimate(result.poisson_ratio)
    kept = len(result.presses_accepted)
    presses = f"{kept} of {kept + len(result.presses_rejected)} presses"
    return page.paragraph(f"Young's modulus E is {E}, Poisson's ratio ν {nu}, from {presses}.", kind="lead")


def _head(result: CalibrationResult) -> str:
    rows = [
        (wording.MATERIAL["youngs_modulus"], wording.estimate(result.youngs_modulus), ""),
        (
            wording.MATERIAL["poisson_ratio"],
            wording.estimate(result.poisson_ratio),
            f"from {source_in_words(result)}",
        ),
        (wording.MATERIAL["c"], wording.estimate(result.c), "force over depth P/w at first touch"),
        (wording.MATERIAL["beta"], wording.estimate(result.beta), "growth of P/w with w/h: c (1 + β w/h)"),
        ("reduced modulus", wording.estimate(result.reduced_modulus), "E/(1 − ν²)"),
        ("clock of the force sensor", wording.estimate(result.clock_offset), "less that of the camera"),
        *_error_rows(result),
    ]
    return page.table(("", "value and 95 % interval", ""), rows)


def _error_rows(result: CalibrationResult) -> list[tuple[str, str, str]]:
    """Return the error on held-out presses, and the repeatability to compare it with."""
    name, error = "error on held-out presses (rms)", result.held_out_N
    if not math.isfinite(error):
        name, error = "error on fitted presses (rms)", result.rms_error_N
    line = f"R² of the line {result.r_squared:.4f}" if math.isfinite(result.r_squared) else ""
    rows = [(name, f"{KILO * error:.1f} mN", line)]
    if math.isfinite(result.noise_floor_N):
        scatter = f"{KILO * result.noise_floor_N:.1f} mN"
        rows.append(("repeatability (std)", scatter, "scatter of repeated presses' forces"))
    return rows


def _routes(result: CalibrationResult) -> str:
    """Return a table of nu by each route."""
    rows = [
        (SOURCES.get(r.name, r.name), wording.estimate(r.poisson_ratio), "used" if r.used else "not used")
        for r in result.routes
    ]
    return page.table(("route to ν", "value and 95 % interval", ""), rows)


def _details(result: CalibrationResult) -> str:
    return (
        page.section("Poisson's ratio by route", _routes(result))
        + page.section("Warnings", page.listing(result.warnings))
        + page.section("Assumptions", page.listing(result.assumptions))
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
    """Return why a press was rejected: a sentence where there is one, else its code."""
    words = point.reason.replace("_", " ")
    said = point.details.findings.partition("; ")[0].removeprefix(f"{point.reason}: ")
    return f"rejected ({words}): {said}" if said else f"rejected: {words}"


def _with_std(value: float, std: float) -> str:
    text = wording.number(value, std)
    return f"{text} ± {wording.number(std, std)}" if np.isfinite(value) and np.isfinite(std) else text
