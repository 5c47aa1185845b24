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
from tactilevision.heightmap.poisson import integrate_half_squares
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.mechanics.poisson_from_surface import SurfaceFit, SurfaceFitSettings, fit_poisson_ratio
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.press.certificate import Certificate
from tactilevision.press.pile_up import SILICONE_STD, depth_std, pile_up_at_bevel, ring_gain_std
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.constants import Z95
from tactilevision.records.maps import SlopeMap
from tactilevision.records.measured import Curve, Estimate, Floats, Pair
from tactilevision.records.rig import SHADOW_ZONE, Indenter, ShadowZone

# The surface of the gel around a punch, from slopes alone.
#
# Slopes of several frames are averaged over half squares (SQUARE_MM/2) and integrated to squares, excluding the
# face and its walls, so that the gel outside depends on its own slopes only. Its level and tilt are then unknown.
# Gel under the bevel, and beyond it, is excluded.

SQUARE_MM = 0.25  # mm, side of the squares that slopes are averaged over; benchmarks.nu_from_frames
WALL_MM = 0.5  # mm beyond the edge: steep profile, ink and blur; benchmarks.nu_from_frames
BEFORE_BEVEL_MM = 0.5  # mm before the bevel's edge that are excluded because of the bevel's dent
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
    """Return means over slope maps (H, W), each with the punch's depth in mm; or None. mm_per_px (x, y)."""
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
    clear_mm: float = 0.0,
) -> SurfaceView:
    """Return the surface (h, w) around a punch at `centre_mm` of the pad, from pictures of `shape` (H, W).

    `mm_per_px` (x, y) of those; `depth_std_mm` of the depth that the slopes state. Gel within `clear_mm` of the
    punch's edge is not used.
    """
    half = tuple(mm * n / m for mm, n, m in zip(mm_per_px, shape[::-1], slopes.share.shape[::-1], strict=True))
    x, y = _places(slopes.share.shape, half, centre_mm)
    share = np.where(np.hypot(x, y) > indenter.radius_mm + max(WALL_MM, clear_mm), slopes.share, 0.0)
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
    """Return dz/dx, dz/dy and share (3, 2h, 2w) of readable pixels of half squares, as means over all pixels."""
    readable = np.isfinite(slopes.dz_dx) & np.isfinite(slopes.dz_dy)
    if slopes.valid is not None:
        readable &= slopes.valid
    parts = (np.where(readable, slopes.dz_dx, 0), np.where(readable, slopes.dz_dy, 0), readable)
    size = [2 * max(round(n * mm / SQUARE_MM), 2) for n, mm in zip(readable.shape[::-1], mm_per_px, strict=True)]
    return np.stack([cv2.resize(np.float32(part), size, interpolation=cv2.INTER_AREA) for part in parts])


def _places(shape: tuple[int, ...], mm: Sequence[float], centre_mm: Pair) -> tuple[Floats, Floats]:
    """Return x (1, w) and y (h, 1) in mm of squares (h, w) from the punch's axis; `mm` (x, y) of a square."""
    rows, columns = shape
    x = (np.arange(columns) - (columns - 1) / 2)[None, :] * mm[0] - centre_mm[0]
    y = (np.arange(rows) - (rows - 1) / 2)[:, None] * mm[1] - centre_mm[1]
    return np.asarray(x, np.float64), np.asarray(y, np.float64)


# Do lamps cast shadows around the punch? The fall of the gel over the depth shows it, for unknown lamps.
#
#     f = (z at .5 to .9 mm beyond the edge - z at 1.3 to 1.8 mm) / depth
#
# is nearly constant over depth: in finite elements and pictures without shadows it grows by an eighth from .14 to
# .56 mm. The wall of a pressed face casts the shadow of low lamps onto that gel, farther with depth; slopes read
# there are too steep, and f grows by a half and more. A line through f against depth, with the scatter of the
# presses about it, decides on a flag; nu is read beyond shadows in any case.

FLAG = "cast_shadow"
NEAR_MM = (0.5, 0.9)  # mm beyond the edge, where walls and their blur end
FAR_MM = (1.3, 1.8)  # mm beyond the edge, where shadows of gentle presses end
MIN_GROWTH = 0.25  # of f from the gentlest press to the deepest: twice the growth by depth itself
MIN_SIGMA = 4.0  # deviations of the growth, by the scatter of the presses
MIN_PRESSES = 4  # presses; fewer do not determine the scatter
MIN_SPAN = 1.5  # deepest over gentlest: less shows no growth
MIN_COUNT = 20  # squares of gel in either ring


