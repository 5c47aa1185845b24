"""The verdict of a diagnosis in words: what is wrong with the rig or the gel, and what E's interval allows for."""

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

NEAR = 0.1  # of a misfit: an effect that explains less is not near it
SHOWN = 0.05  # adjusted p of an effect that stands out
WIDER = 0.1  # of an interval: less need not be said
OTHER_WORDS = {"youngs_modulus": "Young's modulus", "beta": "the slope β"}
SHARES = ("relative", "gain")  # parameters that are said in per cent


def in_words(key: str) -> str:
    """The name of an effect, or of what it is confused with, as a person says it."""
    return OTHER_WORDS.get(key) or key.replace("_", " ")


def verdict_sentence(found: Diagnosis) -> str:
    """What is wrong with the rig or the gel, in one sentence; then whether E rests on a nu that no gel has."""
    stated = stated_outside_gels(found.fits.base.data.gel)
    return f"{_verdict_sentence(found)} {stated}." if stated else _verdict_sentence(found)


def _verdict_sentence(found: Diagnosis) -> str:
    """With presses set aside, also what holds without."""
    if found.presses.set_aside:
        return _without(found)
    if found.stopped and not found.effects:
        return _so_far(found)
    named = " and ".join(in_words(effect.key) for effect in found.effects)
    held = 1e3 * found.errors.held_out_before, 1e3 * found.errors.held_out_after
    way = "falls" if held[1] < held[0] else "goes"
    fall = f"; the error on presses left out {way} from {held[0]:.1f} to {held[1]:.1f} mN"
    if not any(effect.key in found.fits.fitted.model.keys for effect in found.effects):
        fall = "; the forces themselves are explained as well as they repeat"
    match found.verdict:
        case "ADEQUATE":
            bent = " The curve bends as finite elements have it." if "bend_within_theory" in found.flags else ""
            said = "The model explains these data as well as they repeat: nothing is missing that they could show."
            return said + bent + few_sentence(found) + unseen_sentence(found)
        case "IDENTIFIED":
            return f"Something is missing from the model, and it is {named}{fall if found.effects else ''}."
        case "AMBIGUOUS":
            return _ambiguous(found)
        case _ if found.presses.odd:
            return f"{_odd(found)}.{_plainly(found)} Look at these presses before E is used."
        case _ if found.remainder.alternative_explanation is not None:
            return (
                f"Something is missing from the model, and no effect of the catalogue is it: {_otherwise(found)}."
            )
        case _ if found.remainder.left is None and found.search.sight is not None:
            with_it = f", {named} allowed for" if named else ""
            return (
                "The depth that the picture reads is off in a way that no effect of the catalogue explains."
                f"{_nearest(found)} The forces themselves are explained as well as they repeat{with_it}."
            )
        case _:
            known = f" beyond {named}" if named else ""
            what = f"that no effect of the catalogue explains{_left(found)}"
            return f"Something is missing from the model{known} {what}.{_nearest(found)}{_plainly(found)}"


def _ambiguous(found: Diagnosis) -> str:
    """What the data cannot tell apart: effects, or what stands behind a slope that is not the contact's."""
    several = ", ".join(in_words(key) for key in found.candidates)
    cannot = "these data cannot tell which of these is off instead"
    beta = wording.estimate(found.material.before.beta)
    if "beta_outside_theory" in found.flags and not found.effects:
        return f"A line fits, but no contact law allows its slope, beta = {beta}; {cannot}: {several}."
    if "beta_at_bound" in found.flags and not found.effects:
        return f"The slope stands at the end of its range, beta = {beta}; {cannot}: {several}, or a unit."
    return f"Something is missing from the model; these data cannot tell which of: {several}."


def _without(found: Diagnosis) -> str:
    """Which presses are set aside, and what holds without them."""
    aside, odd = found.presses, found.presses.odd
    rest = replace(found, verdict=aside.without, presses=OddPresses(replace(odd, presses=())))
    many = "it" if len(aside.set_aside) == 1 else "them"
    alone = _odd(replace(found, presses=replace(aside, odd=replace(odd, wanders=(), scattered=False))))
    return f"{alone}: set aside, to be looked at. Without {many}: {aside.without}. {_verdict_sentence(rest)}"


def _so_far(found: Diagnosis) -> str:
    """What a search that was stopped before it named anything has seen."""
    shown = [one.key for one in found.search.score_test if one.p_adjusted < SHOWN]
    if not shown:
        return "No effect stands out so far."
    most = ", then ".join(in_words(key) for key in shown[:2])
    seen = f"Something is missing from the model{_left(found)}"
    return f"{seen}; so far it looks most like {most}, which is not confirmed."


def stopped_sentence(found: Diagnosis) -> list[str]:
    """That the time was over before the search was, where it was."""
    if not found.stopped:
        return []
    return ["The time was over before the search was: this is the best answer so far, and others may be better."]


def reading_sentence(found: Diagnosis) -> list[str]:
    """What a wrong scale of the picture's depth is, beside what steep walls hide, so that one number stands."""
    read = set() if found.search.sight is None else {step.best.effect.key for step in found.search.sight.steps}
    gain = next((dict(e.parameters).get("gain") for e in found.effects if e.key in read), None)
    if found.search.sight is None or gain is None or gain.value is None:
        return []
    before, after = (
        1e3 * reading_error_mm(fitted) for fitted in (found.search.sight.base, found.search.sight.current)
    )
    fall = f"The error of the depth that the picture reads goes from {before:.1f} to {after:.1f} µm"
    hidden = " Punch faces read less still: steep walls hide part of their depth, which is no gain."
    return [f"{fall} on presses left out.{hidden if found.search.sight.base.data.slopes is not None else ''}"]


