"""Choose the next measurements: presses and manual checks that distinguish candidate effects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.diagnosis.refit import CANNOT_FIT, Candidate
from calibration.diagnosis.unexplained import Unexplained
from calibration.effects import EFFECTS
from calibration.fit.least_squares import Fit, Problem, linearise
from calibration.fit.outlying_presses import OutlyingPresses
from calibration.inputs.observations import TYPICAL_GAIN, TYPICAL_ZERO_MM, Observations, Presses, join
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import Effect, ManualCheck
from calibration.noise.model import Whitener
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Indenter

# Presses that would distinguish two candidates, and how many minutes they take.
#
# The candidates' forces are computed for the presses of each action at the fitted values; the benefit is the
# separation d of the presses so far and these together:
#     d = min over the rival's and the law's parameters of |L^-1 (f_i - f_j)|,    linear about the fit.

SAMPLES = 17  # of a forecast ramp


@dataclass(frozen=True, slots=True)
class NextMeasurement:
    """An action, its duration in minutes, and the expected separation in std."""

    action: str
    minutes: float
    separation_sigma: float

    def as_json(self) -> dict[str, Any]:
        """Return one entry of measure_next."""
        return {"action": self.action, "minutes": self.minutes, "expected_separation_sigma": self.separation_sigma}


@dataclass(frozen=True, slots=True)
class Action:
    """Presses that could be made; `change` derives them from the data."""

    name: str
    minutes: float
    change: Callable[[Observations], Observations]


def measure_next(base: Fit, one: Candidate, *, rivals: Sequence[Candidate]) -> tuple[NextMeasurement, ...]:
    """Return the actions, best separation a minute first; the separation is from the nearest rival."""
    found = []
    for action in actions(base.data):
        try:
            extra = action.change(base.data)
            least = min((_separation(base, one, rival, extra) for rival in rivals), default=0.0)
        except CANNOT_FIT:  # this action cannot be computed for these effects
            continue
        found.append(NextMeasurement(action.name, action.minutes, least))
    return tuple(sorted(found, key=lambda n: -n.separation_sigma / n.minutes))


def actions(data: Observations) -> tuple[Action, ...]:
    """Return the actions that this rig allows."""
    radius = float(np.median(data.presses.radius_mm))
    speed = float(np.nanmedian(data.presses.speed_mm_s)) if np.isfinite(data.presses.speed_mm_s).any() else 0.2
    return (
        Action("press with two more radii (x .6 and x 1.4)", 15.0,
               lambda d: join(_presses(d, radius=0.6 * radius), _presses(d, radius=1.4 * radius))),
        Action("press ten times slower and ten times faster", 8.0,
               lambda d: join(_presses(d, speed=speed / 10), _presses(d, speed=speed * 10))),
        Action("hold a press for 25 s", 3.0, lambda d: _presses(d, speed=speed, hold_s=25.0)),
        Action("press at +-6 mm in x and y", 10.0, lambda d: join(*[
            _presses(d, place=place) for place in ((6.0, 0.0), (-6.0, 0.0), (0.0, 6.0), (0.0, -6.0))])),
        Action("vary the waits from 3 s to 10 min", 25.0,
               lambda d: join(*[_presses(d, rest_s=rest) for rest in (3.0, 30.0, 600.0)])),
        Action("unload slowly until the punch lets go", 4.0, lambda d: _presses(d, speed=speed, unload=True)),
        Action("record air before the first touch", 3.0, lambda d: _presses(d, air=True)),
        Action("repeat the presses in a month", 10.0, lambda d: _presses(d, later_days=30.0)),
    )  # fmt: skip


def _presses(
    data: Observations,
    *,
    radius: float | None = None,
    speed: float | None = None,
    hold_s: float = 0.0,
    place: tuple[float, float] | None = None,
    rest_s: float = 60.0,
    unload: bool = False,
    air: bool = False,
    later_days: float = 0.0,
) -> Observations:
    """Return three presses after the last one, to its largest depth."""
    rate = speed or 0.2
    top = float(np.max(data.depth_mm))
    depth = np.linspace(-0.1 if air else 0.05 * top, top, SAMPLES)
    time = (depth - depth[0]) / rate
    phase = ["load"] * SAMPLES
    if hold_s:
        depth, time = np.append(depth, np.full(12, top)), np.append(time, time[-1] + np.geomspace(0.1, hold_s, 12))
        phase += ["hold"] * 12
    if unload:
        down = np.linspace(0.95 * top, -0.1, SAMPLES)
        depth, time = np.append(depth, down), np.append(time, time[-1] + (top - down) / rate)
        phase += ["unload"] * SAMPLES
    start = (float(np.nanmax(data.time_s)) if np.isfinite(data.time_s).any() else 0.0) + 86400 * later_days
    begins = start + rest_s + np.arange(3) * (rest_s + float(time[-1]))
    kind = replace(data.indenters[0], name=f"next {radius or ''}", radius_mm=radius or data.indenters[0].radius_mm)
    one = data.presses.take(np.zeros(3, dtype=np.int64))
    x, y = place or (float(np.nan_to_num(one.x_mm[0])), float(np.nan_to_num(one.y_mm[0])))
    presses = replace(
        one,
        label=tuple(f"next{k}" for k in range(3)),
        indenter=np.zeros(3, dtype=np.int64),
        radius_mm=np.full(3, kind.radius_mm),
        x_mm=np.full(3, x),
        y_mm=np.full(3, y),
        rest_s=np.full(3, rest_s),
        speed_mm_s=np.full(3, rate),
        day=begins / 86400,
        order=data.count + np.arange(3.0),
    )
    return _observations(data, kind, presses, np.asarray(begins, dtype=float), (depth, time, phase))


def _observations(
    data: Observations, kind: Indenter, presses: Presses, begins: Floats, path: tuple[Floats, Floats, list[str]]
) -> Observations:
    depth, time, phase = path
    count = len(begins)
    size = count * depth.size
    return replace(
        data,
        indenters=(kind,),
        presses=presses,
        press=np.repeat(np.arange(count), depth.size),
        time_s=np.concatenate([begin + time for begin in begins]),
        depth_mm=np.tile(depth, count),
        force_N=np.zeros((size, 3)),
        phase=np.array(phase * count),
        temperature_C=np.full(size, float(np.median(data.temperature_C))),
        depth_std_mm=np.full(size, float(np.median(data.depth_std_mm))),
        force_std_N=np.full(size, float(np.median(data.force_std_N))),
        reconstructed_mm=None,
        reconstructed_std_mm=None,
    )


def _separation(base: Fit, one: Candidate, rival: Candidate, extra: Observations) -> float:
    """Return the separation by the presses so far and these, each candidate linearised about its own fit."""
    data = join(base.data, extra)
    f_one, _ = _force(one.model, one.values, base.data, data)
    model = rival.model
    f_rival, values = _force(model, rival.values, base.data, data)
    about, _ = linearise(model, values, data=data)
    if not base.noise.stated:
        about = replace(about, base_N=np.ones(data.size))
    noise = base.noise
    if not (data.is_curves and noise.gain):
        noise = replace(noise, gain=TYPICAL_GAIN, zero_mm=TYPICAL_ZERO_MM)
    problem = Problem(model, data, model.parameters(data), Whitener(data, noise, about))
    jacobian = problem.whitener.apply(problem.jacobian(values)[:, problem.free])
    gap = problem.whitener.apply(f_one - f_rival)
    q, _ = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12))
    return float(np.linalg.norm(gap - q @ (q.T @ gap)))


def _force(model: Model, values: Floats, old: Observations, data: Observations) -> tuple[Floats, Floats]:
    """Return the force on more presses than were fitted; a new radius has beta and bend of the nearest one."""
    had, has = np.unique(old.presses.radius_mm), np.unique(data.presses.radius_mm)
    nearest = [int(np.argmin(np.abs(had - radius))) for radius in has]
    end = len(model.law.parameters(old))
    start = end - had.size * (2 if model.law.bent else 1) if isinstance(model.law, FlatPunch) else end - had.size
    each = values[start:end].reshape(-1, had.size)[:, nearest]
    longer = np.concatenate([values[:start], each.ravel(), values[end:]])
    return model.predict(longer, data), longer


# Manual checks: direct measurements of one effect without many presses.
#
# A check that measures an amplitude a to `std` distinguishes it from none by a/std. For effects that these data
# cannot show, the check that removes most of E's possible bias in a minute comes first. An unexplained residual is
# followed by the covariates that it depends on.

NAN = float("nan")
MIN_BIAS = 0.002  # of E: below it no check is proposed
_OTHER_PUNCH = ManualCheck(
    "press the same depths with a punch of another radius: does it follow depth or force?", 10.0
)
FOLLOW: Mapping[str, ManualCheck] = {
    **dict.fromkeys(("w", "w/h", "1/w", "P"), _OTHER_PUNCH),
    "t": ManualCheck("leave a dead weight on the force sensor for a minute: does its reading creep?", 3.0),
    "load/unload": ManualCheck("go down and up in steps, and wait at each: do the two ways meet?", 5.0),
    "scatter while loading": ManualCheck("wet the punch with soapy water: does the force still jump?", 5.0),
    "log rate": ManualCheck("repeat one press at five speeds", 8.0),
    "wait": ManualCheck("vary the waits from 3 s to 10 min", 25.0),
    "T": ManualCheck("press once with the gel five degrees warmer", 30.0),
    **dict.fromkeys(
        ("x", "y", "azimuth"), ManualCheck("turn the gel by 90 degrees: does it turn with the gel?", 10.0)
    ),
    **dict.fromkeys(("Fx", "Fy"), ManualCheck("turn the force sensor by 90 degrees and press again", 10.0)),
    **dict.fromkeys(("a", "indenter"), ManualCheck("measure each indenter's face and edge", 10.0)),
    **dict.fromkeys(
        ("order", "recording date"), ManualCheck("repeat the first press: is it still the same?", 3.0)
    ),
}


def check_of(effect: Effect) -> ManualCheck | None:
    """Return the manual check that the effect states."""
    return getattr(effect, "check", None)


def of_candidates(group: Sequence[Candidate]) -> list[NextMeasurement]:
    """Return checks of the candidates of a set, each with the separation of the fitted amplitude from none."""
    found = []
    for one in group:
        check = check_of(one.effect)
        if check is not None and np.isfinite(check.std):
            size = abs(float(one.own_values[0]) - one.effect.parameters[0].default)
            found.append(NextMeasurement(check.action, check.minutes, size / check.std))
    return found


def of_left(covariates: Iterable[str]) -> list[NextMeasurement]:
    """Return checks for a residual that depends on these covariates, the most significant first."""
    checks = dict.fromkeys(FOLLOW[name] for name in covariates if name in FOLLOW)
    return [NextMeasurement(check.action, check.minutes, NAN) for check in checks]


def of_hidden(bias: Mapping[str, float]) -> list[NextMeasurement]:
    """Return checks of effects that these data cannot show, most bias of E removed in a minute first."""
    checks = {key: check_of(EFFECTS[key]) for key in bias if key in EFFECTS}
    worth = {check: abs(bias[key]) for key, check in checks.items() if check and abs(bias[key]) > MIN_BIAS}
    ranked = sorted(worth, key=lambda check: -worth[check] / check.minutes)
    return [NextMeasurement(check.action, check.minutes, NAN) for check in ranked]


# The plan: presses that distinguish candidates, and checks of the residual.

WORTH = 0.5  # std: least separation of an action that is proposed
MAX_SIGMA = 10  # std: a larger separation counts as this one


def plan_next(
    base: Fit,
    sets: Sequence[Sequence[tuple[Candidate, ...]]],
    *,
    odd: OutlyingPresses,
    left: Unexplained | None,
    instead: Sequence[Candidate],
    bias: Mapping[str, float],
) -> tuple[NextMeasurement, ...]:
    """Return what to do: odd presses, then checks of the residual, candidates, then effects not detectable.

    `sets`: for each search, the candidates of each step; `instead`: those of a beta out of theory.
    """
    open_sets = [group for one in sets for group in one]
    if not open_sets and instead:
        open_sets = [tuple(instead)]
    plans = [plan for group in open_sets for plan in of_candidates(group)]
    for group in sets[0] or ([tuple(instead)] if instead else []):  # of forces: a picture is no press
        if len(group) > 1:
            plans += measure_next(base, group[0], rivals=group[1:])
            break
    worth = [plan for plan in plans if plan.separation_sigma > WORTH]
    worth.sort(key=lambda plan: -min(plan.separation_sigma, MAX_SIGMA) / plan.minutes)
    follow = of_left(left.covariates) if left is not None else []
    found = [*press_again(odd), *follow, *worth, *of_hidden(bias)]
    return tuple({plan.action: plan for plan in reversed(found)}.values())[::-1]


def press_again(odd: OutlyingPresses) -> tuple[NextMeasurement, ...]:
    """Return the repetition of presses that are unlike the others."""
    if odd.presses:
        names = ", ".join(odd.presses)
        action, minutes = f"press {names} again: the same indenter at the same place", 2.0 * len(odd.presses)
    elif odd.wanders:
        action, minutes = "repeat the first press after the last one: is it still the same?", 3.0
    else:
        return ()
    return (NextMeasurement(action, minutes, float("nan")),)
