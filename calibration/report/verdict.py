"""Verdict of a diagnosis in words: what is wrong with the rig or the gel, and what E's interval allows for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.diagnosis.diagnosis import Diagnosis, OddPresses
from calibration.diagnosis.score_test import few_presses
from calibration.diagnosis.vision_depth_check import reading_error_mm
from calibration.effects.instrument_errors import InstrumentError
from calibration.laws.theory import stated_outside_gels
from calibration.model.stages import Parameter
from calibration.report import wording
from tactilevision.records.constants import KILO

NEAR = 0.1  # least share of a misfit that a nearest effect explains
SHOWN = 0.05  # adjusted p of a significant effect
WIDER = 0.1  # least relative widening of an interval that is reported
OTHER_WORDS = {"youngs_modulus": "Young's modulus", "beta": "the slope β"}
SHARES = ("relative", "gain")  # parameters given in per cent


def in_words(key: str) -> str:
    """Return the name of an effect, or of what it is confused with, in words."""
    return OTHER_WORDS.get(key) or key.replace("_", " ")


def verdict_sentence(found: Diagnosis) -> str:
    """Return the verdict in one sentence, and one more where E rests on an implausible nu."""
    stated = stated_outside_gels(found.fits.base.data.gel)
    return f"{_verdict_sentence(found)} {stated}." if stated else _verdict_sentence(found)


def _verdict_sentence(found: Diagnosis) -> str:
    """Return the verdict; with presses set aside, also the one without them."""
    if found.presses.set_aside:
        return _without(found)
    if found.stopped and not found.effects:
        return _so_far(found)
    named = " and ".join(in_words(effect.key) for effect in found.effects)
    before, after = KILO * found.errors.held_out_before, KILO * found.errors.held_out_after
    change = "falls" if after < before else "changes"
    fall = f"; the error on held-out presses {change} from {before:.1f} to {after:.1f} mN"
    if not any(effect.key in found.fits.fitted.model.keys for effect in found.effects):
        fall = "; the forces themselves are explained within their repeatability"
    match found.verdict:
        case "ADEQUATE":
            bent = (
                " The curvature lies within the range of finite elements."
                if "bend_within_theory" in found.flags
                else ""
            )
            said = "The model explains these data within their repeatability: no effect is significant."
            return said + bent + few_sentence(found) + unseen_sentence(found)
        case "IDENTIFIED":
            return f"An effect is missing from the model, and it is {named}{fall if found.effects else ''}."
        case "AMBIGUOUS":
            return _ambiguous(found)
        case _ if found.presses.odd:
            return f"{_odd(found)}.{_instrument_error(found)} Look at these presses before E is used."
        case _ if found.remainder.alternative_explanation is not None:
            return f"An effect is missing from the model, but none of the catalogue: {_otherwise(found)}."
        case _ if found.remainder.left is None and found.search.sight is not None:
            with_it = f", {named} allowed for" if named else ""
            return (
                "The reconstructed depth has an error that no effect of the catalogue explains."
                f"{_nearest(found)} The forces themselves are explained within their repeatability{with_it}."
            )
        case _:
            known = f" beyond {named}" if named else ""
            what = f"that no effect of the catalogue explains{_left(found)}"
            return f"Something is missing from the model{known} {what}.{_nearest(found)}{_instrument_error(found)}"


def _ambiguous(found: Diagnosis) -> str:
    """Return what the data cannot distinguish: effects, or explanations of an implausible beta."""
    several = ", ".join(in_words(key) for key in found.candidates)
    cannot = "these data cannot distinguish the explanations"
    beta = wording.estimate(found.material.before.beta)
    if "beta_outside_theory" in found.flags and not found.effects:
        return f"A line fits, but beta = {beta} lies outside the range of contact laws; {cannot}: {several}."
    if "beta_at_bound" in found.flags and not found.effects:
        return f"The slope is at its bound, beta = {beta}; {cannot}: {several}, or a wrong unit."
    return f"An effect is missing from the model; these data cannot distinguish: {several}."


def _without(found: Diagnosis) -> str:
    """Return which presses are set aside, and the verdict without them."""
    aside, odd = found.presses, found.presses.odd
    rest = replace(found, verdict=aside.without, presses=OddPresses(replace(odd, presses=())))
    many = "it" if len(aside.set_aside) == 1 else "them"
    alone = _odd(replace(found, presses=replace(aside, odd=replace(odd, wanders=(), scattered=False))))
    return f"{alone}: set aside for inspection. Without {many}: {aside.without}. {_verdict_sentence(rest)}"


def _so_far(found: Diagnosis) -> str:
    """Return the intermediate result of a search that was stopped before it named an effect."""
    shown = [one.key for one in found.search.score_test if one.p_adjusted < SHOWN]
    if not shown:
        return "No effect is significant so far."
    most = ", then ".join(in_words(key) for key in shown[:2])
    seen = f"Something is missing from the model{_left(found)}"
    return f"{seen}; so far the most significant is {most}, which is not confirmed."


def stopped_sentence(found: Diagnosis) -> list[str]:
    """Return a warning where the search was stopped by its time limit."""
    if not found.stopped:
        return []
    return ["The search was stopped by its time limit: this is the best answer so far, and others may be better."]


def reading_sentence(found: Diagnosis) -> list[str]:
    """Return the errors of the reconstructed depth before and after a gain, apart from what steep walls hide."""
    read = set() if found.search.sight is None else {step.best.effect.key for step in found.search.sight.steps}
    gain = next((dict(e.parameters).get("gain") for e in found.effects if e.key in read), None)
    if found.search.sight is None or gain is None or gain.value is None:
        return []
    before, after = (
        KILO * reading_error_mm(fitted) for fitted in (found.search.sight.base, found.search.sight.current)
    )
    fall = f"The error of the reconstructed depth on held-out presses changes from {before:.1f} to {after:.1f} µm."
    hidden = " Punch faces read still less, since steep walls hide part of their depth; that is not a gain."
    return [fall + hidden * (found.search.sight.base.data.slopes is not None)]


def few_sentence(found: Diagnosis) -> str:
    """Return a caution for few curves; empty for points, and where there are enough."""
    data = found.fits.base.data
    if not few_presses(data):
        return ""
    return (
        f" {data.count} presses hardly distinguish changes between presses (day, temperature, place) from scatter."
    )


def unseen_sentence(found: Diagnosis) -> str:
    """Return the effects that would not be significant but change E by more than its interval; else empty."""
    E = found.material.after.youngs_modulus
    if E.value is None or E.interval95 is None:
        return ""
    reach = max(E.interval95[1] / E.value - 1, 1 - E.interval95[0] / E.value)
    beyond = {key: abs(b) for key, b in found.limits.below_visibility.items() if abs(b) > reach}
    if not beyond:
        return ""
    key = max(beyond, key=lambda k: beyond[k])
    others = [in_words(k) for k in beyond if k != key]
    also = f" (also {', '.join(others)})" if others else ""
    size, off = shown_size(found, key), 100 * beyond[key]
    return (
        f" Yet {in_words(key)} of up to {size} would not be significant, and changes E by up to {off:.0f} %, more "
        f"than its interval{also}."
    )


def allowed_for(found: Diagnosis) -> list[str]:
    """Return a sentence on what E's interval includes besides the noise, where it is much wider."""
    E, alone = found.material.after.youngs_modulus, found.material.alone_MPa
    if E.interval95 is None or alone is None or not found.material.unseen:
        return []
    wider = (E.interval95[1] - E.interval95[0]) / (alone[1] - alone[0]) - 1 if alone[1] > alone[0] else 0.0
    if wider < WIDER:
        return []
    most = found.material.unseen[0].chance * found.material.unseen[0].off ** 2
    named = [in_words(u.key) for u in found.material.unseen[:3] if u.chance * u.off**2 > NEAR * most]
    without = wording.estimate(replace(E, interval95=alone))
    return [f"E's interval allows for undetected effects, above all {', '.join(named)}; without them: {without}."]


