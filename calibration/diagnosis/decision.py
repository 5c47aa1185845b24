"""The decision rule of a diagnosis: ADEQUATE, IDENTIFIED, AMBIGUOUS or UNKNOWN."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from calibration.diagnosis.constant_parameters import Varying, varying
from calibration.diagnosis.forward_selection import MAX_EFFECTS, Searched, Step
from calibration.diagnosis.refit import CANNOT_FIT, Candidate
from calibration.diagnosis.unexplained import Remainder, remainder
from calibration.effects import EFFECTS
from calibration.fit.least_squares import Fit, Problem, r_squared
from calibration.fit.outlying_presses import STANDS_OUT, WANDERS, OutlyingPresses, outlying_presses
from calibration.fit.repeats import LEVEL
from calibration.inputs.observations import Observations
from calibration.laws.theory import THEORY_BETA, THEORY_RATIO
from calibration.model.composition import Model
from calibration.model.stages import THICKNESS, Effect
from calibration.noise.model import Noise, Whitener
from calibration.result.material import AT_BOUND
from tactilevision.records.measured import Floats

MOSTLY = 0.9  # of a misfit explained: an effect's form that is off by a third leaves a tenth of the squares
CORRECTED = 0.5  # the same where the last effect has a treatment: its form need only name the cause
STRANGE_BETA = {"beta_outside_theory", AT_BOUND}  # flags of a slope that is not the contact's
BEND = "bend_within_theory"  # the flag of a curvature that theory allows
NOTHING_ODD = OutlyingPresses()


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one search, of the force or of the picture's depth.

    `steps` are the effects that stand; `tried` what fitted best where none does; `left` the smallest p of the last
    model's residual; `unknown` is defined in `decide`; `remainder` what is significant of the residual; `varying`
    parameters of the effects that are not constant where they have to be.
    """

    searched: Searched
    steps: tuple[Step, ...]
    tried: tuple[str, ...]
    left: float
    unknown: bool
    flags: tuple[str, ...]
    odd: OutlyingPresses = NOTHING_ODD
    remainder: Remainder | None = None
    varying: tuple[Varying, ...] = ()

    @property
    def sets(self) -> list[tuple[Candidate, ...]]:
        """The candidates of each step that stands, the best first."""
        return [step.equals for step in self.steps]

    @property
    def fitted(self) -> Fit:
        """The last fit that stands."""
        return self.steps[-1].fitted if self.steps else self.searched.start


def decide(searches: Sequence[Outcome], flags: Sequence[str]) -> str:
    """Return the verdict of the searches of the force and of the picture's depth.

    Each search tests, refits and confirms, at most three times; the level is .05, half of it where there are two:

    1. *Significant.* One score test of all effects, covariates and odd presses, calibrated by one parametric
       bootstrap, has p adjusted for all of them at or below the level (`score_test`). Where nothing
       is significant the verdict is ADEQUATE.
    2. *Confirmed.* An effect is added when it is significant (a second one at .005), its size lies inside its
       range, chi^2 + 2 q falls by 6, also without any one reading, and presses held out are predicted better
       (`forward_selection`). Where the freedom that theory leaves the law (a bend, another term of a relaxation)
       costs no more than 6 above that effect, it is used first.
    3. *Equal.* Other effects within 6 of chi^2 + 2 q of it, or nearer than 3 standard deviations, are its rivals
       (`refit.equals`).
    4. *Unknown.* The search explains too little where
       a. a significant residual moves E or a reading by more than .65 std (`Remainder.matters`), unless the
          effects added explain 90 % of the misfit (50 % where the last one has a treatment);
       b. a press is unlike all others, or like presses scatter more than they may and no effect is added.
       The effects of that search then do not stand.

    The first of these that holds is the verdict:

    - UNKNOWN: a search is unknown;
    - AMBIGUOUS: an effect has rivals, a parameter of it varies that has to be constant, or beta is not one that
      theory allows (`flags`);
    - IDENTIFIED: an effect was added;
    - ADEQUATE: none was.

    Presses unlike all others are set aside where they are few, and the rest is decided on by itself; the whole is
    UNKNOWN where the other presses' tails reach none of them (`OutlyingPresses.foreign`).
    """
    if any(one.unknown for one in searches):
        return "UNKNOWN"
    rivals = any(len(equal) > 1 for one in searches for equal in one.sets)
    if rivals or STRANGE_BETA & set(flags) or any(one.varying for one in searches):
        return "AMBIGUOUS"
    return "IDENTIFIED" if any(one.steps for one in searches) else "ADEQUATE"


def odd_presses(searched: Searched, level: float) -> OutlyingPresses:
    """Return what is odd among the presses, as far as it is significant."""
    significant = {s.key: s.p_adjusted for s in searched.last.others if s.p_adjusted <= level}
    wanders = [(key.removeprefix(WANDERS), p) for key, p in significant.items() if key.startswith(WANDERS)]
    odd = outlying_presses(searched.current, wanders=wanders)
    return odd if STANDS_OUT in significant else replace(odd, presses=(), foreign=False)


