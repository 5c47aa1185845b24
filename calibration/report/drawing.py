"""Data of the figures of a fit and of a diagnosis: points, bands, residuals, candidates, maps."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from calibration.diagnosis.covariates import seen_covariates
from calibration.diagnosis.diagnosis import Diagnosis
from calibration.diagnosis.refit import CANNOT_FIT, TOLD_APART, Candidate, apart, refit_with
from calibration.diagnosis.score_test import Scored
from calibration.diagnosis.vision_depth_check import depth_ratio, read_alone, recorded_of_depth
from calibration.effects import EFFECTS, get_effect
from calibration.fit.depth_noise import at_denoised_depth
from calibration.fit.least_squares import Fit, box_of, differentiate, unexplained
from calibration.fit.outlying_presses import own_zero_mm
from calibration.fit.tolerances import CERTIFICATE, HEIGHTS
from calibration.inputs.conditions import Covariate, bins
from calibration.laws.theory import nominal_nu
from calibration.model.stages import Effect
from calibration.report.misfit import BINS, strip_of
from tactilevision.mechanics.profile import exact_profile
from tactilevision.plots.calibration import FittedLine, PointCloud
from tactilevision.plots.diagnosis import Offsets, Sighting
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import KILO, TINY
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Floats, Pair
from tactilevision.records.misfit import Strip
from tactilevision.records.rig import Gel

MOST = 5  # effects whose separation is shown
STEPS = 60  # depths of a plotted curve
HALF = 3  # half the width of the grid of a residual map, in radii of the punch
MAP_STEPS = 61  # places across the grid: a tenth of a radius apart
NEAR = (1.15, 1.7)  # ring outside the wall of the punch, in radii
FAR = (2, 2.8)  # ring to compare with, in radii
MIN_COUNT = 4  # presses: Hotelling's test of two components needs three and one more
TOWARDS = {"right": 0.0, "bottom": np.pi / 2, "left": np.pi, "top": -np.pi / 2}
BEVEL_HALF_ANGLE = np.pi / 3  # rad, half the sector of the bevel, which is not compared


def drawn_points(fitted: Fit, rejected: Sequence[CertifiedPoint]) -> PointCloud:
    """Return the fitted samples, and the rejected points that have depth and force."""
    data = fitted.data
    extra = [p for p in rejected if not p.accepted and p.depth_mm > 0 and np.isfinite(p.fz_N)]
    names = ("depth_mm", "fz_N", "fz_std_N", "depth_std_mm")
    depth, force, force_std, depth_std = (np.array([getattr(p, name) for p in extra]) for name in names)
    return PointCloud(
        depth_mm=np.concatenate([data.depth_mm, depth]),
        depth_std_mm=np.nan_to_num(np.concatenate([data.depth_std_mm, depth_std])),
        force_N=np.concatenate([data.normal_N, force]),
        force_std_N=np.nan_to_num(np.concatenate([data.force_std_N, force_std])),
        fitted_N=np.concatenate([fitted.force_N, np.full(len(extra), np.nan)]),
        thickness_mm=data.gel.thickness_mm,
        used=np.arange(data.size + len(extra)) < data.size,
        bars=not data.is_curves,
        radius_mm=np.concatenate([data.radius_mm, np.full(len(extra), np.nan)]),
    )


def fitted_lines(fitted: Fit) -> list[FittedLine]:
    """Return the law for each radius, from near 0 to a little beyond its deepest sample, with its std."""
    data = fitted.data
    radii = np.unique(data.presses.radius_mm)
    return [_line(fitted, float(r), f"a = {r:g} mm" if radii.size > 1 else "fitted law") for r in radii]


def _line(fitted: Fit, radius_mm: float, name: str) -> FittedLine:
    data = fitted.data
    rows = np.flatnonzero(data.radius_mm == radius_mm)
    row = int(rows[np.argmax(data.depth_mm[rows])])
    depths = np.linspace(0.05, 1.05, STEPS) * data.depth_mm[row]

    places, free = fitted.model.slices(data), fitted.free
    at_depth = [replace(data, depth_mm=np.full(data.size, depth)) for depth in depths]

    def force(free_values: Floats) -> Floats:
        values = fitted.values.copy()
        values[free] = free_values
        for key in (HEIGHTS, CERTIFICATE):  # errors of the points, not of the law
            if key in places:
                values[places[key]] = 0.0
        return np.array([fitted.model.predict(values, one)[row] for one in at_depth])

    jacobian = differentiate(force, fitted.values[free], box=box_of(fitted.parameters))
    std = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, fitted.covariance[np.ix_(free, free)], jacobian))
    return FittedLine(name, depths, force(fitted.values[free]), std, data.gel.thickness_mm)


def own_offsets(found: Diagnosis) -> Offsets | None:
    """Return each press's offset where presses are outlying or drift; None otherwise."""
    fitted = found.fits.whole or found.fits.fitted
    if not (found.presses.odd or found.presses.odd.scattered or found.remainder.change_point):
        return None
    order = np.argsort(fitted.data.presses.order, kind="stable")
    own, labels = own_zero_mm(fitted), fitted.data.presses.label
    named = tuple(labels[k] for k in order)
    since = named.index(found.remainder.change_point) if found.remainder.change_point in named else None
    return Offsets(
        named, KILO * (own - np.median(own))[order], tuple(n in found.presses.odd.presses for n in named), since
    )


