"""Page of a diagnosis: the verdict in one sentence, the evidence, and what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.diagnosis.diagnosis import Added, Diagnosis
from calibration.diagnosis.inadmissible_beta import InadmissibleBeta
from calibration.diagnosis.score_test import Failure
from calibration.effects import PLAIN, get_effect
from calibration.model.stages import EffectBase
from calibration.report import page, wording
from calibration.report.drawing import Card
from calibration.report.misfit import BASE
from calibration.report.page import Picture
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
from tactilevision.records.constants import KILO

MISFIT = 0.05  # smallest p of a covariate below which the page reports a misfit
ANEW = (
    " Below, the depths are corrected by these sizes; `compare` excludes what a wall may shade instead, to "
    "another error."
)
OWN_IDEA = (
    "To test an idea of your own, write it as an effect: tactilevision new-effect my_effect.py, then diagnose "
    "with --effect my_effect.py."
)


def next_sentence(found: Diagnosis) -> str:
    """Return the sentence on what to measure next."""
    if not found.measure_next:
        return ""
    best = found.measure_next[0]
    gain = (
        f", expected to separate the candidates by {best.separation_sigma:.0f} std"
        if best.separation_sigma > 0
        else ""
    )
    return f"Measure next: {best.action} ({best.minutes:.0f} minutes{gain})."


def summary(found: Diagnosis) -> list[str]:
    """Return the lines for the terminal."""
    lines = [f"{found.verdict}: {verdict_sentence(found)}", *stopped_sentence(found), *reading_sentence(found)]
    lines += [
        f"  {in_words(effect.key)}: {_values(effect)}; p {wording.p_value(effect.p_adjusted)}"
        for effect in found.effects
    ]
    lines += [
        f"  {w.key}: {w.parameter} would have to be {_size(w)} (R^2 {w.r_squared:.4f})"
        for w in found.remainder.would_have_to_be
    ]
    if found.remainder.change_point is not None:
        lines.append(f"  since press {found.remainder.change_point}")
    before, after = found.material.before.youngs_modulus, found.material.after.youngs_modulus
    if found.effects:
        lines += [f"E before: {wording.estimate(before)}", f"E after:  {wording.estimate(after)}"]
    else:
        lines.append(f"E: {wording.estimate(after)}")
    lines += allowed_for(found)
    if found.limits.not_testable:
        lines.append(
            "not testable with these data: " + ", ".join(in_words(key) for key in found.limits.not_testable)
        )
    lines += [
        f"  {in_words(key)}: {why}" for key, why in found.limits.not_testable.items() if isinstance(why, Failure)
    ]
    return [*lines, *([next_sentence(found)] if found.measure_next else [])]


@dataclass(frozen=True, slots=True)
class Drawn:
    """A candidate's card with its picture; None where there is none."""

    card: Card
    picture: Picture | None


