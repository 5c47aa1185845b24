"""Poisson's ratio from the gel's rise beside each accepted punch, read apart from the punch's walls.

A height map reaches the gel beside a punch over walls that are too steep to be read, and what is missing there
leaks into all of it. Here the slopes alone are taken, averaged over the frames near the event and integrated with
the face and its walls left out (surface_beside_punch.py). Level and tilt are then open, which a fit of the rise
does not mind. The depth is the certified one, carried to each frame by the press's curve.

Known of the map: its gain from balls that were held out, and a light that drifts unevenly, which the gel's gentle
slopes are taken for in part: it leaves a bowl, which is fitted along.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from tactilevision.certificate.certificate import Certificate
from tactilevision.certificate.depth.cast_shadow import FLAG, LIT_NU_STD, NU_STD, fall_growth, shows_shadow
from tactilevision.certificate.depth.certified_faces import certified_of
from tactilevision.certificate.depth.pile_up import blur_place, combine, computed_ratio, depth_std
from tactilevision.certificate.depth.scale_doubt import doubt_beside_shadows
from tactilevision.certificate.depth.slope_gain import ring_gain_std
from tactilevision.certificate.surface_beside_punch import average_slopes, surface_view
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.mechanics.kappa import fast_kappa
from tactilevision.mechanics.poisson_from_surface import SurfaceFit, SurfaceFitSettings, fit_poisson_ratio
from tactilevision.mechanics.punch_equation import A_OVER_H_RANGE
from tactilevision.mechanics.surface_view import SurfaceView
from tactilevision.photometric.illumination.cast_shadow import LightField
from tactilevision.photometric.illumination.lamps import Lamps
from tactilevision.reconstruct import Reconstructor
from tactilevision.reconstruct.lamps import find_lamps
from tactilevision.reconstruct.lit_slopes import LitSlopes, lit_slopes
from tactilevision.recording import Recording, read_frame
from tactilevision.records import CertifiedPoint, Curve, Estimate, Floats, Footprint, SlopeMap
from tactilevision.records.flags import MEANING, UNKNOWN_LAMPS

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
        if not any("gentle faces" in line for line in certificate.warnings):
            certified = certified_of(certificate.points)
            told.append(doubt_beside_shadows(recording, reconstructor, certified=certified))
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