def few_sentence(found: Diagnosis) -> str:
    """What few curves cannot tell from how presses scatter; empty of points, and where there are enough."""
    data = found.fits.base.data
    if not few_presses(data):
        return ""
    return (
        f" {data.count} presses hardly tell what changes from one to the next (a day, a temperature, a place) "
        "from how presses scatter."
    )


def unseen_sentence(found: Diagnosis) -> str:
    """What would not have shown although it puts E off by more than its interval says; else empty."""
    E = found.material.after.youngs_modulus
    if E.value is None or E.interval95 is None:
        return ""
    reach = max(E.interval95[1] / E.value - 1, 1 - E.interval95[0] / E.value)
    beyond = {key: abs(b) for key, b in found.limits.below_visibility.items() if abs(b) > reach}
    if not beyond:
        return ""
    key = max(beyond, key=lambda k: beyond[k])
    others = [in_words(k) for k in beyond if k != key]
    also = f" (so could {', '.join(others)})" if others else ""
    size, off = shown_size(found, key), 100 * beyond[key]
    return (
        f" Yet {in_words(key)} of up to {size} would not have shown, and puts E off by up to {off:.0f} %, "
        f"more than its interval says{also}."
    )


def allowed_for(found: Diagnosis) -> list[str]:
    """What E's interval holds besides the noise, in a sentence, where that makes it wider."""
    E, alone = found.material.after.youngs_modulus, found.material.alone_MPa
    if E.interval95 is None or alone is None or not found.material.unseen:
        return []
    wider = (E.interval95[1] - E.interval95[0]) / (alone[1] - alone[0]) - 1 if alone[1] > alone[0] else 0.0
    if wider < WIDER:
        return []
    most = found.material.unseen[0].chance * found.material.unseen[0].off ** 2
    told = [in_words(u.key) for u in found.material.unseen[:3] if u.chance * u.off**2 > NEAR * most]
    without = wording.estimate(replace(E, interval95=alone))
    return [f"E's interval allows for what may be there unseen, above all {', '.join(told)}; without: {without}."]


def amount(first: Parameter, size: float) -> str:
    """A size of a parameter in words."""
    if first.name in SHARES:
        return f"{100 * size:.0f} %"
    return f"{size:.2g}" + ("" if first.unit == "1" else f" {first.unit}")


def _odd(found: Diagnosis) -> str:
    """What is odd among the presses, in words."""
    odd, parts = found.presses.odd, []
    if odd.presses:
        many = "press" if len(odd.presses) == 1 else "presses"
        why = (
            "cannot belong to the others (indenter, place, bubble?)"
            if odd.foreign or not found.presses.set_aside
            else "lies far out, as readings with heavy tails do"
        )
        parts.append(f"{many} {', '.join(odd.presses)} {why}")
    if odd.wanders:
        since = f", since press {found.remainder.change_point}" if found.remainder.change_point else ""
        on = " and ".join(wording.covariate(name) for name, _ in odd.wanders[:2])
        parts.append(f"the presses' zeros change with {on}{since}")
    if odd.scattered:
        noise = found.fits.fitted.noise
        parts.append(f"like presses scatter by {100 * noise.gain:.1f} % and {1e3 * noise.zero_mm:.0f} µm")
    said = "; ".join(parts)
    return said[0].upper() + said[1:]


def _left(found: Diagnosis) -> str:
    """What is left, in half a sentence."""
    left = found.remainder.left
    if left is None:
        return ""
    on = " and ".join(list(dict.fromkeys(wording.covariate(key) for key in left.covariates))[:2])
    parts = [f"it depends on {on}"] if on else []
    if left.size_N > 0:
        over = f" and varies over {left.length_mm:.2g} mm of depth" if np.isfinite(left.length_mm) else ""
        parts.append(f"is about {1e3 * left.size_N:.0f} mN large{over}")
    if found.remainder.change_point is not None:
        parts.append(f"is there since press {found.remainder.change_point}")
    return f" ({', '.join(parts)})" if parts else ""


def _otherwise(found: Diagnosis) -> str:
    """What explains a misfit as well as effects together, or better than what was tried."""
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
    """What came nearest, in a sentence."""
    if found.remainder.nearest is None or found.remainder.nearest[1] < NEAR:
        return " Nothing in the catalogue comes near it."
    keys, share = found.remainder.nearest
    named = " with ".join(in_words(key) for key in keys.split("+"))
    return f" Nearest to it comes {named}, which explains {100 * share:.0f} % of it."


def _plainly(found: Diagnosis) -> str:
    """The plain error of an instrument that comes nearest, in a sentence."""
    if found.remainder.plain is None or not isinstance(found.remainder.plain.effect, InstrumentError):
        return ""
    effect, values = found.remainder.plain.effect, found.remainder.plain.own_values
    first, size = effect.parameters[0], float(values[0])
    return f" Of plain errors one comes nearest: {effect.words} ({first.meaning} {amount(first, size)})."


def shown_size(found: Diagnosis, key: str) -> str:
    """From which size on an effect would have shown, in words."""
    size = found.limits.visible[key]
    return amount(found.limits.sizes[key], size) if key in found.limits.sizes else f"{size:.2g}"