def outcome(searched: Searched, level: float, odd: OutlyingPresses = NOTHING_ODD) -> Outcome:
    """Return whether the steps of a search stand, by points 4a and 4b of `decide`."""
    left, steps = searched.last.lack_of_fit, searched.steps
    over = remainder(searched.current, searched.last, level=level) if left <= level else None
    flags = [BEND] if getattr(searched.current.model.law, "bent", False) else []
    flags += ["press_stands_out"] if odd.presses else []
    flags += ["presses_wander"] if odd.wanders else []
    flags += ["presses_scatter"] if odd.scattered else []
    if searched.stopped:
        so_far = tuple(c.effect.key for c in searched.rounds[-1].candidates)
        return Outcome(searched, steps, () if steps else so_far, left, not steps, tuple(flags), odd)
    flags += ["small_remainder"] if over else []
    varies = varying(searched.current, searched.last.covariates, level=level)
    flags += ["parameter_varies"] if varies else []
    enough = CORRECTED if steps and steps[-1].best.effect.treatment else MOSTLY
    mostly = 0 < len(steps) < MAX_EFFECTS and searched.explained > enough and not odd.wanders
    matters = over is not None and over.matters and not mostly
    if not (matters or odd.presses or (odd.scattered and not steps)):
        return Outcome(searched, steps, (), left, False, tuple(flags), replace(odd, wanders=()), over, varies)
    tried = [s.best.effect.key for s in steps] or [s.key for s in searched.first.effects if s.p_adjusted < LEVEL]
    return Outcome(searched, (), tuple(tried), left, True, tuple(flags), odd, over, varies)


# What could cause a beta that theory does not allow, and how straight it leaves the line of P/w over w/h.
#
# beta is fixed at theory's value and each candidate's own parameter is fitted instead. Finite elements give .85 at
# a/h = .833 (neo-Hookean, sticking); beta in units of the true thickness is proportional to a/h.

MAX_ITERATIONS = 25  # rounds between a thickness and its beta


@dataclass(frozen=True, slots=True)
class InadmissibleBeta:
    """One candidate: the value that its first parameter would have to have, R^2 of P/w over w/h with it, and E."""

    key: str
    parameter: str
    unit: str
    value: float
    r_squared: float
    rms_error_N: float
    youngs_modulus_MPa: float


def instead_of_beta() -> tuple[Effect, ...]:
    """Return the effects that may look like an inadmissible beta, by their own rank."""
    ranked = {rank: effect for effect in EFFECTS.values() if (rank := effect.instead_of_beta)}
    return tuple(ranked[rank] for rank in sorted(ranked))


def would_have_to_be(fitted: Fit, suspects: Sequence[Effect]) -> tuple[InadmissibleBeta, ...]:
    """Return every suspect that can be fitted, the smallest error first."""
    found = []
    for effect in suspects:
        if effect.key not in fitted.model.keys:
            with suppress(*CANNOT_FIT):
                found.append(_candidate(fitted, effect))
    return tuple(sorted(found, key=lambda c: c.rms_error_N))


def theory_beta(radius_mm: float, thickness_mm: float) -> float:
    """Return beta of a sharp punch by finite elements, for this thickness."""
    return THEORY_BETA * (radius_mm / thickness_mm) / THEORY_RATIO


def _candidate(fitted: Fit, effect: Effect) -> InadmissibleBeta:
    key, data = effect.key, fitted.data
    rescaled = effect.condition == THICKNESS  # another thickness is another theory's beta
    model = fitted.model + effect
    place = model.slices(data)[key].start
    starts = np.array([np.insert(fitted.values, [place] * len(start), start) for start in effect.starts(data)])
    values, thickness = starts[0], data.gel.thickness_mm
    for _ in range(MAX_ITERATIONS if rescaled else 1):
        values = _with_theory(fitted, model, key, starts, thickness)
        if rescaled:
            fitted_mm = data.gel.thickness_mm * (1 + float(values[place]))
            thickness = float(np.sqrt(thickness * fitted_mm))  # the geometric mean converges
            starts = values[None]
    force = model.predict(values, data)
    first, rms = effect.parameters[0], float(np.sqrt(np.mean((data.normal_N - force) ** 2)))
    straight, value, modulus = straightness(data, force), float(values[place]), float(values[0])
    return InadmissibleBeta(key, first.name, first.unit, value, straight, rms, modulus)


def _with_theory(fitted: Fit, model: Model, key: str, starts: Floats, thickness_mm: float) -> Floats:
    """Return all values with each radius's beta at theory's, by least squares without a prior of the effect."""
    data = fitted.data
    radii = iter(np.unique(data.presses.radius_mm))
    table = []
    for parameter in model.parameters(data):
        if parameter.name.startswith("beta"):
            parameter = parameter.held_at(theory_beta(float(next(radii)), thickness_mm))
        elif parameter.name.startswith(f"{key}."):
            parameter = replace(parameter, prior=None)
        table.append(parameter)
    noise = Noise(0.01 * float(np.max(data.normal_N)), stated=False)
    whitener = Whitener(data, noise, replace(fitted.about, base_N=np.ones(data.size)))
    problem = Problem(model, data, tuple(table), whitener)
    return problem.full(problem.solve(starts).values)


def straightness(data: Observations, force_N: Floats) -> float:
    """Return R^2 of the line through P/w against w/h, for forces (N,) in N, over samples in the gel."""
    inside = data.depth_mm > 0.05 * np.max(data.depth_mm)
    strain = data.depth_mm[inside] / data.gel.thickness_mm
    per_depth = force_N[inside] / data.depth_mm[inside]
    return r_squared(per_depth, np.asarray(np.polyval(np.polyfit(strain, per_depth, 1), strain), dtype=float))
