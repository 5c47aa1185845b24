"""Page of a diagnosis: the verdict in one sentence, the evidence, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from calibration.diagnosis.decision import InadmissibleBeta
from calibration.diagnosis.diagnosis import Added, Diagnosis, OddPresses
from calibration.diagnosis.refit import Candidate
from calibration.diagnosis.score_test import Failure, few_presses
from calibration.effects import get_effect
from calibration.fit.repeats import LEVEL
from calibration.fit.tolerances import TOLERANCES
from calibration.inputs.deadline import Progress
from calibration.laws.theory import stated_outside_gels
from calibration.model.stages import Effect, Parameter
from calibration.report import drawing, figures, page, wording
from calibration.report.drawing import ResidualMap
from calibration.report.figures import FigureFolder
from calibration.report.headline import fall_sentence, modulus_lines, modulus_table
from calibration.report.misfit import BASE, error_falls, force_curves, residual_strips
from calibration.report.report import all_presses
from calibration.report.wording import in_words
from calibration.result.result import CalibrationResult
from calibration.tasks.compare import as_comparison
from tactilevision.errors import InputError
from tactilevision.recording.layout import some
from tactilevision.records.constants import KILO
from tactilevision.records.misfit import ErrorFall

ANEW = (
    " Below, the depths are corrected by these sizes; `compare` excludes what a wall may shade instead, to "
    "another error."
)
OWN_IDEA = (
    "To test an idea of your own, write it as an effect: tactilevision new-effect my_effect.py, then diagnose "
    "with --effect my_effect.py."
)


def next_sentence(found: Diagnosis) -> str:
    """Return the sentence on what to measure next; empty where nothing helps."""
    if not found.measure_next:
        return ""
    best = found.measure_next[0]
    sigma = best.separation_sigma
    gain = f", expected to separate the candidates by {sigma:.0f} std" if sigma > 0 else ""
    why = f", since {best.why}" if best.why else ""
    return f"Measure next: {best.action} ({best.minutes:.0f} minutes{gain}){why}."


def summary(found: Diagnosis) -> list[str]:
    """Return the lines for the terminal."""
    lines = [f"{found.verdict}: {verdict_sentence(found)}", stopped_sentence(found), reading_sentence(found)]
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
    lines += [f"  {fall_sentence(fall)}" for fall in _falls(found)]
    whole = {name if name.startswith(BASE) else f"{BASE} {name}": gel for name, gel in materials(found).items()}
    lines += modulus_lines(whole, found.material.after.youngs_modulus)
    lines.append(allowed_for(found))
    untested = found.limits.not_testable
    if untested:
        lines.append("not testable with these data: " + ", ".join(map(in_words, untested)))
    lines += [f"  {in_words(key)}: {why}" for key, why in untested.items() if isinstance(why, Failure)]
    return [line for line in (*lines, next_sentence(found)) if line]


def resultant_sentences(found: Diagnosis) -> list[str]:
    """Return the lines for `force`: the error of forces by pictures, on what it depends, and what is missing."""
    data = found.fits.base.data
    assert data.resultants is not None
    off = float(np.sqrt(np.mean((data.resultants.force_N - data.normal_N) ** 2)))
    of_all = 100 * off / float(np.max(np.abs(data.normal_N)))
    seen = [wording.covariate(c.key) for c in found.search.covariates_before if c.p_adjusted < LEVEL]
    depends = f"it depends on {', '.join(seen)}" if seen else "it depends on nothing that was recorded"
    said = [f"{found.verdict}: {verdict_sentence(found)}", stopped_sentence(found), next_sentence(found)]
    size = f"{KILO * off:.1f} mN rms ({of_all:.1f} % of the largest)"
    return [f"fz differs from the force sensor's by {size}; {depends}", *filter(None, said)]


def diagnosis_page(
    found: Diagnosis,
    folder: FigureFolder,
    *,
    private: Sequence[Effect],
    reliefs: Sequence[ResidualMap],
    commands: Sequence[str],
    progress: Progress,
) -> str:
    """Draw the figures and return the page.

    In order: verdict, misfit, what explains it and what does not, the material, and what to do next. `reliefs`:
    residuals of the height maps; `commands`: commands to try.
    """
    tried, falls = found.search.tried, _falls(found)
    cards = {key: _card(key, one, found, folder) for key, one in drawing.candidates(found, private).items()}
    gels = materials(found)
    over = found.material.after.youngs_modulus
    return page.page(
        f"Diagnosis of {', '.join(found.fits.base.data.recordings)}",
        _head(found),
        modulus_table(gels, over),
        *_misfit(found, reliefs, folder, progress),
        page.section(
            _explains(found),
            *figures.keep_falls(falls, folder),
            *(card for key, card in cards.items() if key not in tried),
            _outside(found),
        ),
        page.folded(
            "Examined so far" if found.stopped else "Tried, and does not explain it",
            *(card for key, card in cards.items() if key in tried),
        ),
        page.section("E before and after", *figures.keep_moduli(gels, over, folder), _stiffness(gels)),
        page.section("What to measure next", _next(found)),
        page.section("Commands to try", *(page.command(text) for text in commands)),
        page.folded("Can these data distinguish the effects?", *figures.keep_confusable_effects(found, folder)),
        page.folded("Not testable with these data", _untestable(found)),
        page.folded("Effects too small to be significant", _from_here_on(found)),
        page.folded("What the four verdicts mean", page.table(("", ""), list(VERDICTS.items()))),
    )


def _falls(found: Diagnosis) -> list[ErrorFall]:
    """Return the errors that effects of the diagnosis change."""
    return [fall for fall in error_falls(as_comparison(found)) if len(fall.models) > 1]


def materials(found: Diagnosis) -> dict[str, CalibrationResult]:
    """Return the material of the base model and, where there are effects, of the last one, by name."""
    base, gel = found.fits.base, found.material
    known = [in_words(key) for key in base.model.keys if key not in TOLERANCES]
    first = " + ".join((BASE, *known))
    if found.fits.fitted is base and not found.effects:
        return {first: gel.alone}
    return {first: gel.before, after_words(found): gel.alone}


def _of_force(found: Diagnosis) -> list[str]:
    """Return the keys of the effects that were added to the force."""
    return [effect.key for effect in found.effects if effect.key in found.fits.fitted.model.keys]


def _misfit(
    found: Diagnosis, reliefs: Sequence[ResidualMap], folder: FigureFolder, progress: Progress
) -> list[str]:
    """Return the misfit of the force, or of the reconstructed depth where only that fails; the other is folded."""
    base, named = found.fits.base, " + ".join(map(in_words, _of_force(found)))
    fits = {BASE: base} | ({f"+ {named}": found.fits.fitted} if named else {})
    scored = [found.search.covariates_before, found.search.covariates][: len(fits)]
    curves = force_curves(fits)
    force = [
        *figures.keep_pad(found, folder),
        *figures.keep_odd_presses(found, folder),
        *figures.keep_presses(curves, base.data.gel.thickness_mm, folder),
        *figures.keep_strips(residual_strips(fits, scored), folder),
        all_presses(curves, folder, progress),
    ]
    depth = figures.keep_reconstructed_depth(found, reliefs, folder)
    if found.effects and not named:
        quiet = page.folded("The forces, in which no effect is significant", *force)
        return [page.section("Where the reconstructed depth fails", *depth, quiet)]
    fails = min((one.p_adjusted for one in found.search.covariates_before), default=1.0) < LEVEL
    return [
        page.section("Where the model fails" if fails else "Measured and modelled force", *force),
        page.folded("The reconstructed depth compared with the certified one", *depth),
    ]


def _explains(found: Diagnosis) -> str:
    """Return the heading of the candidates."""
    if found.verdict == "UNKNOWN":
        return "What comes nearest"
    return "What may explain it" if len(found.candidates) > len(found.effects) else "What explains it"


def _box(title: str, picture: str, rows: Sequence[tuple[str, str]], said: str = "") -> str:
    table = page.table(("", ""), [row for row in rows if row[1]])
    return page.block("card", page.heading(title), picture, said, table)


def _sizes(candidate: Candidate) -> list[tuple[str, str]]:
    """Return the fitted values of a candidate with their meanings."""
    key, rows = candidate.effect.key, []
    for p, value in zip(candidate.effect.parameters, candidate.own_values.tolist(), strict=True):
        unit = "" if p.unit == "1" else f" {p.unit}"
        rows.append((_meaning(key, p.name), f"{wording.number(value)}{unit}"))
    return rows


def _head(found: Diagnosis) -> str:
    """Return the verdict and its consequences."""
    said = [
        *(stopped_sentence(found), reading_sentence(found)),
        *(fall_sentence(fall) for fall in _falls(found)),
        *(_effect_sentence(effect) for effect in found.effects),
        *(_needed(w) for w in found.remainder.would_have_to_be),
        allowed_for(found),
        *(OWN_IDEA if found.verdict == "UNKNOWN" else "", next_sentence(found)),
    ]
    lead = page.paragraph(f"{found.verdict}. {verdict_sentence(found)}", kind="lead")
    kind = "verdict " + ("clean" if found.verdict == "ADEQUATE" else "found")
    return page.block(kind, lead, *(page.paragraph(text) for text in said if text))


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
    said = (about.title if about else "") or in_words(added.key)
    anew = ANEW if about is not None and about.treatment else ""
    return f"{in_words(added.key).capitalize()}: {said}; {_values(added)}.{anew}"


def _parameter(name: str) -> str:
    """Return a parameter's name without its unit."""
    for unit in ("_mm_per_N", "_N_per_mm", "_per_mm", "_rad", "_days", "_mm", "_N", "_s"):
        name = name.removesuffix(unit)
    return name.replace("_", " ")