def fall_growth(views: Sequence[SurfaceView]) -> tuple[float, float]:
    """Return the relative growth of f from the gentlest press to the deepest, and its standard deviation.

    NaN for too few presses. Depths (h, w) of the views in mm.
    """
    pairs = [(view.certified_depth_mm, _fall_mm(view) / view.certified_depth_mm) for view in views]
    depth, fall = np.array([pair for pair in pairs if np.isfinite(pair).all()]).reshape(-1, 2).T
    if len(depth) < MIN_PRESSES or depth.max() < MIN_SPAN * depth.min():
        return np.nan, np.nan
    (slope, start), covariance = np.polyfit(depth - depth.min(), fall, 1, cov=True)
    span = float(np.ptp(depth)) / abs(start)
    return float(span * slope), float(span * np.sqrt(covariance[0, 0]))


def shows_shadow(growth: float, std: float) -> bool:
    """Return whether a growth of f exceeds the effect of depth itself and, significantly, the presses' scatter."""
    return bool(growth > MIN_GROWTH and growth > MIN_SIGMA * std)


def _fall_mm(view: SurfaceView) -> float:
    x, y = _places(view.depth_mm.shape, view.mm_per_px, view.centre_mm)
    beyond = np.hypot(x, y) - view.radius_mm
    near, far = (_ring(view, beyond, limits) for limits in (NEAR_MM, FAR_MM))
    return near - far


def _ring(view: SurfaceView, beyond: Floats, limits: tuple[float, float]) -> float:
    inside = view.valid & (beyond > limits[0]) & (beyond < limits[1])
    return float(view.depth_mm[inside].mean()) if np.count_nonzero(inside) >= MIN_COUNT else np.nan


# Poisson's ratio from the gel's rise around each accepted punch, read where every lamp reaches.
#
# A height map includes walls that are too steep to be read, and the missing step leaks into all of it. Here slopes
# alone are averaged over the frames near the event and integrated without the face and the gel that its wall may
# shade:
#
#     r > a + k w,    k = K + 3 std_K;  where no such gel shows nu, k = K = 1/tan(elevation of the lowest lamp)
#
# a the radius, w the certified depth, transferred to each frame by the press's curve. In path-traced pictures
# gel nearer than K + 3 std_K gives too low a nu, presumably by reflected light. The change of nu with k is part of
# its deviation:
#
#     std^2 = std_fit^2 + (dnu/dk std_K)^2 + std_scattered^2,  dnu/dk std_K = (nu(k + std_K) - nu(k - std_K))/2
#
# Level and tilt of the surface are free parameters of the fit. Known errors of the map: its gain from held-out
# balls, and uneven light drift, whose bowl is fitted as well.

FRAMES = 8  # a press: more do not reduce the error common to all frames; benchmarks.nu_from_frames
NEAR = 0.15  # of the depth: frames this near to the event show one surface on another scale
MAP_OFF = 0.1  # of the depth: pictures farther from the force's depth have misread a wall
FORCE_POWER = 1.1  # of the depth: exponent of the force near .1 of the thickness: 1 + beta w/h
GUARD = 0.4  # thicknesses from the edge, to which the edge's radius and the wall's blur extend
BOWL_STD_PER_MM = 3e-4  # slope per mm, one sigma: three thousandths of slope at 10 mm
STATED_STD = 0.005  # of a Poisson's ratio stated without one
UNKNOWN_STD = 0.02  # of a depth whose deviation is unknown
SCATTERED_STD = 0.007  # of nu from gel nearer than K + 3 std_K: its rms error on six path-traced recordings


@dataclass(frozen=True, slots=True, eq=False)
class PressSlopes:
    """Mean slopes of one accepted press near its event, and the position of its punch: `centre_mm` on the pad."""

    point: CertifiedPoint
    indenter: Indenter
    centre_mm: Pair
    slopes: SquareSlopes
    mm_per_px: Pair
    shape: tuple[int, ...]

    def view(self, reach: float) -> SurfaceView:
        """Return the surface farther than `reach` depths beyond the punch's edge."""
        depth, std = self.point.depth_mm, self.point.depth_std_mm
        return surface_view(
            self.slopes,
            self.indenter,
            centre_mm=self.centre_mm,
            depth_std_mm=std if np.isfinite(std) else UNKNOWN_STD * depth,
            mm_per_px=self.mm_per_px,
            shape=self.shape,
            name=self.point.press,
            clear_mm=reach * depth,
        )


