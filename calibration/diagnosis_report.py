"""The page of a diagnosis: the verdict in one sentence, then the evidence, then what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration import page, wording
from calibration.diagnosis import Added, Diagnosis
from calibration.drawing import Card
from calibration.effects import EFFECTS, get_effect
from calibration.outside import WouldHaveToBe
from calibration.parameters import Parameter
from calibration.report import Picture
from calibration.screen import FAILED
from calibration.stages import EffectBase
from tactilevision.errors import InputError

NEAR = 0.1  # of a misfit: an effect that explains less is not near it
SHARES = ("relative", "gain")  # parameters that are said in per cent
OWN_IDEA = (
    "An idea what it is? Write it as an effect of your own and try it: tactilevision new-effect my_effect.py, "
    "then diagnose with --effect my_effect.py."
)


def in_words(key: str) -> str:
    """An effect's name as a person says it."""
    return key.replace("_", " ")


def verdict_sentence(found: Diagnosis) -> str:
    """What is wrong with the rig or the gel, in one sentence."""
    named = " and ".join(in_words(effect.key) for effect in found.effects)
    held = 1e3 * found.errors.held_out_before, 1e3 * found.errors.held_out_after
    way = "falls" if held[1] < held[0] else "goes"
    fall = f"; the error on presses left out {way} from {held[0]:.1f} to {held[1]:.1f} mN"
    if not any(effect.key in found.fitted.model.keys for effect in found.effects):
        fall = "; the forces themselves are explained as well as they repeat"
    match found.verdict:
        case "ADEQUATE":
            bent = " The curve bends as finite elements have it." if "bend_within_theory" in found.flags else ""
            said = "The model explains these data as well as they repeat: nothing is missing that they could show."
            return said + bent + unseen_sentence(found)
        case "IDENTIFIED":
            return f"Something is missing from the model, and it is {named}{fall if found.effects else ''}."
        case "AMBIGUOUS":
            several = ", ".join(in_words(key) for key in found.candidates)
            if "beta_outside_theory" in found.flags and not found.effects:
                beta = wording.estimate(found.before.beta)
                what = "A line fits, but no contact law allows its slope"
                return f"{what}, beta = {beta}; these data cannot tell which of these is off instead: {several}."
            return f"Something is missing from the model; these data cannot tell which of: {several}."
        case _ if found.odd:
            return f"{_odd(found)}. Look at these presses before E is used."
        case _:
            known = f" beyond {named}" if named else ""
            what = f"that no effect of the catalogue explains{_left(found)}"
            return f"Something is missing from the model{known} {what}.{_nearest(found)}"


def unseen_sentence(found: Diagnosis) -> str:
    """What would not have shown although it puts E off by more than its interval says; else empty."""
    E = found.after.youngs_modulus
    if E.value is None or E.interval95 is None:
        return ""
    reach = max(E.interval95[1] / E.value - 1, 1 - E.interval95[0] / E.value)
    beyond = {key: abs(b) for key, b in found.below_visibility.items() if abs(b) > reach}
    if not beyond:
        return ""
    key = max(beyond, key=lambda k: beyond[k])
    others = [in_words(k) for k in beyond if k != key]
    also = f" (so could {', '.join(others)})" if others else ""
    size, off = _shown_size(key, found.visible[key]), 100 * beyond[key]
    return (f" Yet {in_words(key)} of up to {size} would not have shown, and puts E off by up to {off:.0f} %, "
            f"more than its interval says{also}.")  # fmt: skip


def _amount(first: Parameter, size: float) -> str:
    """A size of a parameter in words."""
    if first.name in SHARES:
        return f"{100 * size:.0f} %"
    return f"{size:.2g}" + ("" if first.unit == "1" else f" {first.unit}")


def _odd(found: Diagnosis) -> str:
    """What is odd among the presses, in words."""
    odd, parts = found.odd, []
    if odd.presses:
        many = "press" if len(odd.presses) == 1 else "presses"
        parts.append(f"{many} {', '.join(odd.presses)} cannot belong to the others (indenter, place, bubble?)")
    if odd.wanders:
        since = f", since press {found.change_point}" if found.change_point else ""
        on = " and ".join(_said(name) for name, _ in odd.wanders[:2])
        parts.append(f"the presses' zeros change with {on}{since}")
    if odd.scattered:
        noise = found.fitted.noise
        parts.append(f"like presses scatter by {100 * noise.gain:.1f} % and {1e3 * noise.zero_mm:.0f} um")
    said = "; ".join(parts)
    return said[0].upper() + said[1:]