def _meaning(key: str, name: str) -> str:
    """Return the meaning of an effect's parameter."""
    effect = _about(key)
    known = {} if effect is None else {p.name: p.meaning for p in effect.parameters}
    return known.get(name) or _parameter(name)


def _values(added: Added) -> str:
    """Return an effect's parameters in words."""
    return ", ".join(f"{_meaning(added.key, name)} {wording.estimate(value)}" for name, value in added.parameters)


def _about(key: str) -> Effect | None:
    with suppress(InputError):  # a private effect
        return get_effect(key)
    return None


def _card(key: str, candidate: Candidate | None, found: Diagnosis, folder: FigureFolder) -> str:
    about, rows = _about(key), [] if candidate is None else _sizes(candidate)
    shown = candidate is not None and (folder.choice.every_press or key not in found.search.tried)
    picture = figures.keep_overlay(found.fits.base, candidate, folder) if candidate is not None and shown else ""
    for added in (one for one in found.effects if one.key == key):
        rows = [(_meaning(key, name), wording.estimate(value)) for name, value in added.parameters]
        rows += [("p-value", wording.p_value(added.p_adjusted)), *_fall_of(found, key)]
    if about is not None:
        rows += [
            ("seen against", ", ".join(dict.fromkeys(wording.covariate(name) for name in about.seen_in))),
            ("confused with", ", ".join(map(in_words, about.confused_with))),
            ("distinguished by", "; ".join(about.separated_by)),
            ("source", about.source),
        ]
    return _box(f"{in_words(key)}: {(about.title if about else '') or 'your own'}", picture, rows)


