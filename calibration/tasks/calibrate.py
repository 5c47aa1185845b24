"""Fit a material to depth and force.

result = calibrate(Measured(recording, points=certificate.points))
write_json("calibration.json", result.as_json())
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibration.diagnosis.adequacy import with_model_test
from calibration.diagnosis.refit import held_out_rms
from calibration.fit.identifiability import main_radius, stiffness_of
from calibration.fit.least_squares import Fit, fit, quantile95
from calibration.fit.repeats import LEVEL, allow_for_indenters, repeatability_rms
from calibration.fit.tolerances import DIMENSIONS, HEIGHTS
from calibration.inputs.checks import at_one_depth, check, check_times, of_several_depths, of_shape, without_copies
from calibration.inputs.depth_path import in_phase
from calibration.inputs.gather import observe_curves, observe_points
from calibration.inputs.observations import Measured, Observations, as_sets
from calibration.laws import FLAT, get_law, shape_of
from calibration.laws.flat_punch import OPEN_NU, SILICONE_NU, FlatPunch
from calibration.laws.theory import apart_from_stated
from calibration.model.composition import Model
from calibration.model.stages import Law
from calibration.result import poisson_routes
from calibration.result.material import allow_for_edge, determine_material
from calibration.result.poisson_routes import Route
from calibration.result.result import NO_CLOCK, CalibrationResult
from calibration.tasks.compare import judged, with_far_held_out, with_stated_noise
from calibration.tasks.session import as_path
from tactilevision.errors import NothingCertified
from tactilevision.records.measured import Estimate, Pair

ONE_DEPTH = "one_depth"  # the flag of a result whose curvature is theory's
OUT_OF_PHASE = "out_of_phase"  # the reason against a press too fast for the offset of its clocks


def calibrate(
    measured: Measured | Sequence[Measured],
    *,
    law: Law | str = "default",
    effects: Model | None = None,
    clock_offset: Estimate | None = None,
    bulge: Estimate | None = None,
    bound: Pair | None = SILICONE_NU,
    test: bool = True,
) -> CalibrationResult:
    """Fit a law to the accepted points, or to the curves where there are no points.

    `law` a Law or the key of one ("default": the flat punch; where there is none, the ball or the cone); `effects`
    a model whose effects are fitted as well; `clock_offset` and `bulge` (nu from the rise next to the punch) come
    from the certificate, where it has them. If the rise does not determine nu, its interval bounds nu. `bound`
    is nu's range in elastomers, used where nu is not stated; None: no bound. `test`: test whether the flat punch
    explains the data; where it does not, E's interval reaches to what the suspects make of it. Presses with
    inconsistent clocks are omitted, with a warning. Raises NothingCertified where every press was rejected,
    InputError for measurements that no law can be fitted to.
    """
    sets = as_sets(measured)
    seen = without_copies(observe(sets))
    check_times(seen)
    shapes = {indenter.shape for indenter in seen.indenters}
    chosen = get_law(law, shapes) if isinstance(law, str) else law
    stated = _sized(of_shape(seen, shape_of(chosen)))
    if shape_of(chosen) == FLAT:
        stated = of_several_depths(stated)
    data = poisson_routes.informed(stated, bulge, bound=bound) if isinstance(chosen, FlatPunch) else stated
    single = isinstance(chosen, FlatPunch) and at_one_depth(data)
    check(data, shape=shape_of(chosen), one_depth=single)
    given, data = data, in_phase(data)
    free = _free(chosen, data, single=single, bound=poisson_routes.narrowed(bound, bulge))
    fitted = fit(Model(free, effects.effects if effects else ()), data)
    known = (*poisson_routes.of_bulge(bulge), *poisson_routes.of_prior(stated.gel, bulge=bulge, bound=bound))
    routes = (*known, *poisson_routes.of_radii(fitted)) if isinstance(chosen, FlatPunch) else ()
    again = judged(fitted)
    result = determine_material(allow_for_indenters(fitted), poisson_routes.rivals(fitted, routes))
    result = replace(result, held_out_N=held_out_rms(again), noise_floor_N=repeatability_rms(again))
    result = with_stated_noise(result, again, or_else="; or `diagnose` shows what the model lacks")
    result = with_far_held_out(result, again)
    if test and isinstance(chosen, FlatPunch):
        result = _reduced_as_far(result, with_model_test(result, again, command=_diagnose(sets)))
    if single:
        result = _of_one_depth(result)
    if isinstance(chosen, FlatPunch):
        result = allow_for_edge(_with_routes(result, routes))
    if apart := apart_from_stated(result.youngs_modulus, stated.gel):
        result = result.noted(apart)
    late = Counter(given.presses.label) - Counter(data.presses.label)
    rejected = (
        *((p.press, p.reason or "rejected") for m in sets for p in m.points if not p.accepted),
        *((press, OUT_OF_PHASE) for press in late.elements()),
    )
    return replace(result, presses_rejected=rejected, clock_offset=clock_offset or NO_CLOCK)


def _diagnose(sets: Sequence[Measured]) -> str:
    """Return the command that searches these recordings for the cause."""
    return shlex.join(["tactilevision", "diagnose", *(as_path(str(one.recording.path)) for one in sets)])


def _reduced_as_far(before: CalibrationResult, after: CalibrationResult) -> CalibrationResult:
    """Return the result with the interval of E/(1 - nu^2) widened by the share by which that of E was."""
    old, new = before.youngs_modulus.interval95, after.youngs_modulus.interval95
    reduced = after.reduced_modulus
    if old is None or new is None or reduced.interval95 is None or not min(old) > 0:
        return after
    low, high = (end * new[k] / old[k] for k, end in enumerate(reduced.interval95))
    return replace(after, reduced_modulus=replace(reduced, interval95=(low, high)))


def _with_routes(result: CalibrationResult, routes: tuple[Route, ...]) -> CalibrationResult:
    """Return the result with every route to nu; the source is the tightest one that was used."""
    routes = (*routes, *poisson_routes.of_beta(result.beta))
    warnings, flags = poisson_routes.contradictions(routes)
    source, known = result.poisson_ratio_source, result.poisson_ratio.value is not None
    return replace(
        result,
        routes=routes,
        poisson_ratio_source=poisson_routes.tightest(routes) if known else source,
        assumptions=(*result.assumptions, *poisson_routes.in_words(routes)),
    ).noted(*warnings, flags=flags)


def observe(sets: Sequence[Measured]) -> Observations:
    """Return the accepted points of these recordings, or their curves where none has points."""
    if any(m.points for m in sets):
        if not any(p.accepted for m in sets for p in m.points):
            reasons = "; ".join(f"{p.press}: {p.reason or 'rejected'}" for m in sets for p in m.points)
            raise NothingCertified(f"no press can be trusted ({reasons})")
        return observe_points(sets)
    return observe_curves(sets)


def _sized(data: Observations) -> Observations:
    """Return the data with radius 0 for cones, so that their presses are one group."""
    return replace(data, presses=replace(data.presses, radius_mm=np.nan_to_num(data.presses.radius_mm)))


def _of_one_depth(result: CalibrationResult) -> CalibrationResult:
    """Return the result without a value of beta, and the assumption about it."""
    there = "there is one press" if result.fitted.data.count == 1 else "the presses have one depth"
    why = f"{there}: stiffness and curvature cannot be distinguished"
    low, high = result.beta.interval95 or (float("nan"), float("nan"))
    said = (
        f"{why}; beta is held to {low:.2f} to {high:.2f}, what contact laws have for any friction (95 %), and c "
        "and E follow with what that leaves open"
    )
    beta = replace(result.beta, value=None, std=None, why=why)
    found = replace(result, beta=beta, assumptions=(*result.assumptions, said))
    return found.noted(f"{why}; press to two depths at least, one twice the other", flags=[ONE_DEPTH])


def _free(law: Law, data: Observations, *, single: bool, bound: Pair | None) -> Law:
    """Return the default law with nu free where several radii may determine it, and theory's beta at one depth."""
    if not isinstance(law, FlatPunch):
        return law
    several = np.unique(data.presses.radius_mm).size > 1
    return replace(
        law,
        one_depth=single or law.one_depth,
        free_poisson_ratio=(several and data.gel.poisson_ratio is None) or law.free_poisson_ratio,
        poisson_range=bound or OPEN_NU,
    )


