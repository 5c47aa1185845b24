"""Compare finite elements with the measurements, and report the differences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import inf, isfinite, isinf
from typing import Any

import numpy as np

from calibration.fit.finite_depth import NODES, USUAL_FRICTION
from calibration.inputs.checks import check, half_width
from calibration.inputs.deadline import SILENT, Progress
from calibration.inputs.depth_path import in_phase
from calibration.inputs.observations import Observations
from calibration.noise.reml import BEYOND_CHANCE
from calibration.result.result import versions
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.mechanics.flat_contact import WIDE, FlatContact
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.punch_curve import PunchCurve, punch_curve, tabulated_curve
from tactilevision.mechanics.tables.punch import EDGE_OVER_H
from tactilevision.records.constants import MICRO, NU_MAX, NU_SILICONE, TAILS95, Z95
from tactilevision.records.measured import Floats, Material, Pair

# Trend of an error with depth: a straight line and Student's test of its slope.


@dataclass(frozen=True, slots=True)
class Trend:
    """`over_range` is the line's rise from the shallowest to the deepest sample, `interval95` its interval;
    `p_value` the chance of such a slope where there is none; all None where `why` says what is missing."""

    over_range: float | None = None
    interval95: Pair | None = None
    p_value: float | None = None
    why: str = ""

    @property
    def found(self) -> bool:
        """Whether the error depends on depth."""
        return self.p_value is not None and self.p_value < BEYOND_CHANCE

    def as_json(self) -> dict[str, Any]:
        """Return its entry in validation.json."""
        content = asdict(self) | {"found": self.found if self.p_value is not None else None}
        return {name: value for name, value in content.items() if name != "why" or value}


def find_trend(depth_mm: Floats, error: Floats) -> Trend:
    """Return the trend of the finite `error` (N,) along `depth_mm` (N,).

    Least squares, t = slope / std with N - 2 degrees of freedom.
    """
    from scipy.stats import linregress, t as student

    use = np.isfinite(error)
    x, y = depth_mm[use], error[use]
    if np.unique(x).size < 3:
        return Trend(why="fewer than three depths: a trend cannot be distinguished from scatter")
    x = (x - x.mean()) / float(np.ptp(x))
    line, dof = linregress(x, y), x.size - 2
    slope, std = float(line.slope), max(float(line.stderr), MICRO / float(np.sqrt(x @ x)))
    reach = float(student.ppf(TAILS95[1], dof)) * std
    return Trend(slope, (slope - reach, slope + reach), float(2 * student.sf(abs(slope) / std, dof)))


# Finite elements against the measurements: at the measured forces, and at the measured depths.
#
#     depth error = w_fem(P) / w - 1,      force error = P_fem(w) / P - 1
#
# for each friction and law, with the calibrated material. Agreement tests the law's form along depth, not
# Poisson's ratio, since E(nu) at the same initial stiffness agrees as well (`rivals`). Assumes first loading of a
# flat punch on a bonded gel. Source: mechanics/punch_curve.py.

LAWS = ("neo-hooke", "hencky")
FRICTIONS = (0.0, 0.15, 0.3, 0.6, inf)  # Coulomb's mu, from sliding freely to sticking
BEYOND = 1.15  # the curve goes this much deeper than the deepest press, for the depth at its force
LEVELS = 10  # a curve of many samples is compared at this many depths
MIN_COUNT = 2  # samples that a rival must reach to be one
RIVALS = tuple(nu for nu in NODES[:-1] if nu >= NU_SILICONE[0])  # values of nu compared at one stiffness


@dataclass(frozen=True, slots=True)
class Samples:
    """What is compared, (N,) each: `press` names it, or says how many samples a level of a curve stands for."""

    press: tuple[str, ...]
    radius_mm: Floats
    depth_mm: Floats
    force_N: Floats


@dataclass(frozen=True, slots=True)
class Comparison:
    """One law and friction: `fem_depth_mm` (N,) at the measured forces, `fem_force_N` (N,) at the measured depths.

    NaN where the elements did not get; `ended` (N,) says why, "" elsewhere. `source`: table or solved.
    """

    law: str
    friction: float
    source: str
    fem_depth_mm: Floats
    fem_force_N: Floats
    ended: tuple[str, ...]
    depth_error: Floats
    force_error: Floats
    depth_trend: Trend
    force_trend: Trend

    @property
    def name(self) -> str:
        """Friction in words, for tables and figures."""
        return friction_name(self.friction)


@dataclass(frozen=True, slots=True)
class Rival:
    """Another Poisson's ratio with E at the same initial stiffness, and the rms depth error that it leaves over
    the `compared` samples that the table reaches."""

    poisson_ratio: float
    youngs_modulus_MPa: float
    rms_depth_error: float
    compared: int


@dataclass(frozen=True, slots=True)
class Validation:
    """All comparisons, and what they rest on."""

    material: Material
    samples: Samples
    comparisons: tuple[Comparison, ...]
    rivals: tuple[Rival, ...]
    assumptions: tuple[str, ...]


def friction_name(friction: float) -> str:
    """Return Coulomb's mu in words."""
    if friction == 0:
        return "frictionless"
    return "no slip" if friction == inf else f"mu = {friction:g}"


