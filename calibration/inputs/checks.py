"""Check that measurements are fit for a contact law; each fault has its own message.

A press whose samples all equal those of another, but for their times, is a copy: counted as a repeat, it would
make presses scatter less than they do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from calibration.inputs.denoised_depth import BRANCHES, after_deepest, branches, nominal_depth
from calibration.inputs.depth_path import in_phase, with_one_clock
from calibration.inputs.observations import TYPICAL_FORCE_N, TYPICAL_ZERO_MM, Observations
from tactilevision.errors import InputError
from tactilevision.recording.layout import some
from tactilevision.records.constants import KILO, NU_MAX
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Indenter
from tactilevision.robust import mad_std

MIN_SAMPLES = 5  # of a copied press: fewer may be equal by rounding
SLOWEST_MM_S = 5e-4  # mm/s: stages press a hundred times as fast, and motors stick below
NEARLY_IN = 0.9  # of the largest depth, which noise may put at the end of a hold
WHOLE_WAY = 0.5  # of the largest depth: a press that begins deeper has no speed of loading
OFF = (100, 10000)  # stated speed over that of the depths, where times are in ms
MIN_AIR = 5  # samples of air in loading that determine the scatter of forces
PULL_SIGMA = 4  # std of the forces in air below which a reading is tensile
KEPT = 8  # data sets whose level is cached: a fit asks at every step
TOUCH = 3  # std of a press zero
HIDDEN = 1 / 3  # of a force's noise: a smaller shift adds a twentieth to it
MIN_PULLING_SHARE = 0.1  # of the samples just above the touch in unloading: more are tensile by adhesion only
LOADED = 0.5  # of the largest force relative to air, from which the punch is in the gel
NEAR_TOUCH = 0.1  # share of the samples nearest to depth 0, whose force is about that of air
SAME_DEPTH = 0.02  # of the largest depth: closer depths count as one
CHECK_SIGN = "Depth is positive into the gel: check its sign."


def without_copies(data: Observations) -> Observations:
    """Return curves without presses that are copies of earlier ones; a warning names each.

    A point that equals an earlier one stays, since rounded numbers may agree; a warning names it.
    """
    first: dict[bytes, int] = {}
    samples = np.column_stack([data.depth_mm, data.normal_N, *([] if data.is_curves else [data.radius_mm])])
    copies: dict[int, int] = {}
    for k, one in enumerate(data.spans):
        if not data.is_curves or one.stop - one.start >= MIN_SAMPLES:
            earlier = first.setdefault(samples[one].tobytes(), k)
            copies |= {k: earlier} if earlier != k else {}
    named = [(_named(data, k), _named(data, earlier)) for k, earlier in copies.items()]
    if named and not data.is_curves:
        pairs = some([f"{one} of {other}" for one, other in named])
        return data.warned(f"presses with the same depth and force as another, copies unless by rounding: {pairs}")
    said = [f"press {one} has the samples of press {other}: excluded" for one, other in named]
    return data.take(~np.isin(np.arange(data.count), list(copies))).warned(*said) if said else data


def check_times(data: Observations) -> None:
    """Raise InputError where depths grow so slowly that times must be in ms: by the stated speed, or by far."""
    if not data.is_timed:
        return
    seen, stated = (_median(column) for column in np.reshape(list(_speeds(data)), (-1, 2)).T)
    if OFF[0] < stated / seen < OFF[1] or seen < SLOWEST_MM_S:
        raise InputError(
            "presses go deeper too slowly for times in seconds",
            where="time_s",
            value=f"{KILO * seen:.2g} um/s",
            remedy="Times are in s: are these in ms? Divide them by 1000.",
        )


def _speeds(data: Observations) -> Iterator[tuple[float, float]]:
    """Yield the speed of loading of each press and the stated one; none for a press that begins half way in."""
    for k, one in enumerate(data.spans):
        depth, deepest = data.depth_mm[one], float(np.max(data.depth_mm[one]))
        top = int(np.argmax(depth >= NEARLY_IN * deepest))
        time, way = data.time_s[one.start + top] - data.time_s[one.start], depth[top] - depth[0]
        if time > 0 and way > WHOLE_WAY * max(deepest, 0.0):
            yield float(way / time), float(data.presses.speed_mm_s[k])


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else np.nan


def _named(data: Observations, press: int) -> str:
    label, number = data.presses.label[press], int(data.presses.recording[press])
    return label if len(data.recordings) == 1 else f"{label} of {data.recordings[number]}"


@lru_cache(maxsize=KEPT)
def pull_level_N(data: Observations) -> float:
    """Return the force, N, below which a reading is tensile; NaN with too few samples of air in loading."""
    air = data.normal_N[~after_deepest(data) & (data.depth_mm < 0)]
    if air.size < MIN_AIR:
        return float("nan")
    return float(np.median(air) - PULL_SIGMA * max(mad_std(air), TYPICAL_FORCE_N))


def check(data: Observations, *, shape: str = "flat_cylinder", one_depth: bool = False) -> None:
    """Raise InputError for the first fault.

    Clocks that differ are no fault, though they make a force fall with depth or occur in air. `one_depth`: a
    single depth is no fault, since the law takes its curvature from theory.
    """

    def first(view: Observations) -> InputError | None:
        return next(faults(view, shape=shape, one_depth=one_depth), None)

    if (fault := first(data)) is not None:
        views = (view for view in (in_phase(data), with_one_clock(data)) if view is not data)
        if not any(first(view) is None for view in views):
            raise fault


def faults(data: Observations, *, shape: str, one_depth: bool = False) -> Iterator[InputError]:
    """Yield every fault of these data, the simplest first."""
    yield from _gel(data)
    for indenter in (data.indenters[k] for k in np.unique(data.presses.indenter)):
        yield from _indenter(data, indenter, shape)
    yield from _depths(data, one_depth=one_depth)
    yield from _forces(data, one_depth=one_depth)


def of_shape(data: Observations, shape: str = "flat_cylinder") -> Observations:
    """Return the presses of indenters of this shape, with a warning that names the others; all if none has it."""
    fits = np.array([data.indenters[k].shape == shape for k in data.presses.indenter])
    if fits.all() or not fits.any():
        return data
    others = sorted({data.indenters[k].name for k in data.presses.indenter[~fits]})
    return data.take(fits).warned(f"presses of {', '.join(others)} are excluded: this law is for a {shape}")


def _gel(data: Observations) -> Iterator[InputError]:
    gel = data.gel
    if not 0 < gel.thickness_mm < np.inf:
        yield InputError("the gel's thickness must be above 0 mm", where="[sensor.gel]", value=gel.thickness_mm)
    if gel.poisson_ratio is not None and not 0 <= gel.poisson_ratio < 0.5:
        yield InputError(
            "Poisson's ratio lies in [0, 0.5)",
            where="[sensor.gel]",
            value=gel.poisson_ratio,
            remedy=f"For an incompressible gel take {NU_MAX:g}.",
        )


def _indenter(data: Observations, indenter: Indenter, shape: str) -> Iterator[InputError]:
    where, radius = f"[indenter.{indenter.name}]", indenter.radius_mm
    if shape and indenter.shape != shape:
        yield InputError(
            f"this law is for a {shape}",
            where=where,
            value=indenter.shape,
            remedy="Exclude its presses; `calibrate` fits balls and cones where there is no flat cylinder.",
        )
    if shape != "cone" and not 0 < radius < np.inf:
        yield InputError("an indenter's radius must be above 0 mm", where=where, value=radius)
    half = half_width(data)
    if shape == "flat_cylinder" and half is not None and radius >= half:
        yield InputError(
            "the punch is as wide as the gel pad",
            where=where,
            value=radius,
            remedy=f"The pad reaches {half:g} mm from its centre.",
        )


def half_width(data: Observations) -> float | None:
    """Return the distance from the pad's centre to its nearest edge, mm; None where it is not stated."""
    if data.gel.shape == "disc":
        return data.gel.radius_mm
    if data.gel.shape == "rectangle" and data.gel.size_mm is not None:
        return min(data.gel.size_mm) / 2
    return None