def _left(found: Diagnosis) -> str:
    """What is left, in half a sentence."""
    left = found.left
    if left is None:
        return ""
    on = " and ".join(list(dict.fromkeys(_said(key) for key in left.covariates))[:2])
    parts = [f"it depends on {on}"] if on else []
    if left.size_N > 0:
        over = f" and varies over {left.length_mm:.2g} mm of depth" if np.isfinite(left.length_mm) else ""
        parts.append(f"is about {1e3 * left.size_N:.0f} mN large{over}")
    if found.change_point is not None:
        parts.append(f"is there since press {found.change_point}")
    return f" ({', '.join(parts)})" if parts else ""


def _nearest(found: Diagnosis) -> str:
    """What came nearest, in a sentence."""
    if found.nearest is None or found.nearest[1] < NEAR:
        return " Nothing in the catalogue comes near it."
    keys, share = found.nearest
    named = " with ".join(in_words(key) for key in keys.split("+"))
    return f" Nearest to it comes {named}, which explains {100 * share:.0f} % of it."


def _said(name: str) -> str:
    """A covariate's name as a person says it."""
    return {
        "w": "the depth",
        "w/h": "the depth",
        "1/w": "the depth",
        "P": "the force",
        "t": "the time in the press",
        "a": "the punch's radius",
        "T": "the temperature",
        "x": "the place in x",
        "y": "the place in y",
        "log rate": "the speed",
        "wait": "the wait before",
        "load/unload": "loading or unloading",
    }.get(name, name)


def next_sentence(found: Diagnosis) -> str:
    """What to measure next."""
    if not found.measure_next:
        return ""
    best = found.measure_next[0]
    gain = (
        f", expected to part the candidates by {best.separation_sigma:.0f} std"
        if best.separation_sigma > 0
        else ""
    )
    return f"Measure next: {best.action} ({best.minutes:.0f} minutes{gain})."


def summary(found: Diagnosis) -> list[str]:
    """What a person at the terminal needs to see."""
    lines = [f"{found.verdict}: {verdict_sentence(found)}"]
    for effect in found.effects:
        values = ", ".join(f"{name} = {wording.estimate(value)}" for name, value in effect.parameters)
        lines.append(f"  {in_words(effect.key)}: {values}; p {wording.p_value(effect.p_adjusted)}")
    lines += [f"  {w.key}: {w.parameter} would have to be {_size(w)} (R^2 {w.r_squared:.4f})"
              for w in found.would_have_to_be]  # fmt: skip
    if found.change_point is not None:
        lines.append(f"  since press {found.change_point}")
    before, after = found.before.youngs_modulus, found.after.youngs_modulus
    lines.append(f"E before: {wording.estimate(before)}")
    if found.effects:
        lines.append(f"E after:  {wording.estimate(after)}")
    if found.not_testable:
        lines.append("not testable with these data: " + ", ".join(in_words(key) for key in found.not_testable))
    lines += [f"  {in_words(key)}: {why}" for key, why in found.not_testable.items() if why.startswith(FAILED)]
    return [*lines, *([next_sentence(found)] if found.measure_next else [])]


@dataclass(frozen=True, slots=True)
class Drawn:
    """One candidate's card with its picture; None where it could not be drawn."""

    card: Card
    picture: Picture | None


def diagnosis_page(title: str, found: Diagnosis, figures: Sequence[Picture], cards: Sequence[Drawn] = ()) -> str:
    """The whole page."""
    return page.page(
        title,
        _head(found),
        page.section("The evidence", *(page.figure(p.data_uri, p.caption) for p in figures)),
        page.section("Candidates", *(_card(drawn, found) for drawn in cards)),
        page.section("What it does to the material", _material(found)),
        page.section("Where beta does not fit theory", _outside(found)),
        page.section("What to measure next", _next(found)),
        page.section("Not testable with these data", _untestable(found)),
        page.section("Too small to show", _from_here_on(found)),
    )  # fmt: skip


def _head(found: Diagnosis) -> str:
    """What a reader in a hurry takes away."""
    lines = [page.paragraph(f"{found.verdict}. {verdict_sentence(found)}", kind="lead")]
    lines += [page.paragraph(_in_plain_words(effect)) for effect in found.effects]
    lines += [page.paragraph(_needed(w)) for w in found.would_have_to_be]
    lines += [page.paragraph(text) for text in _material_moves(found)]
    if found.verdict == "UNKNOWN":
        lines.append(page.paragraph(OWN_IDEA))
    lines.append(page.paragraph(next_sentence(found)) if found.measure_next else "")
    return page.block("verdict " + ("clean" if found.verdict == "ADEQUATE" else "found"), *lines)


def _material_moves(found: Diagnosis) -> list[str]:
    """What the finding does to E, in a sentence."""
    before, after = found.before.youngs_modulus, found.after.youngs_modulus
    if not found.effects or before.value is None or after.value is None:
        return []
    if found.fitted is found.base:
        return [f"Young's modulus rests on the certified depths and stays {wording.estimate(after)}."]
    return [f"With it, Young's modulus is {wording.estimate(after)}; without, it would read "
            f"{wording.estimate(before)}."]  # fmt: skip