def _fall_of(found: Diagnosis, key: str) -> list[tuple[str, str]]:
    """Return the change of the held-out error by adding an effect of the force."""
    keys = _of_force(found)
    if key not in keys or len(found.errors.held_out_N) <= len(keys):
        return []
    before, after = (KILO * found.errors.held_out_N[keys.index(key) + k] for k in (0, 1))
    return [("error on held-out presses", f"from {before:.1f} to {after:.1f} mN")]


def after_words(found: Diagnosis) -> str:
    """Return a heading for E after the diagnosis."""
    named = [f"+ {in_words(effect.key)}" for effect in found.effects] or [BASE]
    bent = [", curved within theory"] if "bend_within_theory" in found.flags else []
    return " ".join(named) + "".join(bent)


def _stiffness(gels: Mapping[str, CalibrationResult]) -> str:
    titles = {name: title for name, title in wording.MATERIAL.items() if name in ("c", "beta")}
    rows = [(name, *(wording.estimate(getattr(one, key)) for key in titles)) for name, one in gels.items()]
    return page.table(("", *titles.values()), rows)


def _outside(found: Diagnosis) -> str:
    rows = [
        (in_words(w.key), f"{w.parameter} = {_size(w)}", f"{w.r_squared:.4f}", f"{KILO * w.rms_error_N:.1f}")
        for w in found.remainder.would_have_to_be
    ]
    return page.table(("candidate", "size needed", "R² of P/w", "rms error (mN)"), rows, numbers=(2, 3))


def _next(found: Diagnosis) -> str:
    steps = found.measure_next
    rows = [
        (
            one.action,
            one.why,
            f"{one.minutes:.0f}",
            f"{one.separation_sigma:.1f}" if one.separation_sigma > 0 else "–",
        )
        for one in steps
    ]
    head = ("do", "why", "minutes", "separates the candidates by (std; 3 suffice)")
    columns = 4 if any(one.separation_sigma > 0 for one in steps) else 3
    return page.table(head[:columns], [row[:columns] for row in rows], numbers=(2, 3))


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


