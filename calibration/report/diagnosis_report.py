"""The page of a diagnosis: the verdict in one sentence, then the evidence, then what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.diagnosis.diagnosis import Added, Diagnosis
from calibration.diagnosis.inadmissible_beta import InadmissibleBeta
from calibration.diagnosis.score_test import FAILED
from calibration.effects import PLAIN, get_effect
from calibration.model.stages import EffectBase
from calibration.report import page, wording
from calibration.report.drawing import Card
from calibration.report.report import Picture
from calibration.report.verdict import (
    SHARES,
    allowed_for,
    in_words,
    reading_sentence,
    shown_size,
    stopped_sentence,
    verdict_sentence,
)
from tactilevision.errors import InputError

MISFIT = 0.05  # p of the most telling covariate, below which the page says that the model fails
ANEW = (
    " Below, what was read is corrected by these sizes; `compare` excludes what a wall may shade instead, to "
    "another error."
)
OWN_IDEA = (
    "An idea what it is? Write it as an effect of your own and try it: tactilevision new-effect my_effect.py, "
    "then diagnose with --effect my_effect.py."
)


def next_sentence(found: Diagnosis) -> str:
    """What to measure next."""
    if not found.measure_next:
        return ""
    best = found.measure_next[0]
    gain = (
        f", expected to tell the candidates apart by {best.separation_sigma:.0f} std"
        if best.separation_sigma > 0
        else ""
    )
    return f"Measure next: {best.action} ({best.minutes:.0f} minutes{gain})."


def summary(found: Diagnosis) -> list[str]:
    """What a person at the terminal needs to see."""
    lines = [f"{found.verdict}: {verdict_sentence(found)}", *stopped_sentence(found), *reading_sentence(found)]
    lines += [
        f"  {in_words(effect.key)}: {_values(effect)}; p {wording.p_value(effect.p_adjusted)}"
        for effect in found.effects
    ]
    lines += [
        f"  {w.key}: {w.parameter} would have to be {_size(w)} (R^2 {w.r_squared:.4f})"
        for w in found.would_have_to_be
    ]
    if found.change_point is not None:
        lines.append(f"  since press {found.change_point}")
    before, after = found.before.youngs_modulus, found.after.youngs_modulus
    if found.effects:
        lines += [f"E before: {wording.estimate(before)}", f"E after:  {wording.estimate(after)}"]
    else:
        lines.append(f"E: {wording.estimate(after)}")
    lines += allowed_for(found)
    if found.not_testable:
        lines.append("not testable with these data: " + ", ".join(in_words(key) for key in found.not_testable))
    lines += [f"  {in_words(key)}: {why}" for key, why in found.not_testable.items() if why.startswith(FAILED)]
    return [*lines, *([next_sentence(found)] if found.measure_next else [])]


@dataclass(frozen=True, slots=True)
class Drawn:
    """One candidate's card with its picture; None where it could not be drawn."""

    card: Card
    picture: Picture | None


@dataclass(frozen=True, slots=True)
class Evidence:
    """The pictures of a diagnosis in the order of its story, and a card a candidate.

    `misfit` where the model fails; `fall` how the error falls; `picture` of the depth that the picture reads;
    `material` E before and after; `alike` what can be told apart; `every_press` all presses, folded away; `plain`
    the plain error nearest to what no effect explains.
    """

    misfit: Sequence[Picture] = ()
    fall: Sequence[Picture] = ()
    picture: Sequence[Picture] = ()
    material: Sequence[Picture] = ()
    alike: Sequence[Picture] = ()
    every_press: Sequence[Picture] = ()
    cards: Sequence[Drawn] = ()
    plain: Drawn | None = None


def diagnosis_page(title: str, found: Diagnosis, shown: Evidence, *, commands: Sequence[str] = ()) -> str:
    """The whole page: the verdict, the misfit, what explains it, what does not, the material, what to do next.

    `commands`: what to try, ready to run.
    """
    standing = [one for one in shown.cards if one.card.key not in found.tried]
    failed = [one for one in shown.cards if one.card.key in found.tried]
    plain = [] if shown.plain is None else [_plain(shown.plain)]
    return page.page(
        title,
        _head(found),
        *_misfit(found, shown),
        page.section(
            _explains(found),
            *plain,
            *_figures(shown.fall),
            *(_card(one, found) for one in standing),
            _outside(found),
        ),
        page.folded(
            "Looked at so far" if found.stopped else "Tried, and does not explain it",
            *(_card(one, found) for one in failed),
        ),
        page.section("E before and after", *_figures(shown.material), _material(found)),
        page.section("What to measure next", _next(found)),
        page.section("To try, ready to run", *(page.command(text) for text in commands)),
        page.folded("Can these data tell effects apart?", *_figures(shown.alike)),
        page.folded("Not testable with these data", _untestable(found)),
        page.folded("Too small to show", _from_here_on(found)),
    )


