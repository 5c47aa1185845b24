"""Fits, evidence for effects and the diagnosis of a workbench, each computed once."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from math import inf, nan
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from calibration.diagnosis.refit import CANNOT_FIT, Candidate, refit_with
from calibration.diagnosis.score_test import LEVEL, Scored, score_test
from calibration.diagnosis.vision_depth_check import in_picture
from calibration.effects import PLAIN
from calibration.fit.least_squares import Fit
from calibration.inputs.deadline import Watch
from calibration.inputs.observations import Observations, leave_out
from calibration.model.stages import Effect
from calibration.report.drawing import overlay
from calibration.tasks.compare import (
    Comparison,
    Prepared,
    plain_law,
    prepare,
    with_covariates,
    with_effect,
    with_gel,
)
from calibration.workbench.opened import Opened
from tactilevision.plots.diagnosis import Overlay
from tactilevision.records.measured import Estimate, Pair

# Models as `compare` fits them, each fitted once: going back to one costs nothing.


@dataclass(frozen=True, slots=True)
class Fitted:
    """The plain law and each effect on top of those before; `ready` what they are fitted to.

    `rng` is where the draws of these models ended: the next effect's go on from a copy, as in `compare`. None:
    what the residual depends on was not looked for yet.
    """

    found: Comparison
    ready: Prepared
    rng: np.random.Generator | None = None

    @property
    def refused(self) -> tuple[tuple[str, str], ...]:
        """Effects that could not be added, and why."""
        return self.found.left_out


class Models:
    """The models of one analysis; each prefix of effects is fitted once."""

    def __init__(self, opened: Opened, seed: int = 0) -> None:
        self._opened, self._seed = opened, seed
        self._known: dict[tuple[tuple[str, ...], tuple[str, ...]], Fitted] = {}

    def fitted(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """The plain law with these effects in this order, and at first without what it says of the gel, and what
        its residual depends on.

        Raises InputError where the law cannot be fitted.
        """
        place = (tuple(sorted(left_out)), tuple(keys))
        if place not in self._known:
            if keys:
                before = self.fitted(place[0], keys[:-1])
                self._known[place] = self._with(before, self._opened.effect(keys[-1]))
            else:
                self._known[place] = self._plain(place[0])
        return self._known[place]

    def with_covariates(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """The same with what the residual of each model depends on; draws follow one another as in `compare`."""
        quick = self.fitted(left_out, keys)
        if quick.rng is not None:
            return quick
        before = self.with_covariates(left_out, keys[:-1]) if keys else None
        rng = np.random.default_rng(self._seed) if before is None else deepcopy(before.rng)
        assert rng is not None
        known = () if before is None else before.found.models
        models = [
            replace(one, covariates=known[k].covariates) if k < len(known) else one
            for k, one in enumerate(quick.found.models)
        ]
        found = replace(quick.found, models=tuple(models))
        found = with_covariates(found, rng) if len(models) > len(known) else found
        place = (tuple(sorted(left_out)), tuple(keys))
        self._known[place] = replace(quick, found=found, rng=rng)
        return self._known[place]

    def with_gel(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """The same with what it says of the gel."""
        quick = self.fitted(left_out, keys)
        if any(model.material is None for model in quick.found.models):
            self._known[tuple(sorted(left_out)), tuple(keys)] = replace(quick, found=with_gel(quick.found))
        return self.fitted(left_out, keys)

    def _plain(self, left_out: Sequence[str]) -> Fitted:
        data = leave_out(self._opened.data, left_out)
        ready = prepare(data, bulge=self._opened.bulge, bound=self._opened.bound)
        return Fitted(plain_law(ready, rng=None, of_gel=False), ready)

    def _with(self, before: Fitted, effect: Effect) -> Fitted:
        return Fitted(with_effect(before.found, effect, before.ready, rng=None, of_gel=False), before.ready)


# How much speaks for each effect that is not in the model, and what it would leave: the screen of `diagnose`.

REFITTED = 6  # cards that show at once what they would leave; the others do when they are opened
OF_FORCE, OF_PICTURE = "the force", "the picture's depth"


@dataclass(frozen=True, slots=True)
class Evidence:
    """One effect that could be added.

    `p_adjusted` for having looked at all, NaN where it was not looked at, then `why`; `of` what it acts on;
    `fitted` and `shown` what it would leave, where it was fitted.
    """

    effect: Effect
    p_adjusted: float = nan
    why: str = ""
    of: str = OF_FORCE
    fitted: Candidate | None = None
    shown: Overlay | None = None

    @property
    def stands_out(self) -> bool:
        """Whether it is beyond chance."""
        return self.p_adjusted < LEVEL


def look(opened: Opened, now: Fitted, *, seed: int = 0) -> tuple[Evidence, ...]:
    """Every effect that is not in the model: what stands out most first, what these data cannot show last."""
    base, rng = now.found.models[-1].fitted, np.random.default_rng(seed)
    tested = score_test(base, opened.catalogue, rng=rng, of_rig=True)
    known = {effect.key: effect for effect in (*opened.catalogue, *PLAIN.values())}
    scored = sorted((*tested.effects, *(one for one in tested.others if one.key in PLAIN)), key=_rank)
    seen = _of_picture(now, rng)
    there = {one.effect.key for one in seen}
    found = [Evidence(known[one.key], one.p_adjusted) for one in scored if one.key not in there]
    untested = [
        Evidence(known[key], why=why)
        for key, why in tested.not_testable.items()
        if key not in there and key not in base.model.keys
    ]
    return (*sorted((*found, *seen), key=lambda one: one.p_adjusted), *untested)


def _rank(one: Scored) -> tuple[float, float]:
    return one.p_adjusted, -one.statistic


def _of_picture(now: Fitted, rng: np.random.Generator) -> list[Evidence]:
    """Effects on the depth that the picture reads, where there is a certified one."""
    pictured = now.found.pictured
    with suppress(*CANNOT_FIT):
        seen = pictured[-1].fitted if pictured else None
        if seen is not None:
            shown = {one.key: one for one in in_picture(seen.data) if one.key not in seen.model.keys}
            tested = score_test(seen, list(shown.values()), rng=rng)
            return [Evidence(shown[one.key], one.p_adjusted, of=OF_PICTURE) for one in tested.effects]
    return []


def with_pictures(
    now: Fitted, evidence: Sequence[Evidence], *, tell: Callable[[tuple[Evidence, ...]], bool]
) -> None:
    """Fit the effects that stand out most, and hand over all after each; `tell` answers whether to go on."""
    table = list(evidence)
    for k, one in enumerate(table[:REFITTED]):
        if one.stands_out and one.of == OF_FORCE:
            table[k] = opened_card(now, one)
            if not tell(tuple(table)):
                return
    tell((*sorted(table[:REFITTED], key=_cost), *table[REFITTED:]))


def _cost(one: Evidence) -> float:
    """What is left with it and what it costs, as a diagnosis ranks candidates; those not fitted come last."""
    return inf if one.fitted is None else one.fitted.cost


def opened_card(now: Fitted, one: Evidence) -> Evidence:
    """The effect fitted on top of the model, with what it would leave; with `why` where it cannot be fitted."""
    base: Fit = now.found.models[-1].fitted
    if one.of != OF_FORCE or one.fitted is not None:
        return one
    try:
        fitted = refit_with(base, one.effect)
        return replace(one, fitted=fitted, shown=overlay(base, fitted))
    except Exception as fault:  # a private effect may raise anything; the page lives on
        return replace(one, why=f"it cannot be fitted: {str(fault) or type(fault).__name__}")


# `diagnose` beside the page: in a process of its own, so that no click waits for it; ended when it is stale.


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a diagnosis says, in words: the verdict, its sentence, what else is to be said, what to measure next.

    `named` are the effects that it added, `candidates` those that these data cannot tell from them; `odd` presses
    that stand out; `measure_next` what to do, its minutes, and the expected separation in std; `nearest` the plain
    error that comes nearest where nothing could be named, empty for none.
    """

    word: str
    sentence: str
    remarks: tuple[str, ...]
    measure_next: tuple[tuple[str, float, float], ...]
    named: tuple[str, ...]
    candidates: tuple[str, ...]
    odd: tuple[str, ...]
    nearest: str = ""