# The verdict in words: what is wrong with the rig or the gel, and what E's interval allows for.

MANY = 8  # presses that are all named
VERDICTS = {  # in words, for a page
    "ADEQUATE": "no effect is significant: nothing in these data contradicts the model",
    "IDENTIFIED": "an effect is missing from the model, and only the one named fits these data",
    "AMBIGUOUS": "an effect is missing, and these data do not distinguish which of those listed",
    "UNKNOWN": "something is missing that no effect of the catalogue explains",
}
NEAR = 0.1  # least share of a misfit, of an interval or of its widening that is reported
SHARES = ("relative", "gain", "softer")  # parameters given in per cent


def verdict_sentence(found: Diagnosis) -> str:
    """Return the verdict in one sentence, and one more where E rests on an implausible nu."""
    stated = stated_outside_gels(found.fits.base.data.gel)
    return _verdict_sentence(found) + contrast_sentence(found) + (f" {stated}." if stated else "")


def contrast_sentence(found: Diagnosis) -> str:
    """Return which presses are softer or stiffer than the others, where and by how much; else empty."""
    one = found.presses.contrast
    if one is None:
        return ""
    side, way = ">" if one.above else "<", "softer" if one.relative < 0 else "stiffer"
    unit = f" {one.unit}" if one.unit else ""
    size = f"{100 * abs(one.relative):.0f} ± {100 * one.std:.1g} %"
    named = ", ".join(one.presses) if len(one.presses) <= MANY else some(one.presses)
    return f" Presses {named} ({one.covariate} {side} {one.at:.2g}{unit}) are {size} {way} than the others."


def _verdict_sentence(found: Diagnosis) -> str:
    """Return the verdict; with presses set aside, also the one without them."""
    if found.presses.set_aside:
        return _without(found)
    if found.stopped and not found.effects:
        return _so_far(found)
    named = " and ".join(in_words(effect.key) for effect in found.effects)
    fall = "" if _of_force(found) else " No effect is significant in the forces themselves."
    match found.verdict:
        case "ADEQUATE":
            said = "No effect is significant: nothing in these data contradicts the model."
            if "bend_within_theory" in found.flags:
                said += " The curvature lies within the range of finite elements."
            return said + few_sentence(found) + unseen_sentence(found)
        case "IDENTIFIED":
            return f"{plain_words([effect.key for effect in found.effects])}.{fall if found.effects else ''}"
        case "AMBIGUOUS":
            return _ambiguous(found)
        case _ if found.presses.odd:
            return f"{_odd(found)}. Look at these presses before E is used."
        case _ if found.remainder.left is None and found.search.sight is not None:
            with_it = f", {named} allowed for" if named else ""
            return (
                "The reconstructed depth has an error that no effect of the catalogue explains."
                f"{_nearest(found)} No effect is significant in the forces themselves{with_it}."
            )
        case _:
            known = f" beyond {named}" if named else ""
            what = f"that no effect of the catalogue explains{_left(found)}"
            return f"Something is missing from the model{known} {what}.{_nearest(found)}"


def plain_words(keys: Sequence[str]) -> str:
    """Return what effects are in plain words, each with its name."""
    said = [f"{about.title}: {in_words(key)}" if (about := _about(key)) else in_words(key) for key in keys]
    text = "; and ".join(said) or "an effect is missing from the model"
    return text[0].upper() + text[1:]


def _ambiguous(found: Diagnosis) -> str:
    """Return what the data cannot distinguish: effects, or explanations of an implausible beta."""
    several = ", ".join(in_words(key) for key in found.candidates)
    if found.remainder.varying and len(found.candidates) == len(found.effects):
        return (
            f"An effect like {several} is missing from the model, but it is not that one alone.{_varying(found)}"
        )
    cannot = "these data cannot distinguish the explanations"
    beta = wording.estimate(found.material.before.beta)
    if "beta_outside_theory" in found.flags and not found.effects:
        return f"A line fits, but beta = {beta} lies outside the range of contact laws; {cannot}: {several}."
    if "beta_at_bound" in found.flags and not found.effects:
        return f"The slope is at its bound, beta = {beta}; {cannot}: {several}, or a wrong unit."
    return f"An effect is missing from the model; these data cannot distinguish: {several}.{_varying(found)}"