def _misfit(found: Diagnosis, shown: Evidence) -> list[str]:
    """Where the model fails: of the force, unless the picture's depth alone does; the other folded away."""
    force = [*_figures(shown.misfit), page.folded("Every press", *_figures(shown.every_press))]
    seen = _figures(shown.picture)
    if found.effects and not any(effect.key in found.fitted.model.keys for effect in found.effects):
        quiet = page.folded("The forces, which the model explains as well as they repeat", *force)
        return [page.section("Where the picture's depth fails", *seen, quiet)]
    fails = min((one.p_adjusted for one in found.covariates_before), default=1.0) < MISFIT
    return [
        page.section("Where the model fails" if fails else "Measured and modelled force", *force),
        page.folded("The depth that the picture reads, against the certified one", *seen),
    ]


def _figures(pictures: Sequence[Picture]) -> list[str]:
    return [page.figure(one.data_uri, one.caption) for one in pictures]


def _explains(found: Diagnosis) -> str:
    """The heading over the candidates."""
    if found.verdict == "UNKNOWN":
        return "What comes nearest"
    return "What may explain it" if len(found.candidates) > len(found.effects) else "What explains it"


def _plain(drawn: Drawn) -> str:
    """The plain error nearest to what no effect explains."""
    rows = [(_meaning(drawn.card.key, name), _with_unit(v, unit)) for name, v, unit in drawn.card.values]
    effect = PLAIN[drawn.card.key]
    words = getattr(effect, "words", in_words(effect.key))
    said = page.paragraph(
        "No effect of the catalogue has this form. A plain error of an instrument comes nearest; a rig has it or "
        "not, and only another measurement says which."
    )
    picture = "" if drawn.picture is None else page.figure(drawn.picture.data_uri, drawn.picture.caption)
    return page.block("card", page.heading(f"Plain error: {words}"), picture, said, page.table(("", ""), rows))


def _with_unit(value: float, unit: str) -> str:
    return f"{wording.number(value)} {unit if unit != '1' else ''}".strip()


def _head(found: Diagnosis) -> str:
    """What a reader in a hurry takes away."""
    lines = [page.paragraph(f"{found.verdict}. {verdict_sentence(found)}", kind="lead")]
    lines += [page.paragraph(text) for text in (*stopped_sentence(found), *reading_sentence(found))]
    lines += [page.paragraph(_in_plain_words(effect)) for effect in found.effects]
    lines += [page.paragraph(_needed(w)) for w in found.would_have_to_be]
    lines += [page.paragraph(text) for text in (*_material_moves(found), *allowed_for(found))]
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
    return [
        f"With it, Young's modulus is {wording.estimate(after)}; without, it would read "
        f"{wording.estimate(before)}."
    ]


def _needed(one: InadmissibleBeta) -> str:
    """What one candidate would have to be."""
    what = f"{in_words(one.key).capitalize()}: {_parameter(one.parameter)} would have to be {_size(one)}"
    return f"{what}; the line would stay straight to R² = {one.r_squared:.4f}."


def _size(one: InadmissibleBeta) -> str:
    if one.parameter in SHARES:
        return f"{100 * one.value:+.0f} %"
    return f"{one.value:.3g}" + ("" if one.unit == "1" else f" {one.unit}")


def _in_plain_words(added: Added) -> str:
    about = _about(added.key)
    said = about.title if about is not None and about.title else in_words(added.key)
    anew = ANEW if about is not None and about.treatment else ""
    return f"{in_words(added.key).capitalize()}: {said}; {_values(added)}.{anew}"


def _parameter(name: str) -> str:
    """A parameter's name without the unit, which its value carries."""
    for unit in ("_mm_per_N", "_N_per_mm", "_per_mm", "_rad", "_days", "_mm", "_N", "_s"):
        name = name.removesuffix(unit)
    return name.replace("_", " ")


def _meaning(key: str, name: str) -> str:
    """What an effect's parameter means, as every page says it."""
    effect = PLAIN.get(key) or _about(key)
    known = {} if effect is None else {p.name: p.meaning for p in effect.parameters}
    return known.get(name) or _parameter(name)


