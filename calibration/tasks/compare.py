"""Compare models with measurements: errors of fit and of prediction, and repeatability of the presses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.diagnosis.diagnosis import Diagnosis
from calibration.diagnosis.refit import AS_GOOD, CANNOT_FIT, adopt, held_out_rms, refit_with
from calibration.diagnosis.score_test import Scored, effect_directions, score_test
from calibration.diagnosis.vision_depth_check import face_error_mm, fit_vision_depth, in_picture, reading_error_mm
from calibration.effects import EFFECTS, effects_for, get_effect
from calibration.fit import depth_noise
from calibration.fit.least_squares import Fit, fit, unexplained
from calibration.fit.repeats import beyond_stated, refit_with_pure_noise, repeatability_rms
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.checks import clear_of_touch, usable
from calibration.inputs.conditions import above_repeats
from calibration.inputs.deadline import NEVER, SILENT, Deadline, Progress
from calibration.inputs.depth_path import in_phase
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import OPEN_NU, SILICONE_NU, FlatPunch
from calibration.laws.resultant import Resultant
from calibration.model.composition import Model
from calibration.model.stages import Effect
from calibration.noise.reml import BEYOND_CHANCE
from calibration.result.material import material_by_routes
from calibration.result.poisson_routes import informed
from calibration.result.result import CalibrationResult
from tactilevision.errors import ConvergenceError, InputError
from tactilevision.records.constants import KILO, NONZERO, ROUNDING, TINY
from tactilevision.records.display import Displayed, Summary, figure, mN
from tactilevision.records.measured import Estimate, Floats, Pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The two figures that say how well a model fits, the same in calibrate, compare, diagnose and steps.
#
#     held-out error = rms of measured less predicted force over presses that the fit did not see (five folds)
#     repeatability  = std of the force among like presses, after what the model says of their differences
#
# A model is as good as the presses allow where the first is near the second. Either is an estimate from few
# presses. A radius that is pressed once keeps the slope beta of the whole fit while its press is held out.

TOO_SMALL = "stated_noise_too_small"
FAR_HELD_OUT = "held_out_above_repeatability"
FAR = 0.005  # p of the F ratio below which held-out errors exceed the repeatability


def judged(fitted: Fit) -> Fit:
    """Return the same model fitted as `compare` and `diagnose` do; the fit itself where that fails.

    Samples are weighted by the scatter of repeats and neighbours; those near first contact are excluded.
    """
    data = clear_of_touch(fitted.data)
    try:
        again = fitted if data is fitted.data else fit(fitted.model, data, tolerances=False)
        again = refit_with_pure_noise(again)
        shaped = depth_noise.clear_of_own_touch(again, depth_noise.with_sample_noise(again))
        if shaped is again.data:
            return again
        return refit_with_pure_noise(fit(again.model, shaped, starts=again.values[None], tolerances=False))
    except CANNOT_FIT:
        return fitted


def with_stated_noise(result: CalibrationResult, fitted: Fit, *, or_else: str = "") -> CalibrationResult:
    """Return the result with a warning where the stated noise is far from the scatter of this fit's samples."""
    flag, check = TOO_SMALL, "Check std_N of [force] and std_mm of [depth]"
    if (times := beyond_stated(fitted)) is not None and times < 1:
        flag = "stated_noise_too_large"
        said = "samples scatter less than half as much as was stated of them: small effects may stay unseen."
        said = f"{said} {check}"
    elif times is not None:
        said = f"samples scatter {times:.1f} times as much as was stated of them; that is taken as their noise."
        said = f"{said} {check}{or_else}"
    elif (deeper := depth_noise.depth_beyond_stated(fitted)) is not None:
        said = f"depths scatter {deeper:.1f} times as much as was stated of them. Check std_mm of [depth]{or_else}"
    else:
        return result
    return result.noted(said, flags=[flag])