def validate(
    data: Observations,
    material: Material,
    *,
    laws: Sequence[str] = LAWS,
    frictions: Sequence[float] = FRICTIONS,
    progress: Progress = SILENT,
) -> Validation:
    """Compare `data` (points, or the loading of curves) with finite elements of `material`.

    Presses with inconsistent clocks are excluded; the first of the assumptions then names them. Raises InputError
    for measurements that no contact explains (see checks).
    """
    check(data)
    data = in_phase(data)
    samples = representative(data)
    jobs = [(law, friction) for law in laws for friction in frictions]
    found = []
    for number, (law, friction) in enumerate(jobs):
        progress(number, len(jobs), f"{law}, {friction_name(friction)}")
        found.append(_compare(data, samples, material, law, friction))
    notes = [*data.warnings, *_assumptions(data, material)]
    return Validation(material, samples, tuple(found), _rivals(data, samples, material), tuple(notes))


def middle_material(interval: Pair | None, modulus_of_nu: Sequence[Pair]) -> Material:
    """Return the middle of nu's `interval` and E there, from pairs (nu, E), where the data leave nu open.

    The two vary together along E(nu), by the interval's width.
    """
    nus, moduli = np.array(modulus_of_nu).T
    low, high = interval or (nus[0], nus[-1])
    nu = (low + high) / 2
    ends = np.array([np.interp((low, high), nus, moduli), (low, high)])
    std = np.diff(ends)[:, 0] / (2 * Z95)
    return Material(float(np.interp(nu, nus, moduli)), min(nu, NU_MAX), np.outer(std, std))


def representative(data: Observations) -> Samples:
    """Return the points; of curves, means over ranges of depth during loading."""
    if not data.is_curves:
        labels = tuple(data.presses.label[k] for k in data.press)
        return Samples(labels, data.radius_mm, data.depth_mm, data.normal_N)
    rows = []
    for radius in np.unique(data.presses.radius_mm):
        loads = data.phase == "load" if (data.phase == "load").any() else ~np.isin(data.phase, ("free", "unload"))
        mine = loads & (data.radius_mm == radius) & (data.depth_mm > 0)
        edges = np.linspace(0.1, 1, LEVELS) * float(np.max(data.depth_mm[mine], initial=0.0))
        for low, high in pairwise(edges):
            level = mine & (data.depth_mm > low) & (data.depth_mm <= high)
            if level.any():
                size = f"{int(level.sum())} samples"
                rows.append((size, radius, data.depth_mm[level].mean(), data.normal_N[level].mean()))
    if not rows:
        raise InputError(
            "no sample of the curves belongs to loading",
            where="curves.csv",
            remedy="Name the phases free, load, hold, unload.",
        )
    names, *columns = zip(*rows, strict=True)
    return Samples(tuple(names), *(np.array(column) for column in columns))


def contact_of(data: Observations, radius_mm: float, *, law: str, friction: float) -> FlatContact:
    """Return the contact of the punch of this radius; a pad of unstated size counts as wide."""
    h, pad = data.gel.thickness_mm, half_width(data)
    used = (data.indenters[k] for k in np.unique(data.presses.indenter))
    edge = next(one for one in used if one.radius_mm == radius_mm).edge_radius_mm or h * EDGE_OVER_H
    return FlatContact(radius_mm, edge, h, friction, law, inf if pad is None else pad)