def _varying(found: Diagnosis) -> str:
    """Return which parameter is not constant where it has to be; empty where all are."""
    if not found.remainder.varying:
        return ""
    one = found.remainder.varying[0]
    ends = " and ".join(
        f"{wording.estimate(value)} where that is {wording.number(at)}"
        for at, value in zip(one.ends, one.values, strict=True)
    )
    what = f"The {_meaning(one.effect, one.parameter)} of {in_words(one.effect)}"
    return f" {what} differs with {wording.covariate(one.covariate)}: {ends}, a ratio of {one.ratio:.1f}."


def _without(found: Diagnosis) -> str:
    """Return which presses are set aside, and the verdict without them."""
    aside, odd = found.presses, found.presses.odd
    rest = replace(found, verdict=aside.without, presses=OddPresses(replace(odd, presses=())))
    many = "it" if len(aside.set_aside) == 1 else "them"
    alone = _odd(replace(found, presses=replace(aside, odd=replace(odd, wanders=(), scattered=False))))
    return f"{alone}: set aside for inspection. Without {many}: {aside.without}. {_verdict_sentence(rest)}"


def _so_far(found: Diagnosis) -> str:
    """Return the intermediate result of a search that was stopped before it named an effect."""
    shown = [one.key for one in found.search.score_test if one.p_adjusted < LEVEL]
    if not shown:
        return "No effect is significant so far."
    most = ", then ".join(in_words(key) for key in shown[:2])
    seen = f"Something is missing from the model{_left(found)}"
    return f"{seen}; so far the most significant is {most}, which is not confirmed."


def stopped_sentence(found: Diagnosis) -> str:
    """Return a warning where the search was stopped by its time limit; else empty."""
    said = "The search was stopped by its time limit: this is the best answer so far, and others may be better."
    return said if found.stopped else ""


def reading_sentence(found: Diagnosis) -> str:
    """Return what a gain of the reconstructed depth leaves at the faces; empty without such a gain."""
    sight = found.search.sight
    if sight is None or sight.base.data.slopes is None:
        return ""
    gained = {
        step.best.effect.key for step in sight.steps if "gain" in {p.name for p in step.best.effect.parameters}
    }
    hidden = "Punch faces read still less, since steep walls hide part of their depth; that is not a gain."
    return hidden if gained & {effect.key for effect in found.effects} else ""


def few_sentence(found: Diagnosis) -> str:
    """Return a caution for few curves; empty for points, and where there are enough."""
    data = found.fits.base.data
    said = f" {data.count} presses hardly separate changes between presses (day, temperature, place) from scatter."
    return said if few_presses(data) else ""


def unseen_sentence(found: Diagnosis) -> str:
    """Return the effects too small to be significant that change E by more than its interval; else empty."""
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
        f" Effects too small to be significant may remain: {in_words(key)} of up to {size} would change E by up "
        f"to {off:.0f} %{also}. E's interval counts each by how likely it is."
    )


def allowed_for(found: Diagnosis) -> str:
    """Return a sentence on what E's interval includes besides the noise, where it is much wider."""
    E, alone = found.material.after.youngs_modulus, found.material.alone_MPa
    if E.interval95 is None or alone is None or not found.material.unseen:
        return ""
    wider = (E.interval95[1] - E.interval95[0]) / (alone[1] - alone[0]) - 1 if alone[1] > alone[0] else 0.0
    if wider < NEAR:
        return ""
    most = found.material.unseen[0].chance * found.material.unseen[0].off ** 2
    named = [in_words(u.key) for u in found.material.unseen[:3] if u.chance * u.off**2 > NEAR * most]
    return f"E's interval after the diagnosis allows above all for {', '.join(named)}."


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
    if left.rms_N > 0:
        over = f" and varies over {left.length_mm:.2g} mm of depth" if np.isfinite(left.length_mm) else ""
        parts.append(f"is about {KILO * left.rms_N:.0f} mN in the mean at equal depth{over}")
    if found.remainder.change_point is not None:
        parts.append(f"occurs since press {found.remainder.change_point}")
    return f" ({', '.join(parts)})" if parts else ""


def _nearest(found: Diagnosis) -> str:
    """Return a sentence on the effect nearest to the misfit."""
    if found.remainder.nearest is None or found.remainder.nearest[1] < NEAR:
        return " No effect of the catalogue comes near it."
    keys, share = found.remainder.nearest
    named = " with ".join(in_words(key) for key in keys.split("+"))
    return f" Nearest to it comes {named}, which explains {100 * share:.0f} % of it."


def shown_size(found: Diagnosis, key: str) -> str:
    """Return the least significant size of an effect in words."""
    size = found.limits.visible[key]
    return amount(found.limits.sizes[key], size) if key in found.limits.sizes else f"{size:.2g}"
