"""What the figures of a fit show: its points, and its law along depth with the band that the covariance gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.diagnosis import Diagnosis
from calibration.effects import EFFECTS, get_effect
from calibration.fitting import Fit
from calibration.minimise import Box, differentiate
from calibration.refit import refit_with, separation
from calibration.screen import Scored, seen_covariates
from calibration.tolerances import CERTIFICATE, HEIGHTS
from tactilevision.plots.diagnosis import Panel
from tactilevision.plots.indentation import FittedLine, PointCloud
from tactilevision.records import CertifiedPoint, Floats

STEPS = 60


def drawn_points(fitted: Fit, rejected: Sequence[CertifiedPoint] = ()) -> PointCloud:
    """The fitted samples, and the rejected points as far as they have depth and force."""
    data = fitted.data
    extra = [p for p in rejected if not p.accepted and p.depth_mm > 0 and np.isfinite(p.fz_N)]
    depth, force, force_std = (
        np.array([getattr(p, name) for p in extra]) for name in ("depth_mm", "fz_N", "fz_std_N")
    )
    depth_std = np.array([p.depth_std_mm for p in extra])
    return PointCloud(
        depth_mm=np.concatenate([data.depth_mm, depth]),
        depth_std_mm=np.nan_to_num(np.concatenate([data.depth_std_mm, depth_std])),
        force_N=np.concatenate([data.normal_N, force]),
        force_std_N=np.nan_to_num(np.concatenate([data.force_std_N, force_std])),
        fitted_N=np.concatenate([fitted.force_N, np.full(len(extra), np.nan)]),
        thickness_mm=data.gel.thickness_mm,
        used=np.arange(data.size + len(extra)) < data.size,
        bars=not data.is_curves,
    )


def fitted_lines(fitted: Fit) -> list[FittedLine]:
    """The law for each radius of punch, from near 0 to a little beyond the deepest sample of that radius."""
    data = fitted.data
    radii = np.unique(data.presses.radius_mm)
    return [_line(fitted, float(r), f"a = {r:g} mm" if radii.size > 1 else "fitted law") for r in radii]


def _line(fitted: Fit, radius_mm: float, name: str) -> FittedLine:
    data = fitted.data
    rows = np.flatnonzero(data.radius_mm == radius_mm)
    row = int(rows[np.argmax(data.depth_mm[rows])])
    depths = np.linspace(0.05, 1.05, STEPS) * data.depth_mm[row]

    places = fitted.model.slices(data)

    def force(values: Floats) -> Floats:
        values = values.copy()
        for key in (HEIGHTS, CERTIFICATE):  # errors of the points, not of the law
            if key in places:
                values[places[key]] = 0.0
        at_depth = (replace(data, depth_mm=np.full(data.size, depth)) for depth in depths)
        return np.array([fitted.model.predict(values, one)[row] for one in at_depth])

    jacobian = differentiate(force, fitted.values, _box(fitted))
    std = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, fitted.covariance, jacobian))
    return FittedLine(name, depths, force(fitted.values), std, data.gel.thickness_mm)


def _box(fitted: Fit) -> Box:
    low, high = (np.array([p.bounds[side] for p in fitted.parameters]) for side in (0, 1))
    fixed = low == high  # what is held has no spread; a wide box lets the difference quotient pass over it
    return Box(
        np.where(fixed, -np.inf, low),
        np.where(fixed, np.inf, high),
        np.array([p.scale for p in fitted.parameters]),
    )


def residual_panels(fitted: Fit, scored: Sequence[Scored], most: int = 8) -> list[Panel]:
    """The covariates that tell most, with the residual in its own std."""
    seen = {c.name: c for c in seen_covariates(fitted)}
    residual = fitted.residual_N / np.maximum(fitted.about.base_N * fitted.noise.scale, 1e-12)
    return [Panel(s.key, seen[s.key].unit, seen[s.key].values, residual, s.p_adjusted)
            for s in scored[:most] if s.key in seen]  # fmt: skip


def confusability(found: Diagnosis, most: int = 6) -> tuple[list[str], Floats] | None:
    """Separation (k, k) of the added and best-scoring effects; None where there are fewer than two."""
    keys = list(
        dict.fromkeys([*(e.key for e in found.effects), *found.candidates, *(s.key for s in found.screen)])
    )
    keys = [key for key in keys if key in EFFECTS and key not in found.not_testable][:most]
    if len(keys) < 2:
        return None
    fits = [refit_with(found.base, get_effect(key)) for key in keys]
    table = [
        [0.0 if one is other else separation(found.base, one, other.effect) for other in fits] for one in fits
    ]
    return keys, np.array(table)