def confusability(found: Diagnosis) -> tuple[list[str], Floats] | None:
    """Return the separation (k, k), in std, of added and best-scoring effects; None for fewer than two."""
    base, limits = found.fits.base, found.limits
    keys = [*(e.key for e in found.effects), *found.candidates, *(s.key for s in found.search.score_test)]
    testable = EFFECTS.keys() & limits.visible.keys() - limits.not_testable.keys()
    fits = list[Candidate]()
    for key in dict.fromkeys(keys):
        if key in testable and len(fits) < MOST:
            with suppress(*CANNOT_FIT):
                fits.append(refit_with(base, get_effect(key)))
    fits = [one for one in fits if _shows(base, one)]
    if len(fits) < 2:
        return None
    table = [[0.0 if one is other else apart(base, one, other.effect) for other in fits] for one in fits]
    return [one.effect.key for one in fits], np.array(table)


def _shows(base: Fit, candidate: Candidate) -> bool:
    """Return whether the candidate's change of the force lies outside the base model's own directions."""
    change = base.whitener.apply(np.column_stack([base.jacobian[:, base.free], candidate.force_N - base.force_N]))
    return bool(np.linalg.norm(unexplained(change[:, :-1], change[:, -1])) > TOLD_APART)


def sighting(found: Diagnosis) -> Sighting | None:
    """Return the reconstructed over the certified depth of samples, as read and corrected; None without both."""
    if (sight := found.search.sight) is None:
        return None
    base, data = sight.base, sight.base.data
    face = np.ones(data.size, dtype=bool) if data.slopes is None else np.isnan(data.slopes.slope)
    corrected = data.normal_N / read_alone(sight.current) if sight.steps else None
    return Sighting(depth_ratio(base), corrected, face, tuple(recorded_of_depth(data)))


def candidates(found: Diagnosis, private: Sequence[Effect]) -> dict[str, Candidate | None]:
    """Return the candidates by key, each fitted alone on top of the base model.

    Candidates are the effects added, those not distinguishable from them, and those tried. None for one on the
    reconstructed depth, which is shown there, and for one that cannot be fitted; one whose needed size is in a
    table is excluded.
    """
    known, base = {**EFFECTS, **{effect.key: effect for effect in private}}, found.fits.base
    by_sight = set() if found.search.sight is None else {s.key for s in found.search.sight.first.effects}
    added = [e.key for e in found.effects]
    elsewhere = {w.key for w in found.remainder.would_have_to_be} - set(added)
    made: dict[str, Candidate | None] = {}
    for key in dict.fromkeys((*added, *found.candidates, *found.search.tried)):
        if key not in elsewhere and (key in by_sight or key in known):
            made[key] = None
            with suppress(*CANNOT_FIT):
                made[key] = None if key in by_sight else refit_with(base, known[key])
    return made


def overlay(base: Fit, candidate: Candidate | Fit) -> Strip:
    """Return the residual without and with the candidate and the candidate's own change.

    They are binned over the covariate along which it changes most.
    """
    change = candidate.force_N - base.force_N
    std = np.maximum(base.about.base_N * base.noise.scale, TINY)
    best = max(seen_covariates(at_denoised_depth(base)), key=lambda one: _spread(one, change / std))
    return strip_of(best, base.data, np.array([base.residual_N, base.residual_N - change, change]))