def with_far_held_out(result: CalibrationResult, fitted: Fit) -> CalibrationResult:
    """Return the result with a warning where presses held out are off by more than they differ from each other.

    What points differ by includes their indenters' stated height errors, which repeats share. By F of the two mean
    squares at FAR. The error of a press is common to its samples, so that each has as many degrees of freedom as
    presses of equal weight: (sum s^2)^2 / sum s^4, s^2 the squares expected of a press. Source: Satterthwaite,
    Biometrics 2 (1946) 110.
    """
    from scipy.special import fdtrc

    data, about = fitted.data, fitted.about
    squares = np.bincount(data.press, fitted.noise.std_N(about) ** 2)
    heights = np.array([0.0 if data.is_curves else one.height_std_mm for one in data.indenters])
    shared_N = float(np.sqrt(np.mean((about.slope_N_per_mm * heights[data.presses.indenter[data.press]]) ** 2)))
    least = ROUNDING * float(np.max(np.abs(fitted.force_N)))
    floor_N = max(float(np.hypot(result.noise_floor_N, shared_N)), least)
    dof, ratio = float(squares.sum() ** 2 / max((squares**2).sum(), TINY)), result.held_out_N / floor_N
    if not (np.isfinite(ratio) and fdtrc(dof, dof, ratio**2) < FAR):
        return result
    said = (
        f"the error on held-out presses, {KILO * result.held_out_N:.3g} mN, is {ratio:.1f} times the "
        f"repeatability, {KILO * result.noise_floor_N:.3g} mN: the model lacks something"
    )
    return result.noted(said, flags=[FAR_HELD_OUT])


# Models against measurements: the error in and out of sample, and how well the presses repeat.

TRIED = 5  # effects of the largest scores that are fitted to suggest one
MANY = 8  # starts of an effect that are all fitted; of more the best


@dataclass(frozen=True, slots=True)
class Compared:
    """One model: its effects in the order added, parameters, and rms errors in N.

    `covariates` are the residual's dependence on everything recorded, the most significant first, and `material`
    is that of the fit; neither is known before `completed`, nor of the picture's depth, whose errors are in mm
    instead of N.
    """

    name: str
    effects: tuple[str, ...]
    parameters: tuple[tuple[str, Estimate], ...]
    rms_N: float
    held_out_N: float
    repeatability_N: float
    fitted: Fit
    covariates: tuple[Scored, ...] = ()
    material: CalibrationResult | None = None

    def as_json(self, before: Compared | None = None) -> dict[str, Any]:
        """Return one entry of comparison.json; `before` is the base model to compare the errors with.

        The error is also given in per cent of the largest force, and as a depth at the median slope of force.
        """
        base, data = before or self, self.fitted.data
        slope = float(np.median(np.abs(self.fitted.about.slope_N_per_mm[data.depth_mm > 0])))
        errors = [rms_of_presses(one.fitted) for one in (base, self)]
        return {
            "name": self.name,
            "effects": list(self.effects),
            "parameters": {name: estimate.as_json() for name, estimate in self.parameters},
            "rms_error_N": {
                "before": base.rms_N,
                "after": self.rms_N,
                "held_out_before": base.held_out_N,
                "held_out_after": self.held_out_N,
                "floor": self.repeatability_N,
                "in_sample": self.rms_N,
                "held_out": self.held_out_N,
                **above_repeats(base.fitted.data, base.held_out_N, self.held_out_N),
            },
            "rms_error_percent": 100 * self.rms_N / float(np.max(data.normal_N)),
            "rms_error_um": KILO * self.rms_N / slope,
            "chi2": self.fitted.chi2,
            "covariates": [{"name": c.key, "p_adjusted": c.p_adjusted} for c in self.covariates],
            "youngs_modulus_MPa": None if self.material is None else self.material.youngs_modulus.as_json(),
            "presses": [
                {"press": label, "rms_before_N": before, "rms_after_N": after}
                for label, before, after in zip(data.presses.label, *errors, strict=True)
            ],
        }

    def picture_as_json(self, base: Compared) -> dict[str, Any]:
        """Return the entry of a model of the reconstructed depth; `base` is the one without effects."""
        return {
            "name": self.name,
            "effects": list(self.effects),
            "parameters": {name: estimate.as_json() for name, estimate in self.parameters},
            "rms_error_mm": {
                "held_out_before": base.held_out_N,
                "held_out_after": self.held_out_N,
                "floor": self.repeatability_N,
                "faces_before": face_error_mm(base.fitted),
                "faces_after": face_error_mm(self.fitted),
                **above_repeats(self.fitted.data, base.held_out_N, self.held_out_N),
            },
        }


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(Displayed):
    """Models in the order in which effects were added, on the same measurements.

    `stated` are the measurements as recorded, without what else is known of nu. `left_out` are the effects that
    could not be added, and why; `pictured` the models of the picture's depth
    compared with the certified one, where there are both; `suggested` the keys of effects that would
    lower the last model's error by more than they cost; `over` E of the last model over what a diagnosis does not
    exclude.
    """

    models: tuple[Compared, ...]
    stated: Observations
    left_out: tuple[tuple[str, str], ...] = ()
    pictured: tuple[Compared, ...] = ()
    suggested: tuple[str, ...] = ()
    over: Estimate | None = None

    @property
    def material(self) -> CalibrationResult | None:
        """The last model's material, with E as a diagnosis states it where there was one."""
        found = self.models[-1].material
        if found is None or self.over is None:
            return found
        return replace(found, youngs_modulus=self.over, undiagnosed_MPa=found.youngs_modulus.interval95)

    def summary(self) -> Summary:
        """Return the error of each model on held-out presses (fitted ones where none could be), and E."""
        last = self.models[-1]
        errors_N = {m.name: m.held_out_N if np.isfinite(m.held_out_N) else m.rms_N for m in self.models}
        values: dict[str, str | Estimate] = {name: f"error {mN(error)}" for name, error in errors_N.items()}
        values["repeatability"] = mN(last.repeatability_N)
        if last.material is not None:
            values |= {"E": last.material.youngs_modulus, "ν": last.material.poisson_ratio}
        values |= {f"without {key}": why for key, why in self.left_out}
        return Summary("Comparison of models", values)

    def plot_fall(self) -> Figure:
        """Draw the error of each model, next to the repeatability."""
        return figure("plot_fall", self)

    def as_json(self) -> list[dict[str, Any]]:
        """Return the content of comparison.json: the last model of the force names effects to try."""
        content = [model.as_json(self.models[0]) for model in self.models]
        content[-1]["suggested"] = list(self.suggested)
        return [*content, *(model.picture_as_json(self.pictured[0]) for model in self.pictured)]


