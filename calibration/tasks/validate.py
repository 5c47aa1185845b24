"""Finite elements against the measurements: at the measured forces, and at the measured depths.

    depth error = w_fem(P) / w - 1,      force error = P_fem(w) / P - 1

for each friction and law, with the material that a calibration gave. Such agreement is a test of the law's form
along depth; it does not prove Poisson's ratio, since E(nu) at the same initial stiffness agrees as well: `rivals`
shows by how much. Assumes first loading of a flat punch on a bonded gel. Source: mechanics/punch_curve.py.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Protocol

import numpy as np

from calibration.fit.depth_trend import Trend, find_trend
from calibration.inputs.checks import check
from calibration.inputs.observations import Observations
from calibration.inputs.phase import in_phase
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.mechanics.flat_contact import WIDE, FlatContact
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.punch_curve import PunchCurve, punch_curve, tabulated_curve
from tactilevision.mechanics.tables.profile import EDGE_OVER_H
from tactilevision.records import Floats, Indenter, Material

LAWS = ("neo-hooke", "hencky")
FRICTIONS = (0.0, 0.15, 0.3, 0.6, inf)  # Coulomb's mu, from sliding freely to sticking
BEYOND = 1.15  # the curve goes this much deeper than the deepest press, for the depth at its force
LEVELS = 10  # a curve of many samples is compared at this many depths
MIN_COUNT = 2  # samples that a rival must reach to be one
RIVALS = (0.45, 0.46, 0.47, 0.48, 0.49, 0.495)  # values of nu that are compared at one stiffness


class Told(Protocol):
    """Told how far the comparison is."""

    def __call__(self, done: int, total: int, what: str = "") -> None: ...


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
    """Coulomb's mu in words."""
    if friction == 0:
        return "frictionless"
    return "no slip" if friction == inf else f"mu = {friction:g}"


def validate(
    data: Observations,
    material: Material,
    *,
    laws: Sequence[str] = LAWS,
    frictions: Sequence[float] = FRICTIONS,
    progress: Told | None = None,
) -> Validation:
    """Compare `data` (points, or the loading of curves) with finite elements of `material`.

    Presses that clocks far apart put out of phase are left out; the first of the assumptions then says so.
    Raises InputError for measurements that no contact explains (see checks) and for a modulus or Poisson's ratio
    that cannot be.
    """
    check(data)
    given, data = data, in_phase(data)
    _check_material(material)
    samples = representative(data)
    jobs = [(law, friction) for law in laws for friction in frictions]
    found = []
    for number, (law, friction) in enumerate(jobs):
        if progress is not None:
            progress(number, len(jobs), f"{law}, {friction_name(friction)}")
        found.append(_compare(data, samples, material, law, friction))
    notes = [*data.warnings[len(given.warnings) :], *_assumptions(data, material)]
    return Validation(material, samples, tuple(found), _rivals(data, samples, material), tuple(notes))


def representative(data: Observations) -> Samples:
    """The points as they are; of curves, means over ranges of depth while the punch moves in."""
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
    names, radii, depths, forces = zip(*rows, strict=True)
    return Samples(tuple(names), np.array(radii), np.array(depths), np.array(forces))


def contact_of(data: Observations, radius_mm: float, *, law: str, friction: float) -> FlatContact:
    """The contact of the punch of this radius; where the pad has no stated side it counts as wide."""
    h, gel = data.gel.thickness_mm, data.gel
    pad = gel.radius_mm if gel.shape == "disc" else min(gel.size_mm) / 2 if gel.size_mm else None
    edge = next(_edges(data, radius_mm)).edge_radius_mm or h * EDGE_OVER_H
    return FlatContact(radius_mm, edge, h, friction, law, inf if pad is None else pad)


def _edges(data: Observations, radius_mm: float) -> Iterator[Indenter]:
    used = np.unique(data.presses.indenter)
    return (data.indenters[k] for k in used if data.indenters[k].radius_mm == radius_mm)


def _compare(data: Observations, samples: Samples, material: Material, law: str, friction: float) -> Comparison:
    fem_depth, fem_force = (np.full(samples.depth_mm.size, np.nan) for _ in range(2))
    ended, sources = [""] * samples.depth_mm.size, set()
    for radius in np.unique(samples.radius_mm):
        mine = np.flatnonzero(samples.radius_mm == radius)
        contact = contact_of(data, float(radius), law=law, friction=friction)
        curve, why = _curve(contact, material, samples.depth_mm[mine], samples.force_N[mine])
        if curve is not None:
            sources.add(curve.source)
            fem_depth[mine], fem_force[mine] = (
                curve.depth_at(samples.force_N[mine]),
                curve.force_at(samples.depth_mm[mine]),
            )
        for k in mine:
            ended[k] = "" if np.isfinite([fem_depth[k], fem_force[k]]).all() else why
    errors = fem_depth / samples.depth_mm - 1, fem_force / samples.force_N - 1
    trends = [find_trend(samples.depth_mm, error) for error in errors]
    return Comparison(law, friction, " and ".join(sorted(sources)) or "none", fem_depth, fem_force, tuple(ended),
                      *errors, *trends)  # fmt: skip


def _curve(
    contact: FlatContact, material: Material, depth_mm: Floats, force_N: Floats
) -> tuple[PunchCurve | None, str]:
    """Deep enough for every depth and for the largest force; and why it is not, where it is not."""
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
    """Other nu at the same initial stiffness, as far as the table goes; neo-Hooke, mu = .3, the deepest radius."""
    radius = float(samples.radius_mm[np.argmax(samples.depth_mm)])
    mine = samples.radius_mm == radius
    contact = contact_of(data, radius, law="neo-hooke", friction=0.3)
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


def _check_material(material: Material) -> None:
    if not (np.isfinite(material.youngs_modulus_MPa) and material.youngs_modulus_MPa > 0):
        raise InputError("Young's modulus lies above 0 MPa", where="validate", value=material.youngs_modulus_MPa)
    if not 0 <= material.poisson_ratio < 0.5:
        raise InputError(
            "Poisson's ratio lies in [0, 0.5)",
            where="validate",
            value=material.poisson_ratio,
            remedy="For an incompressible gel take 0.4999.",
        )


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
