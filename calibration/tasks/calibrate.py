"""Fit a material to depth and force.

result = calibrate(Measured(recording, points=certificate.points))
write_json("calibration.json", result.as_json())
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.fit.least_squares import fit
from calibration.fit.repeats import allow_for_indenters
from calibration.inputs.checks import at_one_depth, check, check_times, of_several_depths, of_shape, without_copies
from calibration.inputs.depth_path import in_phase
from calibration.inputs.gather import observe_curves, observe_points
from calibration.inputs.observations import Measured, Observations, as_sets
from calibration.laws import FLAT, default_law, get_law, shape_of
from calibration.laws.flat_punch import OPEN_NU, SILICONE_NU, FlatPunch
from calibration.laws.theory import apart_from_stated
from calibration.model.composition import Model
from calibration.model.stages import Law
from calibration.result.material import determine_material
from calibration.result.poisson_routes import (
    BELOW_BOUND,
    Route,
    contradicts,
    holding_each,
    in_words,
    informed,
    narrowed,
    of_beta,
    of_bulge,
    of_prior,
    of_radii,
    tightest,
)
from calibration.result.result import NO_CLOCK, CalibrationResult
from calibration.result.uncertainty import allow_for_edge
from calibration.tasks.compare import fit_errors, judged, with_errors, with_stated_noise
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
) -> CalibrationResult:
    """Fit a law to the accepted points, or to the curves where there are no points.

    `law` a Law or the key of one ("default": the flat punch; where there is none, the ball or the cone); `effects`
    a model whose effects are fitted along; `clock_offset` and `bulge` (nu from the rise next to the punch) come
    from the certificate, where it has them. If the rise does not determine nu, its interval bounds nu. `bound`
    holds nu to what elastomers have where nothing is stated of it; None omits that. Presses with inconsistent
    clocks are omitted, with a warning. Raises NothingCertified where every press was rejected, InputError for
    measurements that no law can be fitted to.
    """
    sets = as_sets(measured)
    seen = without_copies(observe(sets))
    check_times(seen)
    chosen = _chosen(law, seen)
    stated = _sized(of_shape(seen, shape_of(chosen)))
    if shape_of(chosen) == FLAT:
        stated = of_several_depths(stated)
    data = informed(stated, bulge, bound=bound) if isinstance(chosen, FlatPunch) else stated
    single = isinstance(chosen, FlatPunch) and at_one_depth(data)
    check(data, shape=shape_of(chosen), one_depth=single)
    given, data = data, in_phase(data)
    free = _free(chosen, data, single=single, bound=narrowed(bound, bulge))
    fitted = fit(Model(free, effects.effects if effects else ()), data)
    known = (*of_bulge(bulge), *of_prior(stated.gel, bulge=bulge, bound=bound))
    routes = (*known, *of_radii(fitted)) if isinstance(chosen, FlatPunch) else ()
    fitted = holding_each(fitted, routes)
    again = judged(fitted)
    result = with_errors(determine_material(allow_for_indenters(fitted)), fit_errors(again))
    result = with_stated_noise(result, again, or_else="; or `diagnose` shows what the model lacks")
    if single:
        result = _of_one_depth(result)
    if isinstance(chosen, FlatPunch):
        result = allow_for_edge(_with_routes(result, routes))
        if stated.gel.poisson_ratio is None and contradicts(bulge, bound):
            result = _below_bound(result)
    apart = apart_from_stated(result.youngs_modulus, stated.gel)
    if apart:
        result = replace(result, warnings=(*result.warnings, apart))
    late = Counter(given.presses.label) - Counter(data.presses.label)
    rejected = (
        *((p.press, p.reason or "rejected") for m in sets for p in m.points if not p.accepted),
        *((press, OUT_OF_PHASE) for press in late.elements()),
    )
    return replace(result, presses_rejected=rejected, clock_offset=clock_offset or NO_CLOCK)


def _with_routes(result: CalibrationResult, routes: tuple[Route, ...]) -> CalibrationResult:
    """Return the result with every route to nu; the source is the tightest one that was used."""
    routes = (*routes, *of_beta(result.beta))
    lines, warnings = in_words(routes)
    source = tightest(routes) if result.poisson_ratio.value is not None else result.poisson_ratio_source
    return replace(
        result,
        routes=routes,
        poisson_ratio_source=source,
        warnings=(*result.warnings, *warnings),
        assumptions=(*result.assumptions, *lines),
    )


def _below_bound(result: CalibrationResult) -> CalibrationResult:
    """Return the result with a flag and a warning that nu lies below the range of elastomers."""
    said = (
        "Poisson's ratio lies below what solid elastomers have: a foam, or an error of the pictures; its std "
        "was widened towards the bound. State poisson_ratio in recording.toml, or use --no-prior"
    )
    return replace(result, flags=(*result.flags, BELOW_BOUND), warnings=(*result.warnings, said))


def observe(sets: Sequence[Measured]) -> Observations:
    """Return the accepted points of these recordings, or their curves where none has points."""
    if any(m.points for m in sets):
        if not any(p.accepted for m in sets for p in m.points):
            reasons = "; ".join(f"{p.press}: {p.reason or 'rejected'}" for m in sets for p in m.points)
            raise NothingCertified(f"no press can be trusted ({reasons})")
        return observe_points(sets)
    return observe_curves(sets)


def _chosen(law: Law | str, data: Observations) -> Law:
    if not isinstance(law, str):
        return law
    return default_law({indenter.shape for indenter in data.indenters}) if law == "default" else get_law(law)


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
    return replace(
        result,
        beta=replace(result.beta, value=None, std=None, why=why),
        flags=(*result.flags, ONE_DEPTH),
        assumptions=(*result.assumptions, said),
        warnings=(*result.warnings, f"{why}; press to two depths at least, one twice the other"),
    )


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