@dataclass(frozen=True, slots=True)
class Question:
    """What a diagnosis is asked: measurements, the effects that are in from the start, the user's own files."""

    data: Observations
    known: tuple[str, ...]
    own: tuple[str, ...]
    bulge: Estimate | None
    bound: Pair | None
    seed: int

    @classmethod
    def of(cls, opened: Opened, data: Observations, known: Sequence[str], seed: int) -> Question:
        """About these measurements, with these effects in."""
        return cls(data, tuple(known), tuple(opened.files.values()), opened.bulge, opened.bound, seed)


class Asked:
    """A question on its way; `tell` hears what is at work, `answer` a Verdict or why there is none."""

    def __init__(
        self, question: Question, *, tell: Callable[[str], None], answer: Callable[[Verdict | str], None]
    ) -> None:
        context = multiprocessing.get_context("spawn")
        reader, writer = context.Pipe(duplex=False)
        self._process = context.Process(target=_answer, args=(writer, question), daemon=True)
        self._process.start()
        writer.close()
        threading.Thread(target=self._hear, args=(reader, tell, answer), daemon=True).start()
        self._dropped = False

    def drop(self) -> None:
        """End it; it answers nothing any more."""
        self._dropped = True
        self._process.terminate()
        self._process.join()

    def _hear(
        self, reader: Connection, tell: Callable[[str], None], answer: Callable[[Verdict | str], None]
    ) -> None:
        last: Verdict | str = "the diagnosis was ended from outside"
        while True:
            try:
                kind, content = reader.recv()
            except (EOFError, OSError):
                break
            if kind == "answer":
                last = content
                break
            if not self._dropped:
                tell(content)
        if not self._dropped:
            answer(last)