def fit_nu(
    recording: Recording, reconstructor: Reconstructor, views: Sequence[SurfaceView], start: tuple[float, ...] = ()
) -> SurfaceFit | None:
    """Fit Poisson's ratio to the surfaces of the presses; None where no profile reaches any of them.

    `start`: values of a fit to other gel around the same presses.
    """
    gel = recording.sensor.gel
    if gel is None or not views:
        return None
    settings = SurfaceFitSettings(
        guard_mm=GUARD * gel.thickness_mm,
        gain_std=ring_gain_std(reconstructor.method),
        bowl_std_per_mm=BOWL_STD_PER_MM,
        start=start,
    )
    try:
        return fit_poisson_ratio(
            views, thickness_mm=gel.thickness_mm, thickness_std_mm=gel.thickness_std_mm, settings=settings
        )
    except InputError:  # no view that the profiles reach
        return None


def nu_beyond_shadows(
    recording: Recording, reconstructor: Reconstructor, *, presses: Sequence[PressSlopes], zone: ShadowZone
) -> tuple[Estimate, tuple[str, ...]]:
    """Return Poisson's ratio from gel that no wall can shade, and the presses that were not used.

    Without a value where too little gel is in view, where noise hides the rise, and where the fit ends at a bound.
    """
    found = _nu_beyond(recording, reconstructor, presses, reach=zone.clear, reach_std=zone.reach_std)
    if found[0].value is not None:
        return found
    nu, unused = _nu_beyond(recording, reconstructor, presses, reach=zone.reach, reach_std=zone.reach_std)
    return _widened(nu, SCATTERED_STD), unused


def _nu_beyond(
    recording: Recording,
    reconstructor: Reconstructor,
    presses: Sequence[PressSlopes],
    *,
    reach: float,
    reach_std: float,
) -> tuple[Estimate, tuple[str, ...]]:
    """Return nu from gel farther than `reach` depths from the edges, and the presses that were not used."""

    def fitted(depths: float, start: tuple[float, ...] = ()) -> SurfaceFit | None:
        return fit_nu(recording, reconstructor, views=[press.view(depths) for press in presses], start=start)

    fit = fitted(reach)
    if fit is None:
        why = f"no gel that the profiles reach is in view beyond {reach:.1f} depths of a punch's edge"
        return Estimate(None, None, None, "1", why), ()
    nu, unused = fit.poisson_ratio, fit.left_out
    if nu.value is None or nu.std is None:
        return nu, unused
    others = [fitted(depths, tuple(fit.values)) for depths in (reach - reach_std, reach + reach_std)]
    values = [float(other.values[0]) for other in others if other is not None]
    change = 0.5 * float(np.ptp(values)) if len(values) == 2 else float(np.ptp([nu.value, *values]))
    return _widened(nu, change), unused


def _widened(nu: Estimate, more_std: float) -> Estimate:
    """Return nu with another term of its deviation."""
    if nu.value is None or nu.std is None:
        return nu
    std = math.hypot(nu.std, more_std)
    low, high = nu.value - Z95 * std, nu.value + Z95 * std
    return replace(nu, std=std, interval95=(max(low, 0.0), min(high, 0.5)))


def with_nu(
    recording: Recording, reconstructor: Reconstructor, *, certificate: Certificate, zone: ShadowZone = SHADOW_ZONE
) -> tuple[Certificate, Estimate | None]:
    """Return the certificate with depths that follow nu_beyond_shadows where no better value of the gel is known.

    And that nu; None where no press shows it. The certificate is flagged where the gel's fall around the punches
    over depth grows with depth: lamps cast shadows there.
    """
    gel = recording.sensor.gel
    presses = press_slopes(recording, reconstructor, certificate=certificate) if gel is not None else []
    if gel is None or not presses:
        return certificate, None
    nu, unused = nu_beyond_shadows(recording, reconstructor, presses=presses, zone=zone)
    growth = fall_growth([press.view(0.0) for press in presses])
    warnings, flags = certificate.warnings, certificate.flags
    if shows_shadow(*growth):
        flags = (*flags, FLAG)
        warnings = (
            *warnings,
            f"The fall of the gel around the punch over depth grows by {growth[0]:.0%}: lamps cast shadows there. "
            f"nu is read from gel {zone.clear:.0f} depths beyond the edge, or {zone.reach:.0f} where no gel "
            "farther out shows it.",
        )
    if unused:
        why = "lies beyond the profiles, or too little of it is in view: not used for nu"
        warnings = (*warnings, f"The gel around presses {', '.join(unused)} {why}.")
    certificate = replace(certificate, warnings=warnings, flags=flags)
    known = SILICONE_STD if gel.poisson_ratio is None else gel.poisson_ratio_std or STATED_STD
    if nu.value is None or (nu.std or math.inf) > known:
        return certificate, nu
    return with_pile_up(certificate, recording, poisson_ratio=nu), nu