def _depths(data: Observations, *, one_depth: bool) -> Iterator[InputError]:
    touching = data.phase != "free"
    depth = data.depth_mm
    yield from _not_above_0(data, depth, "a certified depth must be above 0 mm", "Depth is positive into the gel.")
    if not touching.any():
        yield InputError(
            "every sample has the phase free",
            value="phase = free",
            remedy="Name the phases load, hold and unload, or leave them empty.",
        )
        return
    if not (touching & (depth > 0)).any():
        yield InputError(
            "no sample lies in the gel",
            value=float(np.max(depth)),
            remedy=CHECK_SIGN,
        )
        return
    yield from _deepest(data)
    for radius in () if one_depth else np.unique(data.presses.radius_mm):
        mine = depth[touching & (data.radius_mm == radius)]
        if mine.size and np.ptp(mine) < SAME_DEPTH * np.max(mine):
            yield _of_one_depth(radius, mine)


def _deepest(data: Observations) -> Iterator[InputError]:
    depth, thickness_mm = data.depth_mm, data.gel.thickness_mm
    k = int(np.argmax(depth))
    if depth[k] > thickness_mm:
        remedy = f"The gel is {thickness_mm:g} mm thick; depths are in mm."
        yield _of_sample(data, k, depth, "a depth is larger than the gel is thick", remedy)
    if depth[k] < TYPICAL_ZERO_MM:
        what = "the deepest press is no deeper than the uncertainty of a depth's zero"
        upwards = depth.min() < -TYPICAL_ZERO_MM
        remedy = CHECK_SIGN if upwards else "Depths are in mm: are these in metres?"
        yield _of_sample(data, k, depth, what, remedy)