def _compare(data: Observations, samples: Samples, material: Material, law: str, friction: float) -> Comparison:
    fem_depth, fem_force = (np.full(samples.depth_mm.size, np.nan) for _ in range(2))
    ended, sources = [""] * samples.depth_mm.size, set()
    for radius in np.unique(samples.radius_mm):
        mine = np.flatnonzero(samples.radius_mm == radius)
        contact = contact_of(data, float(radius), law=law, friction=friction)
        curve, why = _curve(contact, material, samples.depth_mm[mine], samples.force_N[mine])
        if curve is not None:
            sources.add(curve.source)
            fem_depth[mine] = curve.depth_at(samples.force_N[mine])
            fem_force[mine] = curve.force_at(samples.depth_mm[mine])
        for k in mine:
            ended[k] = "" if np.isfinite([fem_depth[k], fem_force[k]]).all() else why
    errors = fem_depth / samples.depth_mm - 1, fem_force / samples.force_N - 1
    trends = [find_trend(samples.depth_mm, error) for error in errors]
    return Comparison(law, friction, " and ".join(sorted(sources)) or "none", fem_depth, fem_force, tuple(ended),
                      *errors, *trends)  # fmt: skip


def _curve(
    contact: FlatContact, material: Material, depth_mm: Floats, force_N: Floats
) -> tuple[PunchCurve | None, str]:
    """Return a curve deep enough for every depth and the largest force, and why it ends where it is not."""
    limit, wanted = 0.98 * contact.thickness_mm, float(force_N.max())
    deepest, curve = min(BEYOND * float(np.max(depth_mm)), limit), None
    while True:
        try:
            curve = punch_curve(contact, material, deepest)
        except ConvergenceError as fault:
            return curve, str(fault)
        reached, top = float(curve.depth_mm[-1]), float(curve.force_N[-1])
        if curve.ended:
            return curve, f"the elements end at {reached:.3f} mm and {top:.3f} N: {curve.ended}"
        if top >= wanted:
            return curve, ""
        if deepest >= limit:
            return curve, "so large a force would need more than the gel's thickness"
        deepest = min(deepest * max(BEYOND, min(wanted / top, 1.5)), limit)


def _rivals(data: Observations, samples: Samples, material: Material) -> tuple[Rival, ...]:
    """Return other nu at the same initial stiffness within the table; neo-Hooke, mu = .3, the deepest radius."""
    radius = float(samples.radius_mm[np.argmax(samples.depth_mm)])
    mine = samples.radius_mm == radius
    contact = contact_of(data, radius, law="neo-hooke", friction=USUAL_FRICTION)
    alpha, kept = radius / data.gel.thickness_mm, []
    for nu in RIVALS:
        modulus = material.youngs_modulus_MPa * _stiffness(material.poisson_ratio, alpha) / _stiffness(nu, alpha)
        curve = tabulated_curve(contact, Material(modulus, nu), BEYOND * float(samples.depth_mm[mine].max()))
        if curve is not None:
            error = curve.depth_at(samples.force_N[mine]) / samples.depth_mm[mine] - 1
            if np.isfinite(error).sum() >= MIN_COUNT:
                kept.append((nu, modulus, error))
    common = np.isfinite([error for _, _, error in kept]).all(axis=0) if kept else np.zeros(0, dtype=bool)
    return tuple(
        Rival(nu, modulus, float(np.sqrt(np.mean(error[common] ** 2))), int(common.sum()))
        for nu, modulus, error in kept
        if common.any()
    )


def _stiffness(poisson_ratio: float, a_over_h: float) -> float:
    return float(fast_kappa(poisson_ratio, a_over_h)) / (1 - poisson_ratio**2)


def _assumptions(data: Observations, material: Material) -> Iterator[str]:
    E, nu = material.youngs_modulus_MPa, material.poisson_ratio
    yield f"E = {E:.4g} MPa, nu = {nu:.4g}, without their uncertainty"
    used = [data.indenters[k] for k in np.unique(data.presses.indenter)]
    if any(not indenter.edge_radius_mm for indenter in used):
        edge = data.gel.thickness_mm * EDGE_OVER_H
        yield f"no edge radius is stated: {edge:.3g} mm is taken; a sharper edge is stiffer, by about 4 %"
    if data.gel.shape == "unbounded":
        yield f"the pad's outline is not stated: it counts as {WIDE:g} thicknesses wide at least"
    if data.is_curves:
        yield f"of the curves the loading is compared, as means over {LEVELS - 1} ranges of depth"


# What a validation says: in sentences, as a table for the terminal, and as validation.json.

NOT_PROVEN = "Agreement at equal force, or at equal depth, does not prove Poisson's ratio"


