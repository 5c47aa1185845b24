"""Choose the next measurements: presses and manual checks that distinguish candidate effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from typing import Any

import numpy as np

from calibration.diagnosis.covariates import IN_WORDS
from calibration.diagnosis.press_contrast import PressContrast
from calibration.diagnosis.refit import CANNOT_FIT, Candidate
from calibration.diagnosis.score_test import SCATTER
from calibration.diagnosis.unexplained import Unexplained
from calibration.effects import EFFECTS
from calibration.fit.least_squares import Fit, Problem, linearise, unexplained
from calibration.fit.outlying_presses import OutlyingPresses
from calibration.inputs.observations import DAY_S, TYPICAL_GAIN, TYPICAL_ZERO_MM, Observations, join
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import ManualCheck
from calibration.noise.model import Whitener
from tactilevision.records.measured import Floats, Pair

# Presses that would distinguish two candidates, and how many minutes they take.
#
# The candidates' forces are computed for the presses of each action at the fitted values; the benefit is the
# separation d of the presses so far and these together:
#     d = min over the rival's and the law's parameters of |L^-1 (f_i - f_j)|,    linear about the fit.

SAMPLES = 17  # of a forecast ramp
COUNT = 3  # presses of a kind
USUAL_SPEED_MM_S = 0.2  # where none was recorded


@dataclass(frozen=True, slots=True)
class NextMeasurement:
    """What to do, its minutes, the expected separation in std, the candidates that it separates, and why."""

    what: str
    minutes: float
    separation_sigma: float = nan
    separates: str = ""
    why: str = ""

    @property
    def action(self) -> str:
        """What to do, with the candidates that it separates."""
        return f"{self.separates}: {self.what}" if self.separates else self.what

    def as_json(self) -> dict[str, Any]:
        """Return one entry of measure_next."""
        sigma = {"expected_separation_sigma": self.separation_sigma}
        return {"action": self.action, "minutes": self.minutes, **sigma, "why": self.why}


def measure_next(base: Fit, one: Candidate, *, rivals: Sequence[Candidate]) -> tuple[NextMeasurement, ...]:
    """Return the actions, best separation a minute first; the separation is from the nearest rival."""
    found = []
    for name, minutes, kinds in actions(base.data):
        try:
            extra = join(*(_presses(base.data, **kind) for kind in kinds))
            least = min((_separation(base, one, rival, extra) for rival in rivals), default=0.0)
        except CANNOT_FIT:  # this action cannot be computed for these effects
            continue
        found.append(NextMeasurement(name, minutes, least))
    return tuple(sorted(found, key=lambda n: -n.separation_sigma / n.minutes))


def actions(data: Observations) -> tuple[tuple[str, float, list[dict[str, Any]]], ...]:
    """Return the actions that this rig allows: words, minutes, and the kinds of presses (see `_presses`).

    None for resultants of pictures, which are known for contacts that were seen alone.
    """
    if data.resultants is not None:
        return ()
    radius = float(np.median(data.presses.radius_mm))
    speeds = data.presses.speed_mm_s[np.isfinite(data.presses.speed_mm_s)]
    speed = float(np.median(speeds)) if speeds.size else USUAL_SPEED_MM_S
    places = ((6, 0), (-6, 0), (0, 6), (0, -6))
    return (
        ("press with two more radii (x .6 and x 1.4)", 15, [{"radius": 0.6 * radius}, {"radius": 1.4 * radius}]),
        (
            "hold presses with two more radii (x .6 and x 1.4) for 25 s",
            18,
            [{"radius": share * radius, "speed": speed, "hold_s": 25} for share in (0.6, 1.4)],
        ),
        ("press ten times slower and ten times faster", 8, [{"speed": speed / 10}, {"speed": speed * 10}]),
        ("hold a press for 25 s", 3, [{"speed": speed, "hold_s": 25}]),
        ("press at +-6 mm in x and y", 10, [{"place": place} for place in places]),
        ("vary the waits from 3 s to 10 min", 25, [{"rest_s": rest} for rest in (3, 30, 600)]),
        ("unload slowly until the punch lets go", 4, [{"speed": speed, "unload": True}]),
        ("record air before the first touch", 3, [{"air": True}]),
        ("repeat the presses in a month", 10, [{"later_days": 30}]),
    )


def _presses(
    data: Observations,
    *,
    radius: float | None = None,
    speed: float = USUAL_SPEED_MM_S,
    hold_s: float = 0.0,
    place: Pair | None = None,
    rest_s: float = 60,
    unload: bool = False,
    air: bool = False,
    later_days: float = 0.0,
) -> Observations:
    """Return COUNT presses after the last one, to its largest depth."""
    top = float(np.max(data.depth_mm))
    depth = np.linspace(-0.1 if air else 0.05 * top, top, SAMPLES)
    time = (depth - depth[0]) / speed
    phase = ["load"] * SAMPLES
    if hold_s:
        depth, time = np.append(depth, np.full(12, top)), np.append(time, time[-1] + np.geomspace(0.1, hold_s, 12))
        phase += ["hold"] * 12
    if unload:
        down = np.linspace(0.95 * top, -0.1, SAMPLES)
        depth, time = np.append(depth, down), np.append(time, time[-1] + (top - down) / speed)
        phase += ["unload"] * SAMPLES
    start = (float(np.nanmax(data.time_s)) if np.isfinite(data.time_s).any() else 0.0) + DAY_S * later_days
    begins = start + rest_s + np.arange(COUNT) * (rest_s + float(time[-1]))
    kind = replace(data.indenters[0], name=f"next {radius or ''}", radius_mm=radius or data.indenters[0].radius_mm)
    one = data.presses.take(np.zeros(COUNT, dtype=np.int64))
    x, y = place or (float(np.nan_to_num(one.x_mm[0])), float(np.nan_to_num(one.y_mm[0])))
    conditions = {"radius_mm": kind.radius_mm, "x_mm": x, "y_mm": y, "rest_s": rest_s, "speed_mm_s": speed}
    presses = replace(
        one,
        label=tuple(f"next{k}" for k in range(COUNT)),
        indenter=np.zeros(COUNT, dtype=np.int64),
        **{name: np.full(COUNT, value) for name, value in conditions.items()},
        day=begins / DAY_S,
        order=data.count + np.arange(float(COUNT)),
    )
    size = COUNT * depth.size
    usual: dict[str, Any] = {
        name: np.full(size, float(np.median(getattr(data, name))))
        for name in ("temperature_C", "depth_std_mm", "force_std_N")
    }
    return replace(
        data,
        indenters=(kind,),
        presses=presses,
        press=np.repeat(np.arange(COUNT), depth.size),
        time_s=np.add.outer(begins, time).ravel(),
        depth_mm=np.tile(depth, COUNT),
        force_N=np.zeros((size, 3)),
        phase=np.array(phase * COUNT),
        reconstructed_mm=None,
        reconstructed_std_mm=None,
        **usual,
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
    return float(np.linalg.norm(unexplained(jacobian, problem.whitener.apply(f_one - f_rival))))


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

MIN_BIAS = 0.002  # of E: below it no check is proposed
_CHECKS = (  # covariates of a residual, and what shows more of it
    (("w", "w/h", "1/w", "P"),
     ManualCheck("press the same depths with a punch of another radius: does it follow depth or force?", 10)),
    (("t",), ManualCheck("leave a dead weight on the force sensor for a minute: does its reading creep?", 3)),
    (("load/unload",), ManualCheck("go down and up in steps, and wait at each: do the two ways meet?", 5)),
    ((SCATTER,), ManualCheck("wet the punch with soapy water: does the force still jump?", 5)),
    (("log rate",), ManualCheck("repeat one press at five speeds", 8)),
    (("wait",), ManualCheck("vary the waits from 3 s to 10 min", 25)),
    (("T",), ManualCheck("press once with the gel five degrees warmer", 30)),
    (("x", "y", "azimuth"), ManualCheck("turn the gel by 90 degrees: does it turn with the gel?", 10)),
    (("Fx", "Fy"), ManualCheck("turn the force sensor by 90 degrees and press again", 10)),
    (("a", "indenter"), ManualCheck("measure each indenter's face and edge", 10)),
    (("order", "recording date"), ManualCheck("repeat the first press: is it still the same?", 3)),
)  # fmt: skip
FOLLOW: Mapping[str, ManualCheck] = {name: check for names, check in _CHECKS for name in names}


def of_candidates(group: Sequence[Candidate]) -> list[NextMeasurement]:
    """Return checks of the candidates of a set, each with the separation of the fitted amplitude from none."""
    found = []
    for one in group:
        check = one.effect.check
        if check is not None and np.isfinite(check.std):
            size = abs(float(one.own_values[0]) - one.effect.parameters[0].default)
            plan = NextMeasurement(check.action, check.minutes, size / check.std)
            found.append(_named(plan, one, [other for other in group if other is not one]))
    return found


def _named(plan: NextMeasurement, one: Candidate, others: Sequence[Candidate]) -> NextMeasurement:
    """Return the action with the names of the candidates that it separates, and why it is proposed."""
    first, *rest = (c.effect.key.replace("_", " ") for c in (one, *others))
    if not others:
        return replace(plan, why=f"it measures {first} directly, without the model")
    pair = f"{first} from {' and '.join(rest)}"
    return replace(plan, separates=pair, why=f"these data do not distinguish {pair}")


def of_hidden(bias: Mapping[str, float]) -> list[NextMeasurement]:
    """Return checks of effects that these data cannot show, most bias of E removed in a minute first."""
    checks = {key: EFFECTS[key].check for key in bias if key in EFFECTS}
    of_check = {check: key for key, check in checks.items() if check and abs(bias[key]) > MIN_BIAS}
    ranked = sorted(of_check, key=lambda check: -abs(bias[of_check[check]]) / check.minutes)
    why = "these data cannot show {}, which could put E off by {:.1f} %"
    said = {one: why.format(key.replace("_", " "), 100 * abs(bias[key])) for one, key in of_check.items()}
    return [_by_hand(check, said[check]) for check in ranked]


def _by_hand(check: ManualCheck, why: str) -> NextMeasurement:
    return NextMeasurement(check.action, check.minutes, why=why)


# The plan: presses that distinguish candidates, and checks of the residual.

PLACES = ("x", "y", "azimuth")  # covariates of the place on the pad
WORTH = 0.5  # std: least separation of an action that is proposed
MAX_SIGMA = 10  # std: a larger separation counts as this one


def plan_next(
    base: Fit,
    sets: Sequence[Sequence[tuple[Candidate, ...]]],
    *,
    again: Sequence[NextMeasurement],
    left: Unexplained | None,
    instead: Sequence[Candidate],
    bias: Mapping[str, float],
) -> tuple[NextMeasurement, ...]:
    """Return what to do: presses `again`, then checks of the residual, candidates, then effects not detectable.

    Of candidates a direct check comes before presses, since it needs no model of the other.
    `sets`: for each search, the candidates of each step; `instead`: those of a beta out of theory.
    """
    open_sets = [group for one in sets for group in one]
    if not open_sets and instead:
        open_sets = [tuple(instead)]
    checks = [plan for group in open_sets for plan in of_candidates(group)]
    presses = list[NextMeasurement]()
    for group in sets[0] or ([tuple(instead)] if instead else []):  # of forces: a picture is no press
        if len(group) > 1:
            presses = [
                _named(plan, group[0], group[1:]) for plan in measure_next(base, group[0], rivals=group[1:])
            ]
            break
    worth = [
        plan for plans in (checks, presses) for plan in sorted(plans, key=_rate) if plan.separation_sigma > WORTH
    ]
    seen = left.covariates if left is not None else ()
    shown = dict[ManualCheck, str]()
    for key in (one for one in seen if one in FOLLOW):
        shown.setdefault(
            FOLLOW[key], f"no effect explains the residual, which depends on {IN_WORDS.get(key, key)}"
        )
    follow = [_by_hand(check, why) for check, why in shown.items()]
    found = [*again, *follow, *worth, *of_hidden(bias)]
    return tuple({plan.what: plan for plan in reversed(found)}.values())[::-1]


def _rate(plan: NextMeasurement) -> float:
    """Return less the separation a minute."""
    return -min(plan.separation_sigma, MAX_SIGMA) / plan.minutes


def press_again(odd: OutlyingPresses, contrast: PressContrast | None = None) -> tuple[NextMeasurement, ...]:
    """Return the repetition of presses that are unlike the others."""
    found = list[NextMeasurement]()
    if contrast is not None and contrast.covariate in PLACES:
        where = f"{contrast.covariate} = {contrast.at:.2g} {contrast.unit}"
        action = f"press again on both sides of {where}, and look at the pad there against the light"
        found.append(NextMeasurement(action, 5, why=f"presses differ with their place, {contrast.covariate}"))
    if odd.presses:
        action = f"press {', '.join(odd.presses)} again: the same indenter at the same place"
        found.append(NextMeasurement(action, 2.0 * len(odd.presses), why="they are unlike all other presses"))
    elif odd.wanders and not found:
        what = "repeat the first press after the last one: is it still the same?"
        found.append(NextMeasurement(what, 3, why="the presses' zeros change from press to press"))
    return tuple(found)