@dataclass(frozen=True, slots=True)
class Evidence:
    """Pictures of a diagnosis in the order of the page, and a card a candidate.

    `misfit` of the forces; `fall` of the error; `picture` of the reconstructed depth; `material` E before and
    after; `alike` the separation of effects; `every_press` all presses, folded; `plain` the instrument error
    nearest to what no effect explains.
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
    """Return the page: verdict, misfit, what explains it and what does not, the material, and what to do next.

    `commands`: commands to try.
    """
    standing = [one for one in shown.cards if one.card.key not in found.search.tried]
    failed = [one for one in shown.cards if one.card.key in found.search.tried]
    plain = [] if shown.plain is None else [_plain(shown.plain)]
    return page.page(
        title,
        _head(found),
        *_misfit(found, shown),
        page.section(
            _explains(found),
            *plain,
            *page.figures(shown.fall),
            *(_card(one, found) for one in standing),
            _outside(found),
        ),
        page.folded(
            "Examined so far" if found.stopped else "Tried, and does not explain it",
            *(_card(one, found) for one in failed),
        ),
        page.section("E before and after", *page.figures(shown.material), _material(found)),
        page.section("What to measure next", _next(found)),
        page.section("Commands to try", *(page.command(text) for text in commands)),
        page.folded("Can these data distinguish the effects?", *page.figures(shown.alike)),
        page.folded("Not testable with these data", _untestable(found)),
        page.folded("Effects too small to be significant", _from_here_on(found)),
    )


def _misfit(found: Diagnosis, shown: Evidence) -> list[str]:
    """Return the misfit of the force, or of the reconstructed depth where only that fails; the other is folded."""
    force = [*page.figures(shown.misfit), page.folded("Every press", *page.figures(shown.every_press))]
    depth = page.figures(shown.picture)
    if found.effects and not any(effect.key in found.fits.fitted.model.keys for effect in found.effects):
        quiet = page.folded("The forces, which the model explains within their repeatability", *force)
        return [page.section("Where the reconstructed depth fails", *depth, quiet)]
    fails = min((one.p_adjusted for one in found.search.covariates_before), default=1.0) < MISFIT
    return [
        page.section("Where the model fails" if fails else "Measured and modelled force", *force),
        page.folded("The reconstructed depth compared with the certified one", *depth),
    ]


def _explains(found: Diagnosis) -> str:
    """Return the heading of the candidates."""
    if found.verdict == "UNKNOWN":
        return "What comes nearest"
    return "What may explain it" if len(found.candidates) > len(found.effects) else "What explains it"


def _plain(drawn: Drawn) -> str:
    """Return the card of the instrument error nearest to what no effect explains."""
    rows = [(_meaning(drawn.card.key, name), _with_unit(v, unit)) for name, v, unit in drawn.card.values]
    effect = PLAIN[drawn.card.key]
    words = getattr(effect, "words", in_words(effect.key))
    said = page.paragraph(
        "No effect of the catalogue has this form. An instrument error comes nearest; only another measurement "
        "can show whether the rig has it."
    )
    picture = "" if drawn.picture is None else page.figure(drawn.picture.data_uri, drawn.picture.caption)
    return page.block(
        "card", page.heading(f"Instrument error: {words}"), picture, said, page.table(("", ""), rows)
    )


def _with_unit(value: float, unit: str) -> str:
    return f"{wording.number(value)} {unit if unit != '1' else ''}".strip()


def _head(found: Diagnosis) -> str:
    """Return the verdict and its consequences."""
    lines = [page.paragraph(f"{found.verdict}. {verdict_sentence(found)}", kind="lead")]
    lines += [page.paragraph(text) for text in (*stopped_sentence(found), *reading_sentence(found))]
    lines += [page.paragraph(_effect_sentence(effect)) for effect in found.effects]
    lines += [page.paragraph(_needed(w)) for w in found.remainder.would_have_to_be]
    lines += [page.paragraph(text) for text in (*_material_moves(found), *allowed_for(found))]
    if found.verdict == "UNKNOWN":
        lines.append(page.paragraph(OWN_IDEA))
    lines.append(page.paragraph(next_sentence(found)) if found.measure_next else "")
    return page.block("verdict " + ("clean" if found.verdict == "ADEQUATE" else "found"), *lines)


def _material_moves(found: Diagnosis) -> list[str]:
    """Return a sentence on E with and without the named effects."""
    before, after = found.material.before.youngs_modulus, found.material.after.youngs_modulus
    if not found.effects or before.value is None or after.value is None:
        return []
    if found.fits.fitted is found.fits.base:
        return [f"Young's modulus rests on the certified depths and stays {wording.estimate(after)}."]
    return [f"With it, Young's modulus is {wording.estimate(after)}; without it, {wording.estimate(before)}."]


def _needed(one: InadmissibleBeta) -> str:
    """Return the size that a candidate would need."""
    what = f"{in_words(one.key).capitalize()}: {_parameter(one.parameter)} would have to be {_size(one)}"
    return f"{what}; P/w would then be a straight line with R² = {one.r_squared:.4f}."


def _size(one: InadmissibleBeta) -> str:
    if one.parameter in SHARES:
        return f"{100 * one.value:+.0f} %"
    return f"{one.value:.3g}" + ("" if one.unit == "1" else f" {one.unit}")


def _effect_sentence(added: Added) -> str:
    about = _about(added.key)
    said = about.title if about is not None and about.title else in_words(added.key)
    anew = ANEW if about is not None and about.treatment else ""
    return f"{in_words(added.key).capitalize()}: {said}; {_values(added)}.{anew}"


def _parameter(name: str) -> str:
    """Return a parameter's name without its unit."""
    for unit in ("_mm_per_N", "_N_per_mm", "_per_mm", "_rad", "_days", "_mm", "_N", "_s"):
        name = name.removesuffix(unit)
    return name.replace("_", " ")