def with_pile_up(certificate: Certificate, recording: Recording, *, poisson_ratio: Estimate) -> Certificate:
    """Return the certificate with the bevel's touch corrected by the rise for this Poisson's ratio.

    Unchanged where nu has no value or the bevel's place is unknown.
    """
    gel = recording.sensor.gel
    if (
        gel is None
        or not certificate.pile_ups
        or poisson_ratio.value is None
        or certificate.bevel_distance_mm is None
    ):
        return certificate
    known = replace(gel, poisson_ratio=poisson_ratio.value, poisson_ratio_std=poisson_ratio.std)
    points, scales = [], {}
    for point in certificate.points:
        indenter = recording.indenters[point.indenter]
        pile_up = pile_up_at_bevel(known, indenter, certificate.bevel_distance_mm)
        if pile_up is None:
            points.append(point)
            continue
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


def press_slopes(
    recording: Recording, reconstructor: Reconstructor, *, certificate: Certificate
) -> list[PressSlopes]:
    """Return the slopes of each accepted press of a flat cylinder that left a curve and a footprint.

    Reads FRAMES frames of each; a press whose frames cannot be read again is passed over.
    """
    curves = {curve.press: curve for curve in certificate.curves}
    presses = []
    for point in certificate.points:
        evidence, indenter = certificate.evidence.get(point.press), recording.indenters.get(point.indenter)
        if not point.accepted or evidence is None or evidence.footprint is None or point.press not in curves:
            continue
        if indenter is None or indenter.shape != "flat_cylinder":
            continue
        rows, scale = _frames(recording, curves[point.press], point), recording.sensor.mm_per_px
        slopes = average_slopes(list(_slope_maps(recording, reconstructor, rows)), scale)
        if slopes is not None:
            face = evidence.footprint
            known = replace(
                indenter, bevel_distance_mm=indenter.bevel_distance_mm or certificate.bevel_distance_mm
            )
            presses.append(PressSlopes(point, known, face.centre_mm, slopes, scale, face.mask.shape))
    return presses


def _frames(recording: Recording, curve: Curve, point: CertifiedPoint) -> list[tuple[int, float]]:
    """Return number and depth (mm) of the frames nearest to the event in time, of similar depth."""
    depth_mm = _depths(curve, point)
    near = np.abs(depth_mm / point.depth_mm - 1) < NEAR
    order = np.argsort(np.where(near, np.abs(curve.time_s - point.time_s), np.inf), kind="stable")
    chosen = order[: min(FRAMES, int(near.sum()))]
    times = recording.frame_times_s
    return [(int(np.argmin(np.abs(times - curve.time_s[k]))), float(depth_mm[k])) for k in np.sort(chosen)]


def _depths(curve: Curve, point: CertifiedPoint) -> Floats:
    """Return depths (T,) of the curve in mm: by the force over the event's where the picture's differ much from
    that.

    A deep wall may be read in one frame and not in the next, which changes the picture's depth by a half.
    """
    force = np.maximum(curve.force_N[:, 2], 0.0)
    there = float(np.interp(point.time_s, curve.time_s, force))
    if not there > 0:
        return curve.depth_mm
    by_force = point.depth_mm * (force / there) ** (1 / FORCE_POWER)
    off = np.abs(curve.depth_mm - by_force) > MAP_OFF * point.depth_mm
    return np.where(off, by_force, curve.depth_mm)


def _slope_maps(
    recording: Recording, reader: Reconstructor, rows: Sequence[tuple[int, float]]
) -> Iterator[tuple[SlopeMap, float]]:
    for row, depth in rows:
        with suppress(TactilevisionError):  # a torn frame; the certificate names it
            yield reader.slope_map(read_frame(recording, row)), depth
