"""Estimate Poisson's ratio from the rise of the gel around each accepted punch."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.contact.bevel import SIDES
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.heightmap.lamps import find_lamps
from tactilevision.heightmap.lit_slopes import LitSlopes, lit_slopes
from tactilevision.heightmap.poisson import integrate_half_squares
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.poisson_from_surface import SurfaceFit, SurfaceFitSettings, fit_poisson_ratio
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.photometric.illumination.cast_shadow import LightField
from tactilevision.photometric.illumination.lamps import Lamps
from tactilevision.press.certificate import Certificate
from tactilevision.press.certified_faces import certified_of, doubt_beside_shadows
from tactilevision.press.pile_up import blur_place, combine, computed_ratio, depth_std, ring_gain_std
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.maps import MEANING, UNKNOWN_LAMPS, Footprint, SlopeMap
from tactilevision.records.measured import Curve, Estimate, Floats, Pair
from tactilevision.records.rig import Indenter

# The gel beside a punch as a surface of its own, from slopes alone.
#
# Slopes of several frames are averaged over half squares (SQUARE_MM/2) and integrated to squares, with the face
# and its walls left out, so that the gel beside stands on its own slopes. Its level and tilt are then open. What
# lies under the bevel, and beyond it, is left out.

SQUARE_MM = 0.25  # mm, side of the squares that slopes are averaged over; benchmarks.nu_from_frames
WALL_MM = 0.5  # mm beyond the edge: steep profile, ink and blur; benchmarks.nu_from_frames
BEFORE_BEVEL_MM = 0.5  # mm before the bevel's edge that are left out, lest the bevel's dent be read
SOUND = 0.9  # share of a square's pixels that must be readable; benchmarks.nu_from_frames
CENTRE_STD_MM = 0.05  # mm, one sigma of the face's centre; benchmarks.nu_from_frames


@dataclass(frozen=True, slots=True, eq=False)
class SquareSlopes:
    """Mean slopes (2h, 2w) over frames and half squares, share of readable pixels, and the frames' mean depth."""

    dz_dx: Floats
    dz_dy: Floats
    share: Floats
    depth_mm: float


def average_slopes(maps: Sequence[tuple[SlopeMap, float]], mm_per_px: Pair) -> SquareSlopes | None:
    """Means over slope maps (H, W), each with the punch's depth in mm; None without any. mm_per_px (x, y)."""
    if not maps:
        return None
    total = np.sum([_sums(slopes, mm_per_px) for slopes, _ in maps], axis=0)
    share = total[2].astype(np.float64)
    safe = np.maximum(share, 1e-6)
    depth = float(np.mean([depth_mm for _, depth_mm in maps]))
    return SquareSlopes(total[0] / safe, total[1] / safe, share / len(maps), depth)


def surface_view(
    slopes: SquareSlopes,
    indenter: Indenter,
    *,
    centre_mm: Pair,
    depth_std_mm: float,
    mm_per_px: Pair,
    shape: tuple[int, ...],
    name: str,
) -> SurfaceView:
    """The surface (h, w) beside a punch at `centre_mm` of the pad, from pictures of `shape` (H, W).

    `mm_per_px` (x, y) of those; `depth_std_mm` of the depth that the slopes state.
    """
    half = tuple(mm * n / m for mm, n, m in zip(mm_per_px, shape[::-1], slopes.share.shape[::-1], strict=True))
    x, y = _places(slopes.share.shape, half, centre_mm)
    share = np.where(np.hypot(x, y) > indenter.radius_mm + WALL_MM, slopes.share, 0.0)
    depth, beside = integrate_half_squares(
        slopes.dz_dx, slopes.dz_dy, share=share, least=SOUND, mm_per_px=(half[0], half[1])
    )
    scale = (2 * half[0], 2 * half[1])
    if indenter.bevel is not None:
        along, (x, y) = SIDES[indenter.bevel], _places(depth.shape, scale, centre_mm)
        start = indenter.bevel_distance_mm or indenter.radius_mm + 2 * BEFORE_BEVEL_MM
        beside &= along[0] * x + along[1] * y < start - BEFORE_BEVEL_MM
    return SurfaceView(
        depth, beside, scale, indenter.radius_mm, centre_mm, CENTRE_STD_MM, slopes.depth_mm, depth_std_mm, name
    )