def _values(added: Added) -> str:
    """An effect's parameters, in words."""
    return ", ".join(f"{_meaning(added.key, name)} {wording.estimate(value)}" for name, value in added.parameters)


def _about(key: str) -> EffectBase | None:
    try:
        effect = get_effect(key)
    except InputError:
        return None
    return effect if isinstance(effect, EffectBase) else None


def _card(drawn: Drawn, found: Diagnosis) -> str:
    key = drawn.card.key
    about = _about(key)
    rows = [(_meaning(key, name), _with_unit(value, unit)) for name, value, unit in drawn.card.values]
    for added in found.effects:
        if added.key == key:
            rows = [(_meaning(key, name), wording.estimate(value)) for name, value in added.parameters]
            rows += [
                ("chance that it is none (p)", wording.p_value(added.p_adjusted)),
                *_fall_of(found, key),
            ]
    if about is not None:
        rows += [
            ("seen against", ", ".join(dict.fromkeys(wording.covariate(name) for name in about.seen_in))),
            ("confused with", ", ".join(in_words(k) for k in about.confused_with)),
            ("told apart by", "; ".join(about.separated_by)),
            ("source", about.source),
        ]
    title = (
        f"{in_words(key)}: {about.title}" if about is not None and about.title else f"{in_words(key)}: your own"
    )
    picture = "" if drawn.picture is None else page.figure(drawn.picture.data_uri, drawn.picture.caption)
    return page.block("card", page.heading(title), picture, page.table(("", ""), [row for row in rows if row[1]]))


def _fall_of(found: Diagnosis, key: str) -> list[tuple[str, str]]:
    """What adding an effect of the force did to the error, as in the picture of its fall."""
    keys = [effect.key for effect in found.effects if effect.key in found.fitted.model.keys]
    if key not in keys or len(found.held_out) <= len(keys):
        return []
    before, after = (1e3 * found.held_out[keys.index(key) + k] for k in (0, 1))
    return [("error on presses left out", f"from {before:.1f} to {after:.1f} mN")]


def after_words(found: Diagnosis) -> str:
    """What E after a diagnosis is of."""
    bent = ",\nbent as theory allows" if "bend_within_theory" in found.flags else ""
    return ("with what was found" if found.effects else "with all that may be missing") + bent


def _material(found: Diagnosis) -> str:
    names = (
        ("Young's modulus E", "youngs_modulus"),
        ("Poisson's ratio ν", "poisson_ratio"),
        ("stiffness c", "c"),
        ("slope β", "beta"),
    )
    rows = [
        (title, *(wording.estimate(getattr(result, name)) for result in (found.before, found.after)))
        for title, name in names
    ]
    return page.table(("", "plain law", after_words(found)), rows)


def _outside(found: Diagnosis) -> str:
    rows = [
        (in_words(w.key), f"{w.parameter} = {_size(w)}", f"{w.r_squared:.4f}", f"{1e3 * w.rms_error_N:.1f}")
        for w in found.would_have_to_be
    ]
    return page.table(
        ("candidate", "what it would have to be", "R² of P/w", "rms error (mN)"), rows, numbers=(2, 3)
    )


def _next(found: Diagnosis) -> str:
    parted = any(a.separation_sigma > 0 for a in found.measure_next)
    rows = [
        (
            a.action,
            f"{a.minutes:.0f}",
            *([f"{a.separation_sigma:.1f}" if a.separation_sigma > 0 else "–"] * parted),
        )
        for a in found.measure_next
    ]
    head = ("do", "minutes", *(["tells the candidates apart by (std; 3 are enough)"] * parted))
    return page.table(head, rows, numbers=(1, 2))


def _untestable(found: Diagnosis) -> str:
    rows = [(in_words(key), why, _bias(found.possible_bias.get(key))) for key, why in found.not_testable.items()]
    return page.table(("effect", "why", "E could be off by"), rows, numbers=(2,))


def _from_here_on(found: Diagnosis) -> str:
    """What would have shown, from which size on, and what smaller could do to E."""
    rows = [(in_words(key), shown_size(found, key), _bias(share)) for key, share in found.below_visibility.items()]
    return page.table(("effect", "shows from", "smaller, E could be off by up to"), rows, numbers=(2,))


def _bias(share: float | None) -> str:
    if share is None:
        return "unknown"
    return f"{100 * abs(share):.1f} %" if share else "not at all"