def _spread(covariate: Covariate, change: Floats) -> float:
    """Return the sum of squares of a change between bins."""
    number = bins(covariate, BINS)
    count = np.bincount(number)
    mean = np.bincount(number, change) / np.maximum(count, 1)
    return float(count @ (mean - np.average(mean, weights=count)) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Height map of one press with the place, radius, certified depth and bevel of its punch."""

    height_map: HeightMap
    centre_mm: Pair
    radius_mm: float
    depth_mm: float
    bevel: str | None


@dataclass(frozen=True, slots=True, eq=False)
class ResidualMap:
    """Mean residual (STEPS, STEPS) in mm over `count` presses, x and y at `axis` (STEPS,) in radii; the tests."""

    residual_mm: Floats
    axis: Floats
    count: int
    covariates: tuple[Scored, ...]


def residual_map(surfaces: Sequence[Surface], gel: Gel) -> ResidualMap | None:
    """Return the mean residual of height maps about theory, with two tests; None for fewer than four presses.

        residual(x, y) = measured depth - [w under the face, -w rise(r) outside it]

    averaged over presses on a grid about the punch's axis. The rise is linear layer theory's at the gel's stated
    nu (.48 where none is stated). Towards the bevel nothing is compared: its edge touches there. The tests, with
    one number a press: does the residual outside the punch depend on the azimuth (Hotelling's T^2 of its first
    harmonic: a tilt, an error of the light), and does it grow towards the punch (Student's t, with the height
    map's std as shared by all presses: a gain, another nu)?
    """
    if len(surfaces) < MIN_COUNT:
        return None
    axis = np.linspace(-HALF, HALF, MAP_STEPS)
    x, y = np.meshgrid(axis, axis)
    maps = np.array([_residual(one, gel, x, y) for one in surfaces])
    known = np.isfinite(maps)
    mean = np.where(known.any(axis=0), np.nansum(maps, axis=0) / np.maximum(known.sum(axis=0), 1), np.nan)
    tests = (_azimuth(maps, x, y), _radius(maps, surfaces, x, y))
    found = [test for test in tests if test is not None]
    both = tuple(replace(test, p_adjusted=min(1.0, len(found) * test.p)) for test in found)
    return ResidualMap(mean, axis, len(surfaces), both)


def _residual(one: Surface, gel: Gel, x: Floats, y: Floats) -> Floats:
    r = np.hypot(x, y)
    table = np.linspace(1.02, HALF * 1.5, 80)
    rise, _ = exact_profile(table, nominal_nu(gel), a_over_h=one.radius_mm / gel.thickness_mm)
    expected = one.depth_mm * np.where(r < 1, 1.0, -np.interp(r, table, rise))
    hidden = (r > 0.9) & (r < 1.1)  # a step has no depth
    if one.bevel is not None:
        turn = np.angle(np.exp(1j * (np.arctan2(y, x) - TOWARDS[one.bevel])))
        hidden |= (np.abs(turn) < BEVEL_HALF_ANGLE) & (r > 1)
    return np.where(hidden, np.nan, _sample(one, x, y) - expected)


def _sample(one: Surface, x: Floats, y: Floats) -> Floats:
    """Return the depth at places about the centre, in radii, at the nearest pixel; NaN where there is none."""
    from scipy.ndimage import map_coordinates

    seen, (rows, columns) = one.height_map, one.height_map.depth_mm.shape
    column = (one.centre_mm[0] + one.radius_mm * x) / seen.mm_per_px[0] + (columns - 1) / 2
    row = (one.centre_mm[1] + one.radius_mm * y) / seen.mm_per_px[1] + (rows - 1) / 2
    depth = np.where(seen.valid, seen.depth_mm, np.nan).astype(float)
    return np.asarray(map_coordinates(depth, np.rint([row, column]), order=0, cval=np.nan))


def _azimuth(maps: Floats, x: Floats, y: Floats) -> Scored | None:
    """Return Hotelling's T^2 over presses of the first harmonic outside the punch."""
    from scipy.stats import f

    r, angle = np.hypot(x, y), np.arctan2(y, x)
    ring = (r > NEAR[0]) & (r < FAR[1])
    rows = []
    for one in maps:
        use = ring & np.isfinite(one)
        if np.count_nonzero(use) > 50:
            table = np.column_stack([np.ones(use.sum()), np.cos(angle[use]), np.sin(angle[use])])
            rows.append(np.linalg.lstsq(table, one[use], rcond=None)[0][1:])
    count = len(rows)
    if count < MIN_COUNT:
        return None
    mean, spread = np.mean(rows, axis=0), np.cov(np.array(rows).T)
    squared = float(count * mean @ np.linalg.solve(spread, mean)) * (count - 2) / (2 * (count - 1))
    p = float(f.sf(squared, 2, count - 2))
    return Scored("height map: azimuth", squared, p, p)


def _radius(maps: Floats, surfaces: Sequence[Surface], x: Floats, y: Floats) -> Scored | None:
    """Return Student's t over presses of the near ring less the far one, with the height map's std."""
    from scipy.stats import t

    r = np.hypot(x, y)
    rings = [(r > low) & (r < high) for low, high in (NEAR, FAR)]
    steps = [_mean(one[rings[0]]) - _mean(one[rings[1]]) for one in maps]
    known = np.array([step for step in steps if np.isfinite(step)])
    if known.size < MIN_COUNT:
        return None
    own = [_mean(s.height_map.std_mm[s.height_map.valid]) for s in surfaces if s.height_map.std_mm is not None]
    shared = float(np.median(own)) if own else 0.0
    error = np.sqrt(known.var(ddof=1) / known.size + shared**2)
    statistic = float(known.mean() / error)
    p = float(2 * t.sf(abs(statistic), known.size - 1))
    return Scored("height map: radius", statistic**2, p, p)


def _mean(values: npt.NDArray[np.floating[Any]]) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