def _sums(slopes: SlopeMap, mm_per_px: Pair) -> npt.NDArray[np.float32]:
    """dz/dx, dz/dy and share (3, 2h, 2w) of the readable pixels of half squares, as means over all pixels."""
    readable = np.isfinite(slopes.dz_dx) & np.isfinite(slopes.dz_dy)
    if slopes.valid is not None:
        readable &= slopes.valid
    parts = (np.where(readable, slopes.dz_dx, 0), np.where(readable, slopes.dz_dy, 0), readable)
    size = [2 * max(round(n * mm / SQUARE_MM), 2) for n, mm in zip(readable.shape[::-1], mm_per_px, strict=True)]
    return np.stack([cv2.resize(np.float32(part), size, interpolation=cv2.INTER_AREA) for part in parts])


def _places(shape: tuple[int, ...], mm: Sequence[float], centre_mm: Pair) -> tuple[Floats, Floats]:
    """x (1, w) and y (h, 1) in mm of squares (h, w) from the punch's axis; `mm` (x, y) of a square."""
    rows, columns = shape
    x = (np.arange(columns) - (columns - 1) / 2)[None, :] * mm[0] - centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2)[:, None] * mm[1] - centre_mm[1]
    return np.asarray(x, np.float64), np.asarray(y, np.float64)


# Do lamps cast shadows beside the punch? The fall of the gel over the depth tells, without knowing any lamp.
#
#     f = (z at .5 to .9 mm beyond the edge - z at 1.3 to 1.8 mm) / depth
#
# is nearly one number for all depths: finite elements and pictures without shadows have it grow by an eighth from
# .14 to .56 mm. The wall of a pressed face throws the shadow of low lamps onto just that gel, the farther the
# deeper it stands; slopes read there are too steep, and f grows by a half and more. A line through f against
# depth, with the scatter of the presses about it, decides.
#
# What it does to Poisson's ratio when nothing is done: too low by .02 to .04, and Young's modulus 5 to 20 % too
# high (renderings of others and a path tracer's). Read from the places alone that all lamps reach, without the
# light that the wall sends there, nu was .0025 off (rms) on seven sets of the path tracer, up to .0062 in single
# frames.

FLAG = "cast_shadow"
NEAR_MM = (0.5, 0.9)  # mm beyond the edge, where walls and their blur end
FAR_MM = (1.3, 1.8)  # mm beyond the edge, where shadows of gentle presses end
MIN_GROWTH = 0.25  # of f from the gentlest press to the deepest: twice what depth itself does to it
MIN_SIGMA = 4.0  # deviations of the growth, by the scatter of the presses
MIN_PRESSES = 4  # fewer tell no scatter
MIN_SPAN = 1.5  # deepest over gentlest: less shows no growth
MIN_COUNT = 20  # squares of gel in either ring
LIT_NU_STD = 0.003  # of nu, read where all lamps reach: .0025 rms on sets of `train`; docs/evidence/rendered.md
NU_STD = 0.03  # of nu, where shadows are seen and cannot be left out; by the renderings above


def fall_growth(views: Sequence[SurfaceView]) -> tuple[float, float]:
    """By what part of itself f grows from the gentlest press to the deepest, and its standard deviation.

    NaN where too few presses show it. Depths (h, w) of the views in mm.
    """
    pairs = [(view.certified_depth_mm, _fall_mm(view) / view.certified_depth_mm) for view in views]
    depth, fall = np.array([pair for pair in pairs if np.isfinite(pair).all()]).reshape(-1, 2).T
    if len(depth) < MIN_PRESSES or depth.max() < MIN_SPAN * depth.min():
        return np.nan, np.nan
    design = np.stack([np.ones_like(depth), depth - depth.min()], axis=1)
    (start, slope), *_ = np.linalg.lstsq(design, fall, rcond=None)
    scatter = np.sum((fall - design @ (start, slope)) ** 2) / (len(depth) - 2)
    span = float(np.ptp(depth))
    std = span * float(np.sqrt(scatter * np.linalg.inv(design.T @ design)[1, 1]))
    return span * float(slope) / abs(float(start)), std / abs(float(start))


def shows_shadow(growth: float, std: float) -> bool:
    """Whether a growth of f, and its deviation, are more than depth itself and the presses' scatter make."""
    return bool(growth > MIN_GROWTH and growth > MIN_SIGMA * std)


def _fall_mm(view: SurfaceView) -> float:
    rows, columns = view.depth_mm.shape
    x = (np.arange(columns) - (columns - 1) / 2) * view.mm_per_px[0] - view.centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2) * view.mm_per_px[1] - view.centre_mm[1]
    beyond = np.hypot(x[None, :], y[:, None]) - view.radius_mm
    near, far = (_ring(view, beyond, limits) for limits in (NEAR_MM, FAR_MM))
    return near - far