def compare(
    data: Observations,
    effects: Sequence[Effect | str],
    *,
    rng: np.random.Generator,
    bulge: Estimate | None = None,
    progress: Progress = SILENT,
    deadline: Deadline = NEVER,
    bound: Pair | None = SILICONE_NU,
) -> Comparison:
    """Return the fits of the base law and of the law with the effects added one after another.

    An effect that these data cannot show, that fails or that finds no minimum is named in `left_out`, and the next
    one is added without it. An effect on the picture's depth is added to the fit of that depth, where certified
    depths exist; a treatment replaces its fit. `bulge`: nu from the rise outside the contact, held within `bound`.
    After the `deadline` no effect is added any more. Raises InputError for unusable data.
    """
    complete = partial(completed, rng=rng)
    progress(0, len(effects) + 1, "the base model")
    found = complete(plain_law(data, bulge=bulge, bound=bound))
    for number, added in enumerate(effects, start=1):
        effect = get_effect(added) if isinstance(added, str) else added
        progress(number, len(effects) + 1, effect.key.replace("_", " "))
        found = with_effect(found, effect, complete=complete, deadline=deadline)
    return replace(found, suggested=suggest(found, deadline))


def plain_law(
    data: Observations, *, bulge: Estimate | None = None, bound: Pair | None = SILICONE_NU
) -> Comparison:
    """Return the base law alone, to which `with_effect` adds, without what `completed` determines.

    Raises InputError for unusable data, and where it cannot be fitted.
    """
    stated = clear_of_touch(in_phase(usable(data)))
    data = informed(stated, bulge, bound=bound)
    return Comparison(
        (_judge(base_fit(base_model(data, bound=bound), data)),), stated, pictured=_of_picture(stated)
    )


def _of_picture(data: Observations) -> tuple[Compared, ...]:
    """Return the picture's depth compared with the certified one; nothing where there are not both."""
    with suppress(*CANNOT_FIT):
        seen = fit_vision_depth(data)
        return () if seen is None else (_as_read(seen, ()),)
    return ()


def completed(found: Comparison, rng: np.random.Generator) -> Comparison:
    """Return the same with the last model's material, which takes as long again, and its residual's covariates."""
    last = found.models[-1]
    covariates = score_test(last.fitted, (), rng=rng).covariates
    whole = replace(last, material=material_by_routes(last.fitted), covariates=covariates)
    return replace(found, models=(*found.models[:-1], whole))