# One sensor's modulus over several recordings, and whether it has moved.
#
# Each recording is fitted by itself. Against the first one, errors that all recordings share (machined heights,
# radii, thickness, nu, sticking) cancel: the test of a change uses the stiffness c with its own noise alone,
#     t = ln(c_k/c_1) / std,
# with Student's distribution and Holm's correction over the recordings.


@dataclass(frozen=True, slots=True)
class HistoryRow:
    """One recording: its date, E, nu and c with intervals, and the change of c since the first recording.

    `change` is relative, c_k/c_1 - 1, with a 95 % interval; `p_adjusted` of no change; `moved` at the 5 % level.
    """

    date: str
    recording: str
    presses: int
    youngs_modulus: Estimate
    poisson_ratio: Estimate
    c: Estimate
    change: float
    change_interval95: Pair
    p_adjusted: float
    moved: bool

    def as_row(self) -> dict[str, Any]:
        """Return a row of history.csv."""
        E, c = self.youngs_modulus, self.c
        low, high = E.interval95 or (None, None)
        c_low, c_high = c.interval95 or (None, None)
        return {
            "date": self.date, "recording": self.recording, "presses": self.presses,
            "youngs_modulus_MPa": E.value, "youngs_modulus_low_MPa": low, "youngs_modulus_high_MPa": high,
            "c_N_per_mm": c.value, "c_low_N_per_mm": c_low, "c_high_N_per_mm": c_high,
            "change": self.change, "change_low": self.change_interval95[0],
            "change_high": self.change_interval95[1], "p_adjusted": self.p_adjusted, "moved": self.moved,
        }  # fmt: skip