def _ring(view: SurfaceView, beyond: Floats, limits: tuple[float, float]) -> float:
    inside = view.valid & (beyond > limits[0]) & (beyond < limits[1])
    return float(view.depth_mm[inside].mean()) if np.count_nonzero(inside) >= MIN_COUNT else np.nan


# Poisson's ratio from the gel's rise beside each accepted punch, read apart from the punch's walls.
#
# A height map reaches the gel beside a punch over walls that are too steep to be read, and what is missing there
# leaks into all of it. Here the slopes alone are taken, averaged over the frames near the event and integrated
# with the face and its walls left out (surface_beside_punch.py). Level and tilt are then open, which a fit of the
# rise does not mind. The depth is the certified one, carried to each frame by the press's curve.
#
# Known of the map: its gain from balls that were held out, and a light that drifts unevenly, which the gel's
# gentle slopes are taken for in part: it leaves a bowl, which is fitted along.

FRAMES = 8  # a press: more no longer lower what is left, which all frames share; benchmarks.nu_from_frames
NEAR = 0.15  # of the depth: frames this near to the event show one surface on another scale
MAP_OFF = 0.1  # of the depth: pictures that are farther from the force's have lost or gained a wall
FORCE_POWER = 1.1  # of the depth, as which the force grows near .1 of the thickness: 1 + beta w/h
GUARD = 0.4  # thicknesses beside the edge, where the edge's radius and the wall's blur reach
BOWL_STD_PER_MM = 3e-4  # slope per mm, one sigma: three thousandths of slope at 10 mm
MAX_NU = 0.4999  # of a gel
INTERVAL = 1.96  # deviations to either end of a 95 % interval
STATED_STD = 0.005  # of a Poisson's ratio stated without one


def fit_nu(
    recording: Recording, reconstructor: Reconstructor, *, views: Sequence[SurfaceView]
) -> SurfaceFit | None:
    """Poisson's ratio from the gel beside the accepted presses; None where none shows it or the gel is unknown."""
    gel = recording.sensor.gel
    if gel is None or not views:
        return None
    settings = SurfaceFitSettings(
        guard_mm=GUARD * gel.thickness_mm,
        gain_std=ring_gain_std(reconstructor.method),
        bowl_std_per_mm=BOWL_STD_PER_MM,
    )
    try:
        return fit_poisson_ratio(
            views, thickness_mm=gel.thickness_mm, thickness_std_mm=gel.thickness_std_mm, settings=settings
        )
    except InputError:  # no view that the profiles reach
        return None


def with_nu(
    recording: Recording, reconstructor: Reconstructor, *, certificate: Certificate
) -> tuple[Certificate, Estimate | None]:
    """fit_nu, and the certificate with depths that follow it where nothing better is stated of the gel.

    Where the gel beside the punch shows cast shadows it is read from the places that all lamps reach, and the
    certificate is flagged.
    """
    gel = recording.sensor.gel
    views = surfaces_beside_punch(recording, reconstructor, certificate=certificate) if gel is not None else []
    found = fit_nu(recording, reconstructor, views=views)
    if found is None or gel is None:
        return certificate, None
    growth = fall_growth(views)
    if shows_shadow(*growth):
        found, said = _out_of_shadow(found, recording, reconstructor, certificate=certificate)
        seen = (
            f"The fall of the gel beside the punch over depth grows by {growth[0]:.0%}: lamps cast shadows there."
        )
        told = [f"{seen} {said}"]
        if not certificate.scale_doubt:
            certified = certified_of(certificate.points)
            doubt = doubt_beside_shadows(recording, reconstructor, certified=certified)
            certificate = replace(certificate, scale_doubt=doubt)
            told.append(doubt)
        certificate = replace(
            certificate, warnings=(*certificate.warnings, *filter(None, told)), flags=(*certificate.flags, FLAG)
        )
    if found.left_out:
        left_out = f"The gel beside presses {', '.join(found.left_out)} lies beyond the profiles: not used for nu."
        certificate = replace(certificate, warnings=(*certificate.warnings, left_out))
    stated = math.inf if gel.poisson_ratio is None else gel.poisson_ratio_std or STATED_STD
    if (found.poisson_ratio.std or math.inf) > stated:
        return certificate, found.poisson_ratio
    return with_pile_up(certificate, recording, poisson_ratio=found.poisson_ratio), found.poisson_ratio