def amount(first: Parameter, size: float) -> str:
    """Return a size of a parameter in words."""
    if first.name in SHARES:
        return f"{100 * size:.0f} %"
    return f"{size:.2g}" + ("" if first.unit == "1" else f" {first.unit}")


def _odd(found: Diagnosis) -> str:
    """Return what is unusual among the presses, in words."""
    odd, parts = found.presses.odd, []
    if odd.presses:
        many = "press" if len(odd.presses) == 1 else "presses"
        why = (
            "cannot belong to the others (indenter, place, bubble?)"
            if odd.foreign or not found.presses.set_aside
            else "is an outlier, as in heavy-tailed noise"
        )
        parts.append(f"{many} {', '.join(odd.presses)} {why}")
    if odd.wanders:
        since = f", since press {found.remainder.change_point}" if found.remainder.change_point else ""
        on = " and ".join(wording.covariate(name) for name, _ in odd.wanders[:2])
        parts.append(f"the presses' zeros change with {on}{since}")
    if odd.scattered:
        noise = found.fits.fitted.noise
        parts.append(f"repeated presses scatter by {100 * noise.gain:.1f} % and {KILO * noise.zero_mm:.0f} µm")
    said = "; ".join(parts)
    return said[0].upper() + said[1:]


def _left(found: Diagnosis) -> str:
    """Return the properties of the residual, in half a sentence."""
    left = found.remainder.left
    if left is None:
        return ""
    on = " and ".join(list(dict.fromkeys(wording.covariate(key) for key in left.covariates))[:2])
    parts = [f"it depends on {on}"] if on else []
    if left.size_N > 0:
        over = f" and varies over {left.length_mm:.2g} mm of depth" if np.isfinite(left.length_mm) else ""
        parts.append(f"is about {KILO * left.size_N:.0f} mN large{over}")
    if found.remainder.change_point is not None:
        parts.append(f"occurs since press {found.remainder.change_point}")
    return f" ({', '.join(parts)})" if parts else ""