def with_effect(
    found: Comparison,
    effect: Effect,
    *,
    complete: Callable[[Comparison], Comparison] | None = None,
    deadline: Deadline = NEVER,
) -> Comparison:
    """Return the comparison with one more effect, or with the reason in `left_out` why it cannot be added.

    `complete` is applied to one with another model of the force.
    """
    last = found.models[-1]
    why = "the time was over" if deadline.passed else ""
    try:
        unseen = why or _unseen(found.models[0].fitted, effect)
        if not unseen:
            one = _judge(fit_added(last.fitted.model + effect, last.fitted))
            more = (*found.models, replace(one, effects=(*last.effects, effect.key)))
            longer = replace(found, models=more, suggested=())
            return longer if complete is None else complete(longer)
        if why or (pictured := _in_picture(found, effect)) is None:
            return replace(found, left_out=(*found.left_out, (effect.key, unseen)))
        return replace(found, pictured=pictured, suggested=())
    except Exception as fault:  # a private effect may raise anything; the next one may still do
        return replace(found, left_out=(*found.left_out, (effect.key, str(fault) or type(fault).__name__)))


def _unseen(base: Fit, effect: Effect) -> str:
    """Return why the base model's data cannot show an effect; empty where they can."""
    tables, missing = effect_directions(base, [effect])
    size = max((float(np.max(np.abs(one), initial=0.0)) for one in tables.values()), default=np.inf)
    still = size <= ROUNDING * float(np.max(np.abs(base.force_N)))
    return missing.get(effect.key, "it does not change the force of these presses" if still else "")


def suggest(found: Comparison, deadline: Deadline = NEVER) -> tuple[str, ...]:
    """Return keys of effects to try, the best first, where the last model's residual is significant.

    Those of the largest scores are fitted; they lower chi^2 + 2 q by more than AS_GOOD.
    """
    last = found.models[-1]
    if deadline.passed or min((c.p_adjusted for c in last.covariates), default=1.0) > BEYOND_CHANCE:
        return ()
    base, fits = last.fitted, []
    tables, _ = effect_directions(base, effects_for(base.data))
    white = base.whitener.apply(np.column_stack([base.jacobian[:, base.free], base.residual_N, *tables.values()]))
    count = int(np.count_nonzero(base.free))
    z, *rest = unexplained(white[:, :count], white[:, count:]).T
    gains = np.square(rest @ z) / np.maximum(np.sum(np.square(rest), axis=1), NONZERO)
    ends = np.cumsum([table.shape[1] for table in tables.values()])[:-1]
    largest = dict(zip(tables, (float(part.max()) for part in np.split(gains, ends)), strict=True))
    for key in sorted(largest, key=lambda one: -largest[one])[:TRIED]:
        with suppress(*CANNOT_FIT):
            fits.append(refit_with(base, EFFECTS[key]))
    better = [one for one in fits if one.cost < base.chi2 - AS_GOOD]
    return tuple(one.effect.key for one in sorted(better, key=lambda one: one.cost))


def _in_picture(found: Comparison, effect: Effect) -> tuple[Compared, ...] | None:
    """Return the models of the picture's depth with the effect added; None where no such depth shows it."""
    pictured = found.pictured
    if not pictured:
        return None
    seen = pictured[-1].fitted
    shown = {one.key: one for one in in_picture(seen.data)}.get(effect.key)
    if shown is None or shown.missing(seen.data):
        return None
    treat = getattr(effect, "treat", None)
    fitted = adopt(seen, refit_with(seen, shown)) if treat is None else _treated(seen, treat(found.stated))
    return (*pictured, _as_read(fitted, (*pictured[-1].effects, effect.key)))


def _treated(seen: Fit, data: Observations) -> Fit:
    """Return the law of the picture's depth, with the effects added so far, on treated data."""
    begin = fit_vision_depth(data)
    if begin is None or begin.data.slopes is None:
        raise InputError(
            "its treatment leaves too few presses with gel outside the contact",
            remedy="Press less deeply, or with narrower punches: a shadow is some depths long.",
        )
    shown = {one.key: one for one in in_picture(begin.data)}
    for key in seen.model.keys:
        begin = adopt(begin, refit_with(begin, shown[key])) if key in shown else begin
    return begin