def _forces(data: Observations, *, one_depth: bool) -> Iterator[InputError]:
    force = data.normal_N
    what = "the normal force of a certified point must be above 0 N"
    yield from _not_above_0(data, force, what, "fz_N is positive when the indenter pushes.")
    if np.ptp(force) <= 0 and data.size > 1:
        yield InputError("the force never changes", value=float(force[0]), remedy="Check the force's column.")
    near = np.abs(data.depth_mm)
    air_N = np.median(force[near <= np.quantile(near, NEAR_TOUCH)])  # not 0 without taring
    above = np.abs(force - air_N)
    pressed = data.depth_mm[above >= LOADED * np.max(above)]
    if np.median(pressed) <= 0:
        yield InputError(
            "the largest forces occur at depths of 0 or less",
            value=float(np.median(pressed)),
            remedy="Depth is positive into the gel: check its sign and its zero, or tare the force.",
        )
    for radius, fallen in () if one_depth else _falling(data):
        if np.ptp(fallen) < 2 * TOUCH * TYPICAL_ZERO_MM:  # within the zeros' scatter it is one depth
            yield _of_one_depth(radius, fallen)
        yield InputError(
            "the force falls as the depth grows",
            where=f"radius {radius:g} mm",
            remedy="Check the sign of fz_N, and that depth and force match.",
        )


def _falling(data: Observations) -> Iterator[tuple[float, Floats]]:
    """Yield each radius whose force falls with depth in the gel, with these depths."""
    for radius in np.unique(data.presses.radius_mm):
        mine = (data.phase != "free") & (data.radius_mm == radius) & (data.depth_mm > 0)
        depth, force = data.depth_mm[mine], data.normal_N[mine]
        if depth.size > 1 and np.sum((depth - depth.mean()) * (force - force.mean())) < 0:
            yield float(radius), depth


def _of_one_depth(radius_mm: float, depth_mm: Floats) -> InputError:
    return InputError(
        "all presses of one radius have one depth, which does not determine both stiffness and curvature",
        where=f"radius {radius_mm:g} mm",
        value=float(np.median(depth_mm)),
        remedy="Press to two depths at least, one twice the other.",
    )


def _not_above_0(data: Observations, values: Floats, what: str, remedy: str) -> Iterator[InputError]:
    """Yield a fault of the first certified point whose value is not above 0."""
    if not data.is_curves and (values <= 0).any():
        yield _of_sample(data, int(np.argmax(values <= 0)), values, what, remedy)


def _of_sample(data: Observations, k: int, values: Floats, what: str, remedy: str) -> InputError:
    """Return the fault of the k-th of the values (N,), which names its press."""
    press = data.presses.label[int(data.press[k])]
    return InputError(what, where=f"press {press}", value=float(values[k]), remedy=remedy)


def usable(data: Observations, shape: str = "flat_cylinder") -> Observations:
    """Return the data that a law can be fitted to: presses of this shape, of radii pressed to several depths.

    Phases that were not recorded are taken from the depth. Warnings name what is excluded and what is missing.
    Raises InputError where nothing can be fitted.
    """
    any_shape = data.resultants is not None  # the picture shows the contact's shape
    kept = without_copies(data) if any_shape else of_several_depths(without_copies(of_shape(data, shape)))
    check(kept, shape="" if any_shape else shape, one_depth=any_shape)
    check_times(kept)
    return replace(kept, phase=np.array(BRANCHES)[branches(kept)]).warned(*lacks(kept))


def of_several_depths(data: Observations) -> Observations:
    """Return the data without radii pressed to one depth, where others have several; a warning names them."""
    radii = np.unique(data.presses.radius_mm)
    single = [r for r in radii if _one_depth(data, float(r))]
    if not 0 < len(single) < radii.size:
        return data
    named = ", ".join(f"{r:g} mm" for r in single)
    warning = f"presses of radius {named} are excluded: one depth does not determine stiffness and curvature"
    return data.take(~np.isin(data.presses.radius_mm, single)).warned(warning)