def _out_of_shadow(
    plain: SurfaceFit, recording: Recording, reconstructor: Reconstructor, *, certificate: Certificate
) -> tuple[SurfaceFit, str]:
    """The fit to what all lamps reach, else the plain one with what shadows may do to it; and which, in words."""
    lamps = find_lamps(recording, reconstructor)
    if lamps is not None and not lamps.doubtful:
        views = surfaces_beside_punch(recording, reconstructor, certificate=certificate, lamps=lamps)
        found = fit_nu(recording, reconstructor, views=views)
        if found is not None:
            wider = replace(found, poisson_ratio=_widened(found.poisson_ratio, LIT_NU_STD))
            said = _without(plain, found, recording)
            return wider, f"nu is read from the places that all lamps reach.{said}"
    nu = plain.poisson_ratio
    if nu.value is not None and nu.std is not None and nu.interval95 is not None:
        low, high = nu.interval95
        nu = replace(nu, std=math.hypot(nu.std, NU_STD), interval95=(low, min(high + 2 * NU_STD, MAX_NU)))
    why = "" if lamps is None else f" {UNKNOWN_LAMPS}: {MEANING[UNKNOWN_LAMPS]}."
    return replace(plain, poisson_ratio=nu), (
        f"The lamps' places are not known, so nu may be {NU_STD:g} too low and E 5 to 20 % too high.{why}"
    )


def _widened(nu: Estimate, std: float) -> Estimate:
    """The estimate with a further deviation, alike to both sides."""
    if nu.std is None or nu.interval95 is None:
        return nu
    low, high = nu.interval95
    more = math.hypot(0.5 * (high - low), INTERVAL * std) - 0.5 * (high - low)
    return replace(nu, std=math.hypot(nu.std, std), interval95=(low - more, min(high + more, MAX_NU)))


def _without(plain: SurfaceFit, lit_alone: SurfaceFit, recording: Recording) -> str:
    """What nu and E would be from all of the gel, in words; at one force E goes as (1 - nu^2)/kappa(nu)."""
    values, gel = (plain.poisson_ratio.value, lit_alone.poisson_ratio.value), recording.sensor.gel
    if gel is None or values[0] is None or values[1] is None:
        return ""
    a_over_h = max(one.radius_mm for one in recording.indenters.values()) / gel.thickness_mm
    if not a_over_h <= A_OVER_H_RANGE[1]:
        return ""
    of_all, of_lit = ((1 - nu**2) / float(fast_kappa(nu, a_over_h)) for nu in (values[0], values[1]))
    return f" All of the gel would give {values[0]:.3f} for {values[1]:.3f}, and E {of_all / of_lit - 1:+.1%}."


def with_pile_up(certificate: Certificate, recording: Recording, *, poisson_ratio: Estimate) -> Certificate:
    """The certificate with the bevel's touch corrected by the rise that belongs to this Poisson's ratio.

    The rise that the frames show stays part of it. As it is where nu has no value or the bevel's place is unknown.
    """
    gel, pile_ups = recording.sensor.gel, certificate.pile_ups
    if gel is None or not pile_ups or poisson_ratio.value is None or certificate.bevel_distance_mm is None:
        return certificate
    known = replace(gel, poisson_ratio=poisson_ratio.value, poisson_ratio_std=poisson_ratio.std)
    points, scales = [], {}
    for point in certificate.points:
        indenter = recording.indenters[point.indenter]
        distance = indenter.bevel_distance_mm or certificate.bevel_distance_mm
        computed = computed_ratio(known, indenter, distance_mm=distance)
        if computed is None:
            points.append(point)
            continue
        old = pile_ups.get(point.press)
        pile_up = combine(old.seen if old else None, computed)
        if indenter.bevel_distance_mm is None:
            pile_up = blur_place(pile_up, known, indenter=indenter, distance_mm=distance)
        depth = point.depth_uncorrected_mm / (1 + pile_up.ratio)
        scale_std, tilt_std = point.details.travel_scale_std, point.details.tilt_std_mm
        std = depth_std(
            depth,
            pile_up,
            height_std_mm=indenter.height_std_mm,
            tilt_std_mm=tilt_std if np.isfinite(tilt_std) else 0.0,
            scale_std=scale_std if np.isfinite(scale_std) else None,
        )
        scales[point.press] = depth / point.depth_mm
        details = replace(point.details, pile_up_ratio=pile_up.ratio, pile_up_ratio_std=pile_up.std)
        points.append(replace(point, depth_mm=depth, depth_std_mm=std, details=details))
    curves = [replace(c, depth_mm=c.depth_mm * scales.get(c.press, 1.0)) for c in certificate.curves]
    return replace(certificate, points=tuple(points), curves=tuple(curves))