def _needed(one: WouldHaveToBe) -> str:
    """What one candidate would have to be."""
    what = f"{in_words(one.key).capitalize()}: {_parameter(one.parameter)} would have to be {_size(one)}"
    return f"{what}; the line would stay straight to R² = {one.r_squared:.4f}."


def _size(one: WouldHaveToBe) -> str:
    if one.parameter in SHARES:
        return f"{100 * one.value:+.0f} %"
    return f"{one.value:.3g}" + ("" if one.unit == "1" else f" {one.unit}")


def _in_plain_words(added: Added) -> str:
    about = _about(added.key)
    said = about.title if about is not None and about.title else in_words(added.key)
    values = ", ".join(f"{_parameter(name)} {wording.estimate(value)}" for name, value in added.parameters)
    return f"{in_words(added.key).capitalize()}: {said}; {values}."


def _parameter(name: str) -> str:
    """A parameter's name without the unit, which its value carries."""
    for unit in ("_mm_per_N", "_N_per_mm", "_per_mm", "_rad", "_days", "_mm", "_N", "_s"):
        name = name.removesuffix(unit)
    return name.replace("_", " ")


def _about(key: str) -> EffectBase | None:
    try:
        effect = get_effect(key)
    except InputError:
        return None
    return effect if isinstance(effect, EffectBase) else None


def _card(drawn: Drawn, found: Diagnosis) -> str:
    key = drawn.card.key
    about = _about(key)
    rows = [(_parameter(name), f"{wording.number(value)} {unit if unit != '1' else ''}".strip())
            for name, value, unit in drawn.card.values]  # fmt: skip
    for added in found.effects:
        if added.key == key:
            rows = [(_parameter(name), wording.estimate(value)) for name, value in added.parameters]
            rows += [("could be chance (p, for all looks)", wording.p_value(added.p_adjusted)),
                     ("error taken off presses left out", f"{100 * added.transfer_skill:.0f} %")]  # fmt: skip
    if about is not None:
        rows += [("seen against", ", ".join(about.seen_in)),
                 ("confused with", ", ".join(in_words(k) for k in about.confused_with)),
                 ("told apart by", "; ".join(about.separated_by)), ("source", about.source)]  # fmt: skip
    title = (
        f"{in_words(key)}: {about.title}" if about is not None and about.title else f"{in_words(key)}: your own"
    )
    picture = "" if drawn.picture is None else page.figure(drawn.picture.data_uri, drawn.picture.caption)
    return page.block("card", page.heading(title), picture, page.table(("", ""), [row for row in rows if row[1]]))


def _material(found: Diagnosis) -> str:
    names = (("Young's modulus E", "youngs_modulus"), ("Poisson's ratio ν", "poisson_ratio"), ("stiffness c", "c"),
             ("slope β", "beta"))  # fmt: skip
    rows = [
        (title, *(wording.estimate(getattr(result, name)) for result in (found.before, found.after)))
        for title, name in names
    ]
    return page.table(("", "before", "after"), rows)


def _outside(found: Diagnosis) -> str:
    rows = [
        (
            in_words(w.key),
            f"{w.parameter} = {_size(w)}",
            f"{w.r_squared:.4f}",
            f"{1e3 * w.rms_error_N:.1f}",
        )
        for w in found.would_have_to_be
    ]
    return page.table(
        ("candidate", "what it would have to be", "R² of P/w", "rms error (mN)"), rows, numbers=(2, 3)
    )


def _next(found: Diagnosis) -> str:
    rows = [(a.action, f"{a.minutes:.0f}", f"{a.separation_sigma:.1f}" if a.separation_sigma > 0 else "–")
            for a in found.measure_next]  # fmt: skip
    return page.table(("do", "minutes", "expected separation (std)"), rows, numbers=(1, 2))


def _untestable(found: Diagnosis) -> str:
    rows = [(in_words(key), why, _bias(found.possible_bias.get(key))) for key, why in found.not_testable.items()]
    return page.table(("effect", "why", "E could be off by"), rows, numbers=(2,))


def _from_here_on(found: Diagnosis) -> str:
    """What would have shown, from which size on, and what smaller could do to E."""
    rows = [(in_words(key), _shown_size(key, found.visible[key]), _bias(share))
            for key, share in found.below_visibility.items()]  # fmt: skip
    return page.table(("effect", "shows from", "smaller, E could be off by up to"), rows, numbers=(2,))


def _shown_size(key: str, size: float) -> str:
    return _amount(get_effect(key).parameters[0], size) if key in EFFECTS else f"{size:.2g}"


def _bias(share: float | None) -> str:
    return "unknown" if share is None else f"{100 * abs(share):.1f} %"