def _as_read(fitted: Fit, keys: tuple[str, ...]) -> Compared:
    """Return a model of the picture's depth, corrected by its effects alone, with errors in mm."""
    data = fitted.data
    return Compared(
        name=" + ".join((fitted.model.law.key, *keys)),
        effects=keys,
        parameters=tuple(
            (p.name, fitted.estimate(p.name)) for p in fitted.parameters if p.name.partition(".")[0] in keys
        ),
        rms_N=float(np.sqrt(np.mean((data.normal_N - data.depth_mm) ** 2))) if not keys else fitted.rms_error_N,
        held_out_N=reading_error_mm(fitted),
        repeatability_N=repeatability_rms(fitted),
        fitted=fitted,
    )


def as_comparison(found: Diagnosis) -> Comparison:
    """Return the effects that a diagnosis added as models, in the order of adding."""
    keys, sight = tuple(effect.key for effect in found.effects), found.search.sight
    steps = enumerate(found.fits.steps)
    models = tuple(replace(_judge(fitted), effects=keys[:k]) for k, fitted in steps)
    in_sight, pictured = keys[len(models) - 1 :], tuple[Compared, ...]()
    if sight is not None and in_sight:
        fits = (sight.base, *(step.fitted for step in sight.steps))
        pictured = tuple(_as_read(fitted, in_sight[:k]) for k, fitted in enumerate(fits))
    return Comparison(models, found.fits.base.data, pictured=pictured)


def rms_of_presses(fitted: Fit) -> Floats:
    """Return the rms error of each press (M,), N."""
    press = fitted.data.press
    return np.sqrt(np.bincount(press, fitted.residual_N**2) / np.bincount(press))


def fit_alone(model: Model, data: Observations) -> Fit:
    """Return a fit with the noise of the repeats. Raises InputError if it fails."""
    try:
        return refit_with_pure_noise(fit(model, data))
    except (ConvergenceError, ArithmeticError, RuntimeError) as fault:
        raise InputError(
            f"this model cannot be fitted to these measurements: {fault}",
            where=model.name,
            remedy="Look at depth and force in a figure; leave out the effects added by hand.",
        ) from fault


def base_fit(model: Model, data: Observations) -> Fit:
    """Return the base fit, its samples' noise shaped by the data unless stated, without those near contact."""
    first = fit_alone(model, data)
    shaped = depth_noise.clear_of_own_touch(first, depth_noise.with_sample_noise(first))
    return first if shaped is first.data else fit_alone(model, shaped)


def base_model(data: Observations, *, bound: Pair | None = SILICONE_NU) -> Model:
    """Return the flat punch, or the inverse step's resultant where there is one.

    nu is free where several radii may determine it and nothing else is known of it; `bound` is its range where
    nothing determines it, None: that of any gel.
    """
    if data.resultants is not None:
        return Model(Resultant())
    several = np.unique(data.presses.radius_mm).size > 1
    free = several and data.gel.poisson_ratio is None
    return Model(FlatPunch(free_poisson_ratio=free, poisson_range=bound or OPEN_NU))


def fit_added(model: Model, on: Fit) -> Fit:
    """Return the fit of a model; `on` is the fit that its last effect was added to.

    Of an effect with many starts only the best on that fit are tried.
    """
    added, starts = [one for one in model.effects if one.key not in on.model.keys], None
    if len(added) == 1 and len(added[0].starts(on.data)) > MANY:
        starts = refit_with(on, added[0]).values[None]
    return depth_noise.with_errors_in_depth(refit_with_pure_noise(fit(model, on.data, starts=starts)))


def _judge(fitted: Fit) -> Compared:
    """Return the errors of a fit."""
    keys = tuple(k for k in fitted.model.keys if k not in TOLERANCES)
    return Compared(
        name=" + ".join((fitted.model.law.key, *keys)),
        effects=keys,
        parameters=tuple((p.name, fitted.estimate(p.name)) for p in fitted.parameters),
        rms_N=fitted.rms_error_N,
        held_out_N=held_out_rms(fitted),
        repeatability_N=repeatability_rms(fitted),
        fitted=fitted,
    )