def _otherwise(found: Diagnosis) -> str:
    """Return the instrument error that explains a misfit as well as effects together, or better."""
    plain = found.remainder.alternative_explanation
    assert plain is not None
    sizes = ", ".join(f"{p.meaning} {amount(p, value)}" for p, value in plain.sizes)
    keys = [in_words(key) for key in plain.instead_of]
    if not keys:
        return f"{plain.words} ({sizes}) comes nearest to it"
    better = "better than" if plain.cheaper > 0 else "as well as"
    together = " together" if len(keys) > 1 else ""
    return f"{plain.words} ({sizes}) explains it {better} {' and '.join(keys)}{together}"


def _nearest(found: Diagnosis) -> str:
    """Return a sentence on the effect nearest to the misfit."""
    if found.remainder.nearest is None or found.remainder.nearest[1] < NEAR:
        return " No effect of the catalogue comes near it."
    keys, share = found.remainder.nearest
    named = " with ".join(in_words(key) for key in keys.split("+"))
    return f" Nearest to it comes {named}, which explains {100 * share:.0f} % of it."


def _instrument_error(found: Diagnosis) -> str:
    """Return a sentence on the instrument error nearest to the misfit."""
    if found.remainder.plain is None or not isinstance(found.remainder.plain.effect, InstrumentError):
        return ""
    effect, values = found.remainder.plain.effect, found.remainder.plain.own_values
    first, size = effect.parameters[0], float(values[0])
    return f" Of instrument errors the nearest is {effect.words} ({first.meaning} {amount(first, size)})."


def shown_size(found: Diagnosis, key: str) -> str:
    """Return the least significant size of an effect in words."""
    size = found.limits.visible[key]
    return amount(found.limits.sizes[key], size) if key in found.limits.sizes else f"{size:.2g}"