def _answer(writer: Connection, question: Question) -> None:
    """The process: a diagnosis from first to last."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page's process hears it, and ends this one
    try:
        found: Verdict | str = diagnosed(question, lambda what: writer.send(("tell", what)))
    except BrokenPipeError:
        return
    except (Exception, SystemExit) as fault:  # of a private effect, anything
        found = str(fault) or type(fault).__name__
    writer.send(("answer", found))


def diagnosed(question: Question, tell: Callable[[str], None]) -> Verdict:
    """Ask `diagnose`, and put its answer into words."""
    from calibration.effects import get_effect
    from calibration.effects.private import load_effect
    from calibration.report.verdict import allowed_for, reading_sentence, verdict_sentence
    from calibration.tasks.diagnose import diagnose

    own = {effect.key: effect for effect in (load_effect(path) for path in question.own)}
    known = [own[key] if key in own else get_effect(key) for key in question.known]

    def progress(done: int, total: int, what: str = "") -> None:
        tell(what)

    found = diagnose(
        question.data,
        np.random.default_rng(question.seed),
        effects=[effect for key, effect in own.items() if key not in question.known],
        known=known,
        bulge=question.bulge,
        bound=question.bound,
        watch=Watch(progress),
    )
    steps: list[Any] = [(a.action, a.minutes, a.separation_sigma) for a in found.measure_next]
    return Verdict(
        word=found.verdict,
        sentence=verdict_sentence(found),
        remarks=(*reading_sentence(found), *allowed_for(found)),
        measure_next=tuple(steps),
        named=tuple(effect.key for effect in found.effects),
        candidates=found.candidates,
        odd=found.odd.presses,
        nearest="" if found.plain is None else found.plain.effect.key,
    )