def as_json(found: Validation) -> dict[str, Any]:
    """Return the content of validation.json; a value that the elements did not reach is null, with its `why`."""
    return {
        **found.material.as_json(),
        "models": [_model(found, one) for one in found.comparisons],
        "rivals": [asdict(rival) for rival in found.rivals],
        "statements": list(statements(found)),
        "assumptions": list(found.assumptions),
        "versions": versions(),
    }


def statements(found: Validation) -> Iterator[str]:
    """Yield a sentence for each comparison, and one on what agreement does not prove."""
    for one in found.comparisons:
        yield f"{one.law}, {one.name}: {_errors(one.depth_error)} in depth at equal force; {_trend(one)}"
    lost = {
        law: sum(bool(why) for one in found.comparisons if one.law == law for why in one.ended)
        for law in dict.fromkeys(one.law for one in found.comparisons)
    }
    if any(lost.values()):
        where = ", ".join(f"{count} of {law}" for law, count in lost.items() if count)
        yield f"beyond what the elements reach, and left empty: {where}; validation.json says why of each"
    yield _not_proven(found)


def table(found: Validation, law: str) -> list[str]:
    """Return depth errors in per cent, one line a sample, one column a friction; '-' where the elements ended."""
    mine = [one for one in found.comparisons if one.law == law]
    lines = [f"{law}: FE depth at the measured force, error in % of the measured depth"]
    lines.append(f"{'press':>12s} {'w (mm)':>8s} {'P (N)':>8s} " + " ".join(f"{one.name:>12s}" for one in mine))
    samples = found.samples
    for k, press in enumerate(samples.press):
        values = (
            f"{round(100 * one.depth_error[k], 1) + 0.0:+12.1f}" if isfinite(one.depth_error[k]) else f"{'-':>12s}"
            for one in mine
        )
        lines.append(f"{press:>12s} {samples.depth_mm[k]:8.3f} {samples.force_N[k]:8.4f} " + " ".join(values))
    return lines


def _errors(error: Floats) -> str:
    kept = error[np.isfinite(error)]
    if not kept.size:
        return "nothing that can be compared"
    low, high = (f"{100 * end:+.1f}".replace("-0.0", "+0.0") for end in (kept.min(), kept.max()))
    return f"{low} %" if low == high else f"{low} to {high} %"


def _trend(one: Comparison) -> str:
    trend = one.depth_trend
    if trend.p_value is None or trend.over_range is None:
        return f"whether it trends with depth cannot be told ({trend.why})"
    chance = f"p = {trend.p_value:.2g}"
    if not trend.found:
        return f"no trend with depth that shows at {100 * BEYOND_CHANCE:.0f} % ({chance})"
    way = "grows" if trend.over_range > 0 else "falls"
    return (
        f"it {way} with depth, by {100 * abs(trend.over_range):.1f} points over the range ({chance}): "
        "the form of the model is at fault, not scatter"
    )


def _not_proven(found: Validation) -> str:
    if len(found.rivals) < 2:
        return NOT_PROVEN + "."
    low, high = found.rivals[0], found.rivals[-1]
    errors = [rival.rms_depth_error for rival in found.rivals]
    return (
        f"{NOT_PROVEN}: with E at the same initial stiffness every nu from {low.poisson_ratio:g} to "
        f"{high.poisson_ratio:g} comes within {100 * min(errors):.1f} to {100 * max(errors):.1f} % rms of the "
        f"{low.compared} depths that the table reaches (neo-Hooke, mu = 0.3)."
    )


def _model(found: Validation, one: Comparison) -> dict[str, Any]:
    samples = found.samples
    measured = {name: getattr(samples, name) for name in ("radius_mm", "depth_mm", "force_N")}
    errors = ("fem_depth_mm", "depth_error", "fem_force_N", "force_error")
    columns = measured | {name: getattr(one, name) for name in errors}
    rows = []
    for k, press in enumerate(samples.press):
        row = {"press": press} | {name: _number(column[k]) for name, column in columns.items()}
        rows.append(row | ({"why": one.ended[k]} if one.ended[k] else {}))
    return {
        "law": one.law,
        "friction": "no slip" if isinf(one.friction) else one.friction,
        "source": one.source,
        "points": rows,
        "rms_depth_error": _rms(one.depth_error),
        "rms_force_error": _rms(one.force_error),
        "depth_trend": one.depth_trend.as_json(),
        "force_trend": one.force_trend.as_json(),
    }


def _rms(error: Floats) -> float | None:
    kept = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(kept**2))) if kept.size else None


def _number(value: float) -> float | None:
    return float(value) if isfinite(value) else None