def surfaces_beside_punch(
    recording: Recording, reconstructor: Reconstructor, *, certificate: Certificate, lamps: Lamps | None = None
) -> list[SurfaceView]:
    """One view for each accepted press of a flat cylinder that left a curve and a footprint.

    Reads FRAMES frames of each; a press whose frames cannot be read again is left out. Depth is in the scale of
    the map's slopes, its level open. With `lamps`, places that one of them does not reach are left out, and the
    light that the face's wall sends to the gel is taken off.
    """
    sensor = recording.sensor
    field = None if lamps is None else LightField.of(lamps, (sensor.height_px, sensor.width_px), sensor.mm_per_px)
    curves = {curve.press: curve for curve in certificate.curves}
    views = []
    for point in certificate.points:
        evidence, indenter = certificate.evidence.get(point.press), recording.indenters.get(point.indenter)
        if not point.accepted or evidence is None or evidence.footprint is None or point.press not in curves:
            continue
        if indenter is None or indenter.shape != "flat_cylinder":
            continue
        rows = _frames(recording, curves[point.press], point)
        reader = _reader(recording, reconstructor, rows, face=evidence.footprint, field=field)
        slopes = average_slopes(list(_slope_maps(recording, reader, rows)), sensor.mm_per_px)
        if slopes is not None:
            distance = indenter.bevel_distance_mm or certificate.bevel_distance_mm
            view = surface_view(
                slopes,
                replace(indenter, bevel_distance_mm=distance),
                centre_mm=evidence.footprint.centre_mm,
                depth_std_mm=point.depth_std_mm if np.isfinite(point.depth_std_mm) else 0.02 * point.depth_mm,
                mm_per_px=sensor.mm_per_px,
                shape=evidence.footprint.mask.shape,
                name=point.press,
            )
            views.append(view)
    return views


def _reader(
    recording: Recording,
    reconstructor: Reconstructor,
    rows: Sequence[tuple[int, float]],
    *,
    face: Footprint,
    field: LightField | None,
) -> Reconstructor | LitSlopes:
    """What reads the slopes of a press: the reconstructor, or with lamps what reads the lit places alone."""
    if field is None or not rows:
        return reconstructor
    row, depth = rows[len(rows) // 2]
    try:
        frame = read_frame(recording, row)
        return lit_slopes(reconstructor, field, frame, face=face.mask, depth_mm=depth)
    except TactilevisionError:  # a torn frame; the certificate names it
        return reconstructor


def _frames(recording: Recording, curve: Curve, point: CertifiedPoint) -> list[tuple[int, float]]:
    """Number and depth (mm) of the frames nearest to the event in time, of about its depth."""
    depth_mm = _depths(curve, point)
    near = np.abs(depth_mm / point.depth_mm - 1) < NEAR
    order = np.argsort(np.where(near, np.abs(curve.time_s - point.time_s), np.inf), kind="stable")
    chosen = order[: min(FRAMES, int(near.sum()))]
    times = recording.frame_times_s
    return [(int(np.argmin(np.abs(times - curve.time_s[k]))), float(depth_mm[k])) for k in np.sort(chosen)]


def _depths(curve: Curve, point: CertifiedPoint) -> Floats:
    """Depths (T,) of the curve in mm: by the force over the event's where the picture's are far from that.

    A deep wall may be read in one frame and not in the next, which moves the picture's depth by a half.
    """
    force = np.maximum(curve.force_N[:, 2], 0.0)
    there = float(np.interp(point.time_s, curve.time_s, force))
    if not there > 0:
        return curve.depth_mm
    by_force = point.depth_mm * (force / there) ** (1 / FORCE_POWER)
    off = np.abs(curve.depth_mm - by_force) > MAP_OFF * point.depth_mm
    return np.where(off, by_force, curve.depth_mm)


def _slope_maps(
    recording: Recording, reader: Reconstructor | LitSlopes, rows: Sequence[tuple[int, float]]
) -> Iterator[tuple[SlopeMap, float]]:
    for row, depth in rows:
        with suppress(TactilevisionError):  # a torn frame; the certificate names it
            yield reader.slope_map(read_frame(recording, row)), depth
