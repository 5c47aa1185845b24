"""Check that measurements are fit for a contact law; each fault has its own message."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from scipy.special import ndtr

from calibration.inputs.denoised_depth import BRANCHES, after_deepest, branches, nominal_depth
from calibration.inputs.depth_path import in_phase, with_one_clock
from calibration.inputs.observations import TYPICAL_FORCE_N, TYPICAL_ZERO_MM, Observations
from tactilevision.errors import InputError
from tactilevision.recording.layout import some
from tactilevision.records.measured import Bools, Floats
from tactilevision.records.rig import Indenter
from tactilevision.robust import mad_std

# Presses that are no measurements of their own, and times in another unit.
#
# A press whose samples are all those of another one, but for its times, was copied: in a table, or from another
# recording. Two presses differ by their noise. As a repeat it would claim that presses scatter less than they do.

MIN_SAMPLES = 5  # of a press: fewer may be equal by rounding
SLOWEST_MM_S = 5e-4  # mm/s: motion stages press a hundred times as fast, and motors stick below
NEARLY_IN = 0.9  # of the largest depth: the rest may be a hold, which noise makes deeper at its end
WHOLE_WAY = 0.5  # of the largest depth: presses begin in air, so that the way in is longer
OFF = (100.0, 10000.0)  # times: a stated speed over the one that depths show, where times are in ms


def without_copies(data: Observations) -> Observations:
    """Curves without presses that are copies of earlier ones; a warning names each.

    A point that equals an earlier one stays, since rounded numbers may agree: a warning names it.
    """
    if not data.is_curves:
        return _with_equal_points_named(data)
    first: dict[bytes, int] = {}
    keep, said = np.ones(data.count, bool), []
    for k, (start, end) in enumerate(_spans(data)):
        if end - start < MIN_SAMPLES:
            continue
        samples = np.column_stack([data.depth_mm[start:end], data.normal_N[start:end]]).tobytes()
        if samples in first:
            keep[k] = False
            said.append(
                f"press {_named(data, k)} has the samples of press {_named(data, first[samples])}: left out"
            )
        first.setdefault(samples, k)
    return data if keep.all() else replace(data.take(keep), warnings=(*data.warnings, *said))


def _with_equal_points_named(data: Observations) -> Observations:
    first: dict[tuple[float, ...], int] = {}
    said = []
    numbers = np.column_stack([data.presses.radius_mm[data.press], data.depth_mm, data.normal_N]).tolist()
    for k, point in zip(data.press.tolist(), numbers, strict=True):
        earlier = first.setdefault(tuple(point), k)
        if earlier != k:
            said.append(f"{_named(data, k)} of {_named(data, earlier)}")
    if not said:
        return data
    warning = f"presses with the very depth and force of another, copies if not rounded alike: {some(said)}"
    return replace(data, warnings=(*data.warnings, warning))


def check_times(data: Observations) -> None:
    """Raise InputError where depths grow so slowly that times are in ms: beside the stated speed, or by far."""
    if not data.is_curves:
        return
    seen, stated = (_median(column) for column in np.reshape(list(_speeds(data)), (-1, 2)).T)
    if OFF[0] < stated / seen < OFF[1] or seen < SLOWEST_MM_S:
        raise InputError(
            "presses go deeper too slowly for times in seconds",
            where="time_s",
            value=f"{1e3 * seen:.2g} um/s",
            remedy="Times are in s: are these in ms? Divide them by 1000.",
        )


def _speeds(data: Observations) -> Iterator[tuple[float, float]]:
    """Of each press how fast its depth grows until it is nearly in, and the speed that is stated.

    A press that is caught deeper than half way in has no such speed: a clock may have cut the way short.
    """
    for k, (start, end) in enumerate(_spans(data)):
        depth, deepest = data.depth_mm[start:end], float(np.max(data.depth_mm[start:end]))
        top = int(np.argmax(depth >= NEARLY_IN * deepest))
        time, way = data.time_s[start + top] - data.time_s[start], depth[top] - depth[0]
        if time > 0 and way > WHOLE_WAY * max(deepest, 0.0):
            yield float(way / time), float(data.presses.speed_mm_s[k])


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else np.nan


def _spans(data: Observations) -> Iterator[tuple[int, int]]:
    return zip(data.first.tolist(), [*data.first[1:].tolist(), data.size], strict=True)


def _named(data: Observations, press: int) -> str:
    label, number = data.presses.label[press], int(data.presses.recording[press])
    return label if len(data.recordings) == 1 else f"{label} of {data.recordings[number]}"


# From which force on a reading pulls: so far below the forces of air no reading lies by chance.

MIN_AIR = 5  # samples of air on the way in: fewer do not tell how forces scatter there
PULL_SIGMA = 4.0  # std of them: a force that lies farther below is none of air
KEPT = 8  # data sets of which it is kept: a fit asks at every step


@lru_cache(maxsize=KEPT)
def pull_level_N(data: Observations) -> float:
    """The force, N, below which a reading pulls; NaN where too little air was read on the way in."""
    air = data.normal_N[~after_deepest(data) & (data.depth_mm < 0)]
    if air.size < MIN_AIR:
        return float("nan")
    return float(np.median(air) - PULL_SIGMA * max(mad_std(air), TYPICAL_FORCE_N))


# What measurements must satisfy before a contact law is fitted to them; each fault has its own sentence.

TOUCH = 3.0  # std of a press zero
HIDDEN = 1 / 3  # of a force's noise: what adds less to it adds a twentieth
MIN_PULLING_SHARE = 0.1  # of the samples just above the touch on the way out: so many pull only if a gel clings
LOADED = 0.5  # of the largest force above that of air, either way: from it on the punch stands in the gel
NEAR_TOUCH = 0.1  # of the samples, the nearest to depth 0: their force is about air's, whatever the depth's sign
SAME_DEPTH = 0.02  # depths closer than this share of the largest count as one


def check(data: Observations, *, shape: str = "flat_cylinder", one_depth: bool = False) -> None:
    """Raise InputError for the first fault found; return nothing where there is none.

    Clocks that lie far apart are no fault: they make a force fall, or come where the depth is none, whatever its
    sign. `one_depth`: a single depth is no fault, since the law takes its curvature from elsewhere.
    """
    first = partial(_first_fault, shape=shape, one_depth=one_depth)
    if (fault := first(data)) is None:
        return
    if not any(view is not data and first(view) is None for view in (in_phase(data), with_one_clock(data))):
        raise fault


def _first_fault(data: Observations, *, shape: str, one_depth: bool) -> InputError | None:
    return next(faults(data, shape=shape, one_depth=one_depth), None)


def faults(data: Observations, *, shape: str, one_depth: bool = False) -> Iterator[InputError]:
    """Every fault of these data, the plainest first."""
    yield from _gel(data)
    for indenter in (data.indenters[k] for k in np.unique(data.presses.indenter)):
        yield from _indenter(data, indenter, shape)
    yield from _depths(data, one_depth=one_depth)
    yield from _forces(data, one_depth=one_depth)


def of_shape(data: Observations, shape: str = "flat_cylinder") -> Observations:
    """The presses of indenters of this shape, with a warning that names the others; all where none has it."""
    fits = np.array([data.indenters[k].shape == shape for k in data.presses.indenter])
    if fits.all() or not fits.any():
        return data
    others = sorted({data.indenters[k].name for k in data.presses.indenter[~fits]})
    kept = data.take(fits)
    warning = f"presses of {', '.join(others)} are left out: this law is for a {shape}"
    return replace(kept, warnings=(*kept.warnings, warning))


def _gel(data: Observations) -> Iterator[InputError]:
    gel = data.gel
    if not (np.isfinite(gel.thickness_mm) and gel.thickness_mm > 0):
        yield InputError("the gel's thickness lies above 0 mm", where="[sensor.gel]", value=gel.thickness_mm)
    if gel.poisson_ratio is not None and not 0 <= gel.poisson_ratio < 0.5:
        yield InputError(
            "Poisson's ratio lies in [0, 0.5)",
            where="[sensor.gel]",
            value=gel.poisson_ratio,
            remedy="For an incompressible gel take 0.4999.",
        )


def _indenter(data: Observations, indenter: Indenter, shape: str) -> Iterator[InputError]:
    where, radius = f"[indenter.{indenter.name}]", indenter.radius_mm
    if indenter.shape != shape:
        yield InputError(
            f"this law is for a {shape}",
            where=where,
            value=indenter.shape,
            remedy="Leave its presses out; where there are no others, `calibrate` alone fits balls and cones.",
        )
    if shape != "cone" and not (np.isfinite(radius) and radius > 0):
        yield InputError("an indenter's radius lies above 0 mm", where=where, value=radius)
    half = _half_width(data)
    if shape == "flat_cylinder" and half is not None and radius >= half:
        yield InputError(
            "the punch is as wide as the gel pad",
            where=where,
            value=radius,
            remedy=f"The pad reaches {half:g} mm from its centre.",
        )


def _half_width(data: Observations) -> float | None:
    if data.gel.shape == "disc":
        return data.gel.radius_mm
    if data.gel.shape == "rectangle" and data.gel.size_mm is not None:
        return min(data.gel.size_mm) / 2
    return None


def _depths(data: Observations, *, one_depth: bool) -> Iterator[InputError]:
    touching = data.phase != "free"
    depth = data.depth_mm
    if not data.is_curves and (depth <= 0).any():
        k = int(np.flatnonzero(depth <= 0)[0])
        yield InputError(
            "a certified depth lies above 0 mm",
            where=_press(data, k),
            value=float(depth[k]),
            remedy="Depth is positive into the gel.",
        )
    if not touching.any():
        yield InputError(
            "every sample is called free",
            value="phase = free",
            remedy="Name the phases load, hold and unload, or leave them empty.",
        )
        return
    if not (touching & (depth > 0)).any():
        yield InputError(
            "no sample lies in the gel",
            value=float(np.max(depth)),
            remedy="Depth is positive into the gel: check its sign.",
        )
        return
    yield from _deepest(data)
    for radius in () if one_depth else np.unique(data.presses.radius_mm):
        mine = depth[touching & (data.radius_mm == radius)]
        if mine.size and np.ptp(mine) < SAME_DEPTH * np.max(mine):
            yield _of_one_depth(radius, mine)


def _deepest(data: Observations) -> Iterator[InputError]:
    depth = data.depth_mm
    k = int(np.argmax(depth))
    if depth[k] > data.gel.thickness_mm:
        yield InputError(
            "a depth is larger than the gel is thick",
            where=_press(data, k),
            value=float(depth[k]),
            remedy=f"The gel is {data.gel.thickness_mm:g} mm thick; depths are in mm.",
        )
    if depth[k] < TYPICAL_ZERO_MM:
        yield InputError(
            "the deepest press is no deeper than a depth's zero is known",
            where=_press(data, k),
            value=float(depth[k]),
            remedy="Depth is positive into the gel: check its sign."
            if depth.min() < -TYPICAL_ZERO_MM
            else "Depths are in mm: are these in metres?",
        )


def _forces(data: Observations, *, one_depth: bool) -> Iterator[InputError]:
    force = data.normal_N
    if not data.is_curves and (force <= 0).any():
        k = int(np.flatnonzero(force <= 0)[0])
        yield InputError(
            "the normal force of a certified point lies above 0 N",
            where=_press(data, k),
            value=float(force[k]),
            remedy="fz_N is positive when the indenter pushes.",
        )
    if np.ptp(force) <= 0 and data.size > 1:
        yield InputError("the force never changes", value=float(force[0]), remedy="Check the force's column.")
    near = np.abs(data.depth_mm)
    air_N = np.median(force[near <= np.quantile(near, NEAR_TOUCH)])  # other than 0 where it was not tared
    above = np.abs(force - air_N)
    pressed = data.depth_mm[above >= LOADED * np.max(above)]
    if np.median(pressed) <= 0:
        yield InputError(
            "the largest forces come where the depth is none",
            value=float(np.median(pressed)),
            remedy="Depth is positive into the gel: check its sign and its zero, or tare the force.",
        )
    for radius, fallen in () if one_depth else _falling(data):
        if np.ptp(fallen) < 2 * TOUCH * TYPICAL_ZERO_MM:  # three zeros either way: no depth of its own
            yield _of_one_depth(radius, fallen)
        yield InputError(
            "the force falls as the depth grows",
            where=f"radius {radius:g} mm",
            remedy="Check the sign of fz_N, and that depth and force match.",
        )


def _falling(data: Observations) -> Iterator[tuple[float, Floats]]:
    """Each radius whose force and depth go opposite ways in the gel, with these depths."""
    for radius in np.unique(data.presses.radius_mm):
        mine = (data.phase != "free") & (data.radius_mm == radius) & (data.depth_mm > 0)
        depth, force = data.depth_mm[mine], data.normal_N[mine]
        if depth.size > 1 and np.sum((depth - depth.mean()) * (force - force.mean())) < 0:
            yield float(radius), depth


def _of_one_depth(radius_mm: float, depth_mm: Floats) -> InputError:
    return InputError(
        "all presses of one radius have one depth, so stiffness and curvature cannot be told apart",
        where=f"radius {radius_mm:g} mm",
        value=float(np.median(depth_mm)),
        remedy="Press to two depths at least, one twice the other.",
    )


def _press(data: Observations, sample: int) -> str:
    return f"press {data.presses.label[int(data.press[sample])]}"


def usable(data: Observations, shape: str = "flat_cylinder") -> Observations:
    """What a law can be fitted to: presses of this shape, of radii pressed to more than one depth.

    Phases that nobody recorded are read from the depth. What is left out and what these measurements lack is said
    in the warnings. Raises InputError where nothing is left to fit.
    """
    kept = of_several_depths(without_copies(of_shape(data, shape)))
    check(kept, shape=shape)
    check_times(kept)
    phase = np.array(BRANCHES)[branches(kept)]
    return replace(kept, phase=phase, warnings=(*kept.warnings, *lacks(kept)))


def of_several_depths(data: Observations) -> Observations:
    """Without the presses of radii pressed to one depth, where others have several; a warning names them."""
    radii = np.unique(data.presses.radius_mm)
    single = [r for r in radii if _one_depth(data, float(r))]
    if not 0 < len(single) < radii.size:
        return data
    named = ", ".join(f"{r:g} mm" for r in single)
    warning = f"presses of radius {named} are left out: at one depth stiffness and curvature look alike"
    kept = data.take(~np.isin(data.presses.radius_mm, single))
    return replace(kept, warnings=(*kept.warnings, warning))


def clear_of_touch(
    data: Observations, *, zero_mm: float = 0.0, noise_mm: float = 0.0, force_noise_mm: Floats | None = None
) -> Observations:
    """Curves without the samples nearer to the first touch than three press zeros.

    They are air in one press and contact in the next: a zero moves no force on one side, all of it on the other.
    A press keeps its deeper half whatever they are.
    Where a gel clings it does so on both sides: the way out stays where its forces lie far below those of air.
    `zero_mm` and `noise_mm`: std of presses' zeros and of a depth's reading, where they are known; depths then
    count as read and as presses go alike. `force_noise_mm` (N,): std of a force, over its press's slope: in air a
    sample stays, too, where that hides what zeros move of its force, k max(z - d, 0).
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
    clear |= _clinging(data, clear)
    kept = np.bincount(data.press, clear, minlength=data.count) > 0
    return data if clear.all() or not kept.all() else data.samples(clear)


