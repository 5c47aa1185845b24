"""The page of a diagnosis: the verdict in one sentence, then the evidence, then what to do next."""

from __future__ import annotations

from collections.abc import Sequence

from calibration import page, wording
from calibration.diagnosis import Diagnosis
from calibration.effects import get_effect
from calibration.report import Picture
from calibration.stages import EffectBase
from tactilevision.errors import InputError


def in_words(key: str) -> str:
    """An effect's name as a person says it."""
    return key.replace("_", " ")


def verdict_sentence(found: Diagnosis) -> str:
    """What is wrong with the rig or the gel, in one sentence."""
    named = " and ".join(in_words(effect.key) for effect in found.effects)
    held = 1e3 * found.errors.held_out_before, 1e3 * found.errors.held_out_after
    fall = f"; the error on presses left out falls from {held[0]:.1f} to {held[1]:.1f} mN"
    match found.verdict:
        case "ADEQUATE":
            return "The model explains these data as well as they repeat: nothing is missing that they could show."
        case "IDENTIFIED":
            return f"Something is missing from the model, and it is {named}{fall if found.effects else ''}."
        case "AMBIGUOUS":
            several = ", ".join(in_words(key) for key in found.candidates)
            return f"Something is missing from the model; these data cannot tell which of: {several}."
        case _:
            known = f" beyond {named}" if named else ""
            return f"Something is missing from the model{known} that no effect of the catalogue explains."


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
    lines += [f"  {w.key}: {w.parameter} would have to be {w.value:.3g} {w.unit} (R^2 {w.r_squared:.4f})"
              for w in found.would_have_to_be]  # fmt: skip
    if found.change_point is not None:
        lines.append(f"  since press {found.change_point}")
    before, after = found.before.youngs_modulus, found.after.youngs_modulus
    lines.append(f"E before: {wording.estimate(before)}")
    if found.effects:
        lines.append(f"E after:  {wording.estimate(after)}")
    if found.not_testable:
        lines.append("not testable with these data: " + ", ".join(in_words(key) for key in found.not_testable))
    return [*lines, *([next_sentence(found)] if found.measure_next else [])]


def diagnosis_page(title: str, found: Diagnosis, figures: Sequence[Picture]) -> str:
    """The whole page."""
    return page.page(
        title,
        page.paragraph(f"{found.verdict}. {verdict_sentence(found)} {next_sentence(found)}", kind="lead"),
        page.section("What the model leaves, and how the error falls",
                     *(page.figure(p.data_uri, p.caption) for p in figures)),
        page.section("Candidates", *(_card(key, found) for key in _carded(found))),
        page.section("What it does to the material", _material(found)),
        page.section("Where beta does not fit theory", _outside(found)),
        page.section("What to measure next", _next(found)),
        page.section("Not testable with these data", _untestable(found)),
    )  # fmt: skip


def _carded(found: Diagnosis) -> list[str]:
    keys = [effect.key for effect in found.effects]
    return list(dict.fromkeys([*keys, *found.candidates, *found.tried]))


def _card(key: str, found: Diagnosis) -> str:
    try:
        effect = get_effect(key)
    except InputError:
        return page.paragraph(f"{in_words(key)}: an effect of your own.")
    about = effect if isinstance(effect, EffectBase) else None
    rows = []
    for added in found.effects:
        if added.key == key:
            rows += [(name, wording.estimate(value)) for name, value in added.parameters]
            rows += [("p, adjusted for all looks", wording.p_value(added.p_adjusted)),
                     ("skill on presses left out", f"{100 * added.transfer_skill:.0f} %")]  # fmt: skip
    if about is not None:
        rows += [("seen against", ", ".join(about.seen_in)),
                 ("confused with", ", ".join(in_words(k) for k in about.confused_with)),
                 ("told apart by", "; ".join(about.separated_by)), ("source", about.source)]  # fmt: skip
    heading = f"{in_words(key)}: {about.title}" if about is not None and about.title else in_words(key)
    return page.paragraph(heading, kind="lead") + page.table(("", ""), [row for row in rows if row[1]])


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
            f"{w.parameter} = {w.value:.3g} {w.unit}",
            f"{w.r_squared:.4f}",
            f"{1e3 * w.rms_error_N:.1f}",
        )
        for w in found.would_have_to_be
    ]
    return page.table(
        ("candidate", "what it would have to be", "R² of P/w", "rms error (mN)"), rows, numbers=(2, 3)
    )


def _next(found: Diagnosis) -> str:
    rows = [(a.action, f"{a.minutes:.0f}", f"{a.separation_sigma:.1f}") for a in found.measure_next]
    return page.table(("do", "minutes", "expected separation (std)"), rows, numbers=(1, 2))


def _untestable(found: Diagnosis) -> str:
    rows = [(in_words(key), why, _bias(found.possible_bias.get(key))) for key, why in found.not_testable.items()]
    return page.table(("effect", "why", "E could be off by"), rows, numbers=(2,))


def _bias(share: float | None) -> str:
    return "–" if share is None else f"{100 * abs(share):.1f} %"