def clear_of_touch(
    data: Observations, *, zero_mm: float = 0.0, noise_mm: float = 0.0, force_noise_mm: Floats | None = None
) -> Observations:
    """Return curves without the samples within three std of a press zero of the first touch.

    Near the touch a zero changes the force of one press and not of the next. A press keeps its deeper half in any
    case, and its unloading where the forces there are tensile by adhesion. `zero_mm` and `noise_mm`: std of
    presses' zeros and of a depth reading, where known; a depth then counts by the lesser of its reading and its
    nominal depth. `force_noise_mm` (N,): std of a force over its press's slope; a sample in air also stays where
    this noise exceeds the effect of zeros on its force, k max(z - d, 0).
    """
    if not data.is_curves:
        return data
    std = np.hypot(max(TYPICAL_ZERO_MM, zero_mm), np.maximum(np.nan_to_num(data.depth_std_mm), noise_mm))
    depth = np.abs(data.depth_mm)
    near = np.minimum(TOUCH * std, np.maximum.reduceat(depth, data.first)[data.press] / 2)
    depth = np.minimum(depth, np.abs(nominal_depth(data))) if zero_mm else depth
    clear = depth > near
    if force_noise_mm is not None:
        clear |= (data.depth_mm < 0) & (_moved_mm(depth, std) < HIDDEN * force_noise_mm)
    clear |= _adhering(data, clear)
    kept = np.bincount(data.press, clear, minlength=data.count) > 0
    return data if clear.all() or not kept.all() else data.samples(clear)


def _moved_mm(distance_mm: Floats, zero_mm: Floats) -> Floats:
    """Return the rms (N,) of max(z - d, 0) for normal zeros z of this std, at distances d from the touch."""
    t = distance_mm / zero_mm
    square = (1 + t**2) * ndtr(-t) - t * np.exp(-(t**2) / 2) / np.sqrt(2 * np.pi)
    return np.asarray(zero_mm * np.sqrt(np.maximum(square, 0.0)))


def _adhering(data: Observations, clear: Bools) -> Bools:
    """Return the samples (N,) near the touch in unloading; none unless many are tensile."""
    near = after_deepest(data) & ~clear
    pulls = data.normal_N[near & (data.depth_mm < 0)] < pull_level_N(data)
    return near & bool(pulls.size and np.mean(pulls) > MIN_PULLING_SHARE)


def lacks(data: Observations) -> Iterator[str]:
    """Yield a sentence for each thing that an analysis would use and these measurements do not have."""
    from calibration.inputs.conditions import repeat_groups

    if data.count == 1:
        yield "there is one press: the scatter between presses is assumed, not measured"
    elif np.unique(repeat_groups(data)).size == data.count and data.is_curves:
        yield "no press repeats another (same punch, similar speed): their scatter is assumed, not measured"
    sizes = np.bincount(data.press)
    single = np.flatnonzero(sizes == 1)
    if data.is_curves and single.size:
        names = ", ".join(data.presses.label[k] for k in single[:5])
        yield f"{single.size} presses have one sample each ({names}): they show no course in time"
    begin, end = data.time_s[data.first], data.time_s[np.append(data.first[1:], data.size) - 1]
    late = np.flatnonzero(begin[1:] < np.maximum.accumulate(end)[:-1])
    if late.size:
        pair = " and ".join(data.presses.label[k] for k in (late[0], late[0] + 1))
        yield f"{late.size} presses begin before another ends ({pair}): the waits between them are not known"


def at_one_depth(data: Observations) -> bool:
    """Return whether the points of each radius have one depth within their zeros' scatter: a secant alone."""
    radii = np.unique(data.presses.radius_mm)
    stated = data.depth_std_mm[np.isfinite(data.depth_std_mm)]
    scatter = 2 * TOUCH * (float(np.median(stated)) if stated.size else TYPICAL_ZERO_MM)
    return not data.is_curves and all(_one_depth(data, float(radius), scatter) for radius in radii)


def _one_depth(data: Observations, radius_mm: float, scatter_mm: float = 0.0) -> bool:
    mine = (data.phase != "free") & (data.radius_mm == radius_mm)
    depth = data.depth_mm[mine]
    return bool(depth.size and np.ptp(depth) < max(SAME_DEPTH * np.max(depth), scatter_mm))