def _moved_mm(distance_mm: Floats, zero_mm: Floats) -> Floats:
    """Rms (N,) of max(z - d, 0), z normal zeros of this std: how deep samples so far off may be in the gel."""
    t = distance_mm / zero_mm
    square = (1 + t**2) * ndtr(-t) - t * np.exp(-(t**2) / 2) / np.sqrt(2 * np.pi)
    return np.asarray(zero_mm * np.sqrt(np.maximum(square, 0.0)))


def _clinging(data: Observations, clear: Bools) -> Bools:
    """The samples (N,) near the touch on the way out; none unless many pull, which no zero of a depth does."""
    near = after_deepest(data) & ~clear
    pulls = data.normal_N[near & (data.depth_mm < 0)] < pull_level_N(data)
    return near & bool(pulls.size and np.mean(pulls) > MIN_PULLING_SHARE)


def lacks(data: Observations) -> Iterator[str]:
    """A sentence for each thing that these measurements do not have and an analysis would use."""
    from calibration.inputs.conditions import repeat_groups

    if data.count == 1:
        yield "there is one press: how presses differ from each other is assumed, not measured"
    elif np.unique(repeat_groups(data)).size == data.count and data.is_curves:
        yield "no press repeats another (same punch, like speed): how repeats differ is assumed, not measured"
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
    """True where the points of each radius have one depth, be it a single point: they tell a secant, and no more.

    Depths that lie no further apart than their zeros scatter are one depth, too.
    """
    radii = np.unique(data.presses.radius_mm)
    stated = data.depth_std_mm[np.isfinite(data.depth_std_mm)]
    scatter = 2 * TOUCH * (float(np.median(stated)) if stated.size else TYPICAL_ZERO_MM)
    return not data.is_curves and all(_one_depth(data, float(radius), scatter) for radius in radii)


def _one_depth(data: Observations, radius_mm: float, scatter_mm: float = 0.0) -> bool:
    mine = (data.phase != "free") & (data.radius_mm == radius_mm)
    depth = data.depth_mm[mine]
    return bool(depth.size and np.ptp(depth) < max(SAME_DEPTH * np.max(depth), scatter_mm))