def history(recordings: Sequence[Measured], *, law: Law | str = "default") -> tuple[HistoryRow, ...]:
    """Return one row for each recording, in order of date."""
    ordered = sorted(recordings, key=lambda m: str(m.recording.date or ""))
    results = [calibrate(m, law=law, test=False) for m in ordered]
    own = [own_stiffness(result.fitted, main_radius(results[0].fitted)) for result in results]
    tests = [_change(own[0], other) for other in own]
    adjusted = [1.0, *holm([p for _, _, p in tests[1:]])]
    return tuple(
        HistoryRow(
            date=str(measured.recording.date or ""),
            recording=measured.recording.name,
            presses=len(result.presses_accepted),
            youngs_modulus=result.youngs_modulus,
            poisson_ratio=result.poisson_ratio,
            c=result.c,
            change=change,
            change_interval95=interval,
            p_adjusted=p,
            moved=p < LEVEL,
        )
        for measured, result, (change, interval, _), p in zip(ordered, results, tests, adjusted, strict=True)
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for the family-wise error (Holm, Scand. J. Stat. 6 (1979) 65)."""
    order, left = np.argsort(p_values), np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.maximum.accumulate(np.minimum(left * np.asarray(p_values)[order], 1.0))
    return [float(p) for p in adjusted]


def own_stiffness(fitted: Fit, radius_mm: float | None) -> tuple[Estimate, float]:
    """Return c, N/mm, of this radius, else of the main one, with its noise alone, and the degrees of freedom.

    Tolerances that recordings share and nu are taken as stated. None, of bodies that are no punches: E, MPa.
    """
    again = fit(fitted.model.without(HEIGHTS).without(DIMENSIONS), fitted.data, tolerances=False)
    if radius_mm is None:
        return again.estimate("youngs_modulus_MPa"), again.noise.dof
    known = radius_mm in again.data.presses.radius_mm
    return stiffness_of(again, radius_mm if known else main_radius(again)), again.noise.dof


def _change(first: tuple[Estimate, float], other: tuple[Estimate, float]) -> tuple[float, Pair, float]:
    from scipy.stats import t

    (a, dof_a), (b, dof_b) = first, other
    assert a.value is not None
    assert b.value is not None
    parts = np.array([(a.std or 0) / a.value, (b.std or 0) / b.value]) ** 2
    std, shift = float(np.sqrt(parts.sum())), float(np.log(b.value / a.value))
    if first is other or std == 0:
        return 0.0, (0.0, 0.0), 1.0
    dof = float(parts.sum() ** 2 / (parts**2 / [dof_a, dof_b]).sum())  # Welch
    reach = quantile95(dof) * std
    p = float(2 * t.sf(abs(shift) / std, max(dof, 1.0)))
    return float(np.expm1(shift)), (float(np.expm1(shift - reach)), float(np.expm1(shift + reach))), p