def _meaning(key: str, name: str) -> str:
    """Return the meaning of an effect's parameter."""
    effect = PLAIN.get(key) or _about(key)
    known = {} if effect is None else {p.name: p.meaning for p in effect.parameters}
    return known.get(name) or _parameter(name)


def _values(added: Added) -> str:
    """Return an effect's parameters in words."""
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
                ("p-value", wording.p_value(added.p_adjusted)),
                *_fall_of(found, key),
            ]
    if about is not None:
        rows += [
            ("seen against", ", ".join(dict.fromkeys(wording.covariate(name) for name in about.seen_in))),
            ("confused with", ", ".join(in_words(k) for k in about.confused_with)),
            ("distinguished by", "; ".join(about.separated_by)),
            ("source", about.source),
        ]
    title = (
        f"{in_words(key)}: {about.title}" if about is not None and about.title else f"{in_words(key)}: your own"
    )
    picture = "" if drawn.picture is None else page.figure(drawn.picture.data_uri, drawn.picture.caption)
    return page.block("card", page.heading(title), picture, page.table(("", ""), [row for row in rows if row[1]]))


def _fall_of(found: Diagnosis, key: str) -> list[tuple[str, str]]:
    """Return the change of the held-out error by adding an effect of the force."""
    keys = [effect.key for effect in found.effects if effect.key in found.fits.fitted.model.keys]
    if key not in keys or len(found.errors.held_out_N) <= len(keys):
        return []
    before, after = (KILO * found.errors.held_out_N[keys.index(key) + k] for k in (0, 1))
    return [("error on held-out presses", f"from {before:.1f} to {after:.1f} mN")]


def after_words(found: Diagnosis) -> str:
    """Return a heading for E after the diagnosis."""
    bent = ",\ncurved within theory" if "bend_within_theory" in found.flags else ""
    return ("with the named effects" if found.effects else "with all possible effects") + bent


def _material(found: Diagnosis) -> str:
    rows = [
        (
            title,
            *(wording.estimate(getattr(result, name)) for result in (found.material.before, found.material.after)),
        )
        for name, title in wording.MATERIAL.items()
    ]
    return page.table(("", BASE, after_words(found)), rows)


def _outside(found: Diagnosis) -> str:
    rows = [
        (in_words(w.key), f"{w.parameter} = {_size(w)}", f"{w.r_squared:.4f}", f"{KILO * w.rms_error_N:.1f}")
        for w in found.remainder.would_have_to_be
    ]
    return page.table(("candidate", "size needed", "R² of P/w", "rms error (mN)"), rows, numbers=(2, 3))


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
    head = ("do", "minutes", *(["separates the candidates by (std; 3 suffice)"] * parted))
    return page.table(head, rows, numbers=(1, 2))


def _untestable(found: Diagnosis) -> str:
    rows = [
        (in_words(key), why, _bias(found.limits.possible_bias.get(key)))
        for key, why in found.limits.not_testable.items()
    ]
    return page.table(("effect", "why", "E could be off by"), rows, numbers=(2,))


def _from_here_on(found: Diagnosis) -> str:
    """Return the least size of each effect that would be significant, and the change of E by smaller ones."""
    rows = [
        (in_words(key), shown_size(found, key), _bias(share))
        for key, share in found.limits.below_visibility.items()
    ]
    return page.table(("effect", "significant from", "below that, E could be off by up to"), rows, numbers=(2,))


def _bias(share: float | None) -> str:
    if share is None:
        return "unknown"
    return f"{100 * abs(share):.1f} %" if share else "not at all"
