"""Calibrate the light on contacts of unknown shape, where no ball was pressed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from tactilevision.errors import InputError
from tactilevision.heightmap.reference_match import some_frames
from tactilevision.heightmap.torn_frames import TearCheck
from tactilevision.photometric.ball_detection import first_guess
from tactilevision.photometric.ball_samples import places_of
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS, Polynomial, design, terms_of
from tactilevision.photometric.reference import Reference, make_reference
from tactilevision.records.constants import NONZERO, ROUNDING, TINY
from tactilevision.records.measured import Bools, Bytes, Floats, Picture
from tactilevision.robust import mad_std

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording


# The condition that a contact of unknown shape sets on a colour law: its slopes are those of a surface.
#
# Slopes p, q of a height have no curl. For any test function v that vanishes at the border of the picture,
#
#     integral of  p dv/dy - q dv/dx  = 0
#
# which needs no derivative of noisy slopes, and is linear in the coefficients of a linear law. v are Gaussians
# about the contact, and Gaussians times x or y from their centre; widths and places scale with the contact.

WIDTHS = (0.2, 0.35, 0.6)  # of a Gaussian, in radii of the contact; twice as wide is .1 to 1 degree worse
SPOKES = 6  # Gaussians around the central one
APART = 1.6  # widths from the centre to the surrounding Gaussians
FARTHEST = 1.4  # contact radii from the centre: beyond there is little slope
SUPPORT = 2.5  # widths beyond which a Gaussian is negligible
REACH = 2.5  # contact radii: half-width of a window
MAX_PIXELS = 6000  # of a window; more do not reduce the noise of the moments
MAX_INVALID = 0.01  # of a test function's weight where the colours are invalid
MIN_RADIUS_PX = 6  # px; a smaller contact is mostly blur
MIN_EQUATIONS = 6  # equations; a contact at the border leaves fewer
SAMPLES = 300  # sampled pixels of a contact for its slopes
# highest power of place for one colour and for products of two; 2 and 1 are .1 to .9 degrees worse on D, F and G
PLACE_ORDER = {1: 4, 2: 1}
TERMS = terms_of(PLACE_ORDER)


@dataclass(frozen=True, slots=True)
class Contact:
    """`equations` (E, 2 K) for the coefficients of p, then of q; `samples` (M, K) of the terms in the contact.

    `change` (M, 3) and `place` (M, 2) of the samples; `outward` (M, 2) from the contact's centre, in its radii.
    """

    equations: Floats
    samples: Floats
    change: Floats
    place: Floats
    outward: Floats


def contact_of(change: Picture, valid: Bools, rng: np.random.Generator) -> Contact | None:
    """Return the contact of a frame by its relative change (3, H, W), where `valid`, a mask (H, W); or None."""
    try:
        x, y, radius = first_guess(np.ascontiguousarray(change.transpose(1, 2, 0)), valid, hull=True)
    except InputError:
        return None
    if radius < MIN_RADIUS_PX:
        return None
    (across, down), u, place, known = _window(change, valid, x, y, radius)
    edges = x / radius, (valid.shape[1] - 1 - x) / radius, y / radius, (valid.shape[0] - 1 - y) / radius
    tests = np.array(list(_tests(across, down, known, edges=edges)))
    inside = np.flatnonzero((np.hypot(across, down) < 1.0) & known)
    if len(tests) < MIN_EQUATIONS or len(inside) < SAMPLES:
        return None
    terms = design(u, place, TERMS)
    chosen = rng.choice(inside, SAMPLES, replace=False)
    equations = np.concatenate([tests[:, 1] @ terms, -tests[:, 0] @ terms], axis=1)
    outward = np.stack([across, down], axis=1)[chosen]
    return Contact(equations, terms[chosen], u[chosen], place[chosen], outward)


def _window(
    change: Picture, valid: Bools, x: float, y: float, radius: float
) -> tuple[tuple[Floats, Floats], Floats, Floats, Bools]:
    """Return places from the centre in radii, changes (N, 3), picture places (N, 2), and validity."""
    height, width = valid.shape
    step = max(1, int(2 * REACH * radius / np.sqrt(MAX_PIXELS)))
    rows = np.arange(max(0, int(y - REACH * radius)), min(height, int(y + REACH * radius) + 1), step)
    columns = np.arange(max(0, int(x - REACH * radius)), min(width, int(x + REACH * radius) + 1), step)
    at = np.ix_(rows, columns)
    known = valid[at].ravel()
    u = np.where(known, np.nan_to_num(np.stack([plane[at].ravel() for plane in change])), 0.0).T.astype(np.float64)
    row, column = (grid.ravel().astype(np.float64) for grid in np.meshgrid(rows, columns, indexing="ij"))
    return ((column - x) / radius, (row - y) / radius), u, places_of(column, row, valid.shape), known


def _tests(
    across: Floats, down: Floats, known: Bools, *, edges: tuple[float, float, float, float]
) -> Iterator[Floats]:
    """Return the gradients (2, N) of the test functions, each normalised to length 1.

    `edges`: distances from the contact's centre to the left, right, top and bottom, in radii.
    """
    left, right, top, bottom = edges
    for width in WIDTHS:
        turns = np.arange(SPOKES) * 2.0 * np.pi / SPOKES
        away = APART * width
        for cx, cy in [(0.0, 0.0), *zip(away * np.cos(turns), away * np.sin(turns), strict=True)]:
            room = min(cx + left, right - cx, cy + top, bottom - cy)
            if np.hypot(cx, cy) > FARTHEST or room < SUPPORT * width:
                continue
            x, y = across - cx, down - cy
            bell = np.exp(-0.5 * (x * x + y * y) / width**2)
            if bell[~known].sum() > MAX_INVALID * bell.sum():
                continue
            xx, xy, yy = (one / width**2 for one in (x * x, x * y, y * y))
            for slope in ((-x, -y), (-xy, 1.0 - yy), (1.0 - xx, -xy)):
                pair = np.stack([np.asarray(slope[0] * bell), np.asarray(slope[1] * bell)])
                yield pair / np.sqrt(np.sum(pair**2))


# Which contacts are round by a first law of the light, and the condition that this sets on a better law.
#
# The slopes of a round body (a ball, a cone, the round edge of a punch) point to one axis, whatever its profile:
#
#     p (y - cy) - q (x - cx) = 0
#
# at each place, a stronger condition than zero curl. The axis is the best intersection of a first law's slopes. A
# contact whose slopes miss it by more than MAX_MISS_DEG in the median is not round. A nearly round contact passes
# as round, and rotates the law slightly.

# degrees, median: most real balls have 2 to 8 by a first law; 15 reads rendered dents of three ellipses .6 worse
MAX_MISS_DEG = 7
MIN_SLOPE_SHARE = 0.3  # of the median slope: gentler ones have no clear direction
NEAREST = 0.1  # contact radii from the axis: nearer, directions are noise
NEAREST_JUDGED = 0.25  # contact radii from the axis where roundness is judged
ROUNDNESS_ITERATIONS = 4  # of reweighting places for the axis
OUTLYING = 2.0  # deviations at which a place has half weight


def round_equations(contact: Contact, law: Floats) -> Floats | None:
    """Return equations (M, 2 K) for the coefficients of p, then of q, mm/mm, of a round contact; None of another.

    `law` (2, K) gives a first estimate of the slopes. A row is the slope perpendicular to the axis direction, over
    sqrt(M).
    """
    slopes = contact.samples @ law.T
    away = contact.outward - _axis(slopes, contact.outward)
    far = np.hypot(*away.T)
    unit = away / np.maximum(far, TINY)[:, None]
    steep = np.hypot(*slopes.T)
    judged = (far > NEAREST_JUDGED) & (steep > MIN_SLOPE_SHARE * np.median(steep))
    miss = np.angle(-(slopes[judged] @ [1, 1j]) * np.conj(unit[judged] @ [1, 1j]))
    if not judged.any() or np.degrees(np.median(np.abs(miss))) > MAX_MISS_DEG:
        return None
    told = far > NEAREST
    rows = np.concatenate([contact.samples * unit[:, 1:], -contact.samples * unit[:, :1]], axis=1)[told]
    return np.asarray(rows / np.sqrt(len(rows)), np.float64)


def _axis(slopes: Floats, place: Floats) -> Floats:
    """Return the place (2,) nearest to the lines along `slopes` (N, 2) at `place` (N, 2)."""
    across = np.stack([-slopes[:, 1], slopes[:, 0]], axis=1)
    moment = np.sum(across * place, axis=1)
    weights = np.ones(len(moment))
    for _ in range(ROUNDNESS_ITERATIONS):
        normal = (across * weights[:, None]).T @ across
        normal[np.diag_indices(2)] += ROUNDING * np.trace(normal) + NONZERO
        axis = np.linalg.solve(normal, (across * weights[:, None]).T @ moment)
        weights = _cauchy(across @ axis - moment)
    return np.asarray(axis, np.float64)


# A colour law from contacts of unknown shape, without balls.
#
# A law that reads each contact as a surface is correct up to scale and sign: with slopes read as W g of the true
# ones g, zero curl in all contacts gives W = scale times 1, since untouched gel has zero slope (the untouched
# picture). The coefficients c of the law minimise
#
#     mean of w (equations c)^2 / s0^2 + (ANCHOR / contacts) mean of (slopes(c) - anchor)^2 / mean of anchor^2
#
# w are Cauchy weights, s0 the residual of the anchor; each round restores the anchor's scale. The anchor is a law
# assumed to hold over the whole picture, so that c may vary with place even where nothing touched: without a prior
# the constant law of the least curl, of a usual scale, contacts being dents; with one (a network for such sensors)
# the mean of it and of the constant law fitted to these contacts.

MIN_CONTACTS = 4  # contacts; fewer give a warning
MIN_VARYING = 3  # contacts for a law that varies over the picture; two turned one real sensor by 58 degrees
MIN_SLOPE_SPREAD = 0.2  # least over most power of slope by direction: 19 to 86 degrees off have .13 at most
ANCHOR = 10  # weight of the anchor over contacts; 3 to 20 tried on nine real sensors, all within a degree
PRIOR = 0.3  # weight of the prior in the constant law; of 1 to .01 tried on four real sensors, all within a degree
ROUND = 30  # weight of axes of round contacts; 100 within .5 degrees on three real sensors (median)
ROUND_ITERATIONS = 3  # of recomputing axes
RIDGE = 1e-4  # of a term's own power
MAX_ITERATIONS = 3  # of reweighting equations; they converge in two
USUAL_CHANGE = (
    1.7  # colour change over slope, of three colours together: geometric middle of real sensors, .8 to 3.5
)
MIN_GAP = 4  # second least curl over the least: below it contacts do not determine the law; real ones 14 to 60
STEEPEST = 99.5  # percentile of slopes read in the contacts that bounds later ones
CONTRADICTION_DEG = 45  # median angle; right networks 5 to 12, swapped colours or a mirrored picture 59 and more
SPREADING = (0.7548776662, 0.5698402910)  # steps of a sequence that fills a square evenly (Roberts' R2)
LINEAR = np.array([len(PRODUCTS[k]) == 1 and sum(POWERS[m]) == 0 for k, m in TERMS])  # terms of a constant law

Prior = Callable[[Floats, Floats], Floats]


def calibrate_on_contacts(contacts: Sequence[Contact], prior: Prior | None) -> Polynomial | None:
    """Return the law, or None where the contacts do not determine it.

    `prior` gives slopes (N, 2), mm/mm, of relative changes (N, 3) at places (N, 2) from -1 to 1.
    """
    if (found := _constant_law(contacts, prior)) is None:
        return None
    seen, constant = found
    steps = np.arange(len(seen.change))[:, None] * np.array(SPREADING)  # over all of the picture, evenly
    elsewhere = 2.0 * (steps % 1.0) - 1.0
    change, place = np.concatenate([seen.change, seen.change]), np.concatenate([seen.place, elsewhere])
    anchor = change @ constant.T
    if prior is not None:  # directions of both, and the power of the prior: a mean of two that differ has less
        told = prior(change, place)
        anchor = 0.5 * (anchor + told)
        anchor *= np.sqrt(np.sum(told**2) / np.sum(anchor**2))
    terms = np.concatenate([seen.samples, design(seen.change, elsewhere, TERMS)])
    solve = partial(_solve, seen.equations, terms, anchor, scaled=len(seen.change), weight=ANCHOR / len(contacts))
    varies = len(contacts) >= MIN_VARYING
    coefficients = solve(rounds=MAX_ITERATIONS if varies else 0)
    for _ in range(ROUND_ITERATIONS if varies else 0):
        rows = [rows for one in contacts if (rows := round_equations(one, coefficients)) is not None]
        if rows:
            coefficients = solve(rounds=MAX_ITERATIONS, axes=rows)
    full = np.zeros((2, len(PRODUCTS), len(POWERS)))
    full[:, TERMS[:, 0], TERMS[:, 1]] = coefficients
    slopes = seen.samples @ coefficients.T
    return Polynomial(full, float(np.percentile(np.hypot(*slopes.T), STEEPEST)))


def contradict(contacts: Sequence[Contact], prior: Prior) -> bool:
    """Return whether contacts alone rotate the slopes of `prior` by more than CONTRADICTION_DEG."""
    if (found := _constant_law(contacts, None)) is None:
        return False
    seen, constant = found
    own, told = seen.change @ constant.T, prior(seen.change, seen.place)
    turned = np.angle((own @ [1, 1j]) * np.conj(told @ [1, 1j]))
    return bool(np.degrees(np.median(np.abs(turned))) > CONTRADICTION_DEG)


def _constant_law(contacts: Sequence[Contact], prior: Prior | None) -> tuple[Contact, Floats] | None:
    """Return all contacts as one and their constant law (2, 3), near the `prior` if there is one.

    None where the contacts do not determine it, or have slopes along one direction alone.
    """
    if not contacts:
        return None
    seen = _joined(contacts)
    law = _least_curl(seen) if prior is None else _corrected(seen, prior(seen.change, seen.place))
    if law is None or np.linalg.cond(seen.change @ law.T) ** -2 < MIN_SLOPE_SPREAD:
        return None
    return seen, law


def _joined(contacts: Sequence[Contact]) -> Contact:
    """Return all contacts merged into one."""
    names = (one.name for one in fields(Contact))
    return Contact(**{name: np.concatenate([getattr(one, name) for one in contacts]) for name in names})


def _solve(
    equations: Floats,
    terms: Floats,
    anchor: Floats,
    *,
    scaled: int,
    weight: float,
    rounds: int,
    axes: Sequence[Floats] = (),
) -> Floats:
    """Return coefficients (2, K) of `terms` (N, K) near slopes `anchor` (N, 2); the first `scaled` keep their
    power.

    `axes` are the equations of each round contact.
    """
    power, own = float(np.sum(anchor**2)), float(np.sum(anchor[:scaled] ** 2))
    normal = terms.T @ terms / power
    normal[np.diag_indices_from(normal)] *= 1.0 + RIDGE
    held = scipy.linalg.block_diag(normal, normal)
    wanted = (terms.T @ anchor / power).T.ravel()
    found = np.linalg.solve(held, wanted)
    start = float(np.mean((equations @ found) ** 2))
    weights = np.ones(len(equations))
    across = np.concatenate(axes) if axes else np.zeros((1, len(found)))
    share = ROUND * scaled / (max(1, len(axes)) * own)
    about = np.ones(len(across))
    for _ in range(rounds):
        curl = (equations * weights[:, None]).T @ equations / (len(equations) * start)
        curl += share * (across * about[:, None]).T @ across
        found = np.linalg.solve(curl + weight * held, weight * wanted)
        slopes = terms[:scaled] @ found.reshape(2, -1).T
        found *= np.sqrt(own / float(np.sum(slopes**2)))
        weights, about = _cauchy(equations @ found), _cauchy(across @ found)
    return np.asarray(found.reshape(2, -1), np.float64)


def _corrected(seen: Contact, told: Floats) -> Floats:
    """Return the constant law (2, 3) of little curl near slopes `told` (N, 2) of the samples."""
    both = np.concatenate([LINEAR, LINEAR])
    return _solve(
        seen.equations[:, both],
        seen.samples[:, LINEAR],
        told,
        scaled=len(told),
        weight=PRIOR,
        rounds=MAX_ITERATIONS,
    )


def _least_curl(seen: Contact) -> Floats | None:
    """Return the constant law (2, 3) of the least curl for its power, of a usual scale, with contacts as dents."""
    reduced, terms = seen.equations[:, np.concatenate([LINEAR, LINEAR])], seen.samples[:, LINEAR]
    power = terms.T @ terms / len(terms)
    power[np.diag_indices(3)] *= 1.0 + RIDGE
    weights = np.ones(len(reduced))
    for _ in range(MAX_ITERATIONS + 1):
        curl = (reduced * weights[:, None]).T @ reduced / len(reduced)
        values, vectors = scipy.linalg.eigh(curl, scipy.linalg.block_diag(power, power))
        weights = _cauchy(reduced @ vectors[:, 0])
    if values[1] < MIN_GAP * values[0]:
        return None
    law = vectors[:, 0].reshape(2, 3)
    slopes = seen.change @ law.T
    law = law * np.sqrt(np.sum(seen.change**2) / np.sum(slopes**2)) / USUAL_CHANGE
    return np.asarray(-law if np.sum(slopes * seen.outward) > 0 else law, np.float64)


def _cauchy(residual: Floats) -> Floats:
    scale = mad_std(residual, centre=0.0) + TINY  # most of a flat face has no slope at all
    return np.asarray(1.0 / (1.0 + (residual / (OUTLYING * scale)) ** 2))


# The light calibrated on contacts in the frames themselves, without balls.

MAX_FRAMES = 48  # frames examined; half of them are enough for a law that varies over the picture
RELATIVE_ERROR = 0.5  # of a slope, where no network determines its scale
# degrees: medians by one and three contacts, or objects, of nine real sensors (benchmarks.own_contacts)
FEW_OFF_DEG = "4 to 15"
FEW_OFF_WITH_NETWORK_DEG = "3 to 13"  # the same with a network
SCALE_STD = 1.0  # of true over read depth, less 1: nine real sensors have .56 to 3 times what a usual light reads
NETWORK_SCALE_STD = (
    0.4  # with a network, rms: eight real sensors have .76 to 1.28, deep faces of two simulated 1.8
)


def calibrated_on_frames(
    recording: Recording, reference: Reference, *, prior: CalibratedMethod | None
) -> CalibratedMethod | None:
    """Return a method from contacts in a recording's frames, or None where they are too few to determine the
    light.

    Its scale is that of `prior`, or a usual one. A prior that the contacts contradict is rejected, unless they
    agree with it relative to the median of the frames, at many places: then the reference is pressed, and that
    median replaces it.
    """
    frames = some_frames(recording, count=MAX_FRAMES)
    torn = TearCheck(recording.sensor)
    seen = contacts_in(frames, reference, torn)
    contradicted = prior is not None and contradict(seen, prior.law.at)
    if contradicted and prior is not None:
        median = np.median(frames, axis=0).round().astype(np.uint8)
        others = contacts_in(frames, make_reference([median], may_have_marks=reference.marks is not None), torn)
        if _at_many_places(others) and not contradict(others, prior.law.at):
            seen, contradicted = others, False
    prior = None if contradicted else prior
    law = calibrate_on_contacts(seen, None if prior is None else prior.law.at)
    if law is None:
        return None
    card = MethodCard(
        method=law.name,
        fitted_by="contacts",
        sensor=recording.sensor.kind,
        held_out_gain_std=SCALE_STD if prior is None else prior.card.held_out_gain_std,
        steepest_slope=law.steepest,
        other={
            "contacts": len(seen),
            "scale_of": "a usual light" if prior is None else prior.card.sensor,
            "network_contradicted": contradicted,
        },
    )
    error = RELATIVE_ERROR if prior is None else prior.relative_error
    return CalibratedMethod(law, reference, error, None, card)


def _at_many_places(contacts: Sequence[Contact]) -> bool:
    """Return whether most contacts are farther than a radius from their middle: then their median is free gel."""
    if not contacts:
        return False
    centres = np.array([one.place.mean(axis=0) for one in contacts])
    radii = np.array([np.std(one.place, axis=0) / (np.std(one.outward, axis=0) + TINY) for one in contacts])
    apart = np.hypot(*((centres - np.median(centres, axis=0)) / (radii + TINY)).T)
    return bool(np.median(apart) > 1.0)


def contacts_in(frames: Sequence[Bytes], reference: Reference, torn: TearCheck) -> list[Contact]:
    """Return the readable contacts of rectified frames (H, W, 3) that are not torn."""
    change, rng, contacts = ColourChange(reference), np.random.default_rng(0), []
    for rgb in frames:
        with suppress(InputError):
            frame = change.take(rgb)
            contacts.append(None if torn(frame) else contact_of(frame.changes, frame.valid, rng))
    return [one for one in contacts if one is not None]


def scale_warning(method: CalibratedMethod, *, kind: str) -> str:
    """Return the expected accuracy of a method from contacts alone."""
    told = method.card.other
    count, network = told["contacts"], told["scale_of"] != "a usual light"
    doubt = (
        f"the scale is that of a usual {kind}, at times 40 % off"
        if network
        else "the scale may be off by a factor of two or three"
    )
    few_off = FEW_OFF_WITH_NETWORK_DEG if network else FEW_OFF_DEG
    few = f"; so few have slopes {few_off} degrees off on real frames" if count < MIN_CONTACTS else ""
    contacts = "1 contact" if count == 1 else f"{count} contacts"
    contrary = (
        f". They contradict the ready network for {kind}, which was set aside: is the picture mirrored or turned, "
        "red changed for blue, or the gel touched in its reference?"
        if told["network_contradicted"]
        else ""
    )
    what = f"no ball presses: the light is calibrated on {contacts} in the frames"
    return f"{what}{few}; of their depth {doubt}{contrary}"
