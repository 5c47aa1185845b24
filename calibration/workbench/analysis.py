"""Fits, evidence for effects and the diagnosis of a workbench, each computed once, and how work is cancelled.

The diagnosis runs in a process of its own, so that the page stays responsive, and is stopped when it is out of
date.
"""

from __future__ import annotations

import _thread
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from multiprocessing.connection import Connection
from types import FrameType
from typing import Any

import numpy as np

from calibration.diagnosis.refit import CANNOT_FIT
from calibration.diagnosis.score_test import score_test
from calibration.diagnosis.vision_depth_check import in_picture
from calibration.fit.identifiability import holding
from calibration.fit.repeats import LEVEL
from calibration.inputs.deadline import Watch
from calibration.inputs.observations import Observations, leave_out
from calibration.model.stages import Effect
from calibration.report.drawing import overlay
from calibration.report.misfit import error_fall_of_comparison, error_fall_of_picture
from calibration.tasks.compare import Comparison, completed, plain_law, with_effect
from calibration.workbench.opened import Opened
from tactilevision.records.measured import Estimate, Pair
from tactilevision.records.misfit import ErrorFall, Strip, share_removed

REFITTED = 6  # cards fitted at once; the others are fitted when they are opened
OF_FORCE, OF_PICTURE = "the force", "the reconstructed depth"


@dataclass(frozen=True, slots=True)
class Fitted:
    """The base model and each effect on top of those before.

    `rng`: state of the random numbers after these models; the next effect continues from a copy, as in `compare`.
    None: the material and the residual's covariates are not determined yet.
    """

    found: Comparison
    rng: np.random.Generator | None = None


class Models:
    """Models of one analysis; each sequence of effects is fitted once."""

    def __init__(self, opened: Opened, seed: int = 0) -> None:
        self._opened, self._seed = opened, seed
        self._known: dict[tuple[tuple[str, ...], tuple[str, ...]], Fitted] = {}

    def use(self, opened: Opened, key: str) -> None:
        """Use these effects from now on; models with the one of this key are fitted again."""
        self._opened = opened
        self._known = {place: one for place, one in self._known.items() if key not in place[1]}

    def fitted(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """Return the base model with these effects in this order; it may not be complete.

        Raises InputError where the law cannot be fitted.
        """
        place = (tuple(sorted(left_out)), tuple(keys))
        if place not in self._known:
            if keys:
                before = self.fitted(left_out, keys[:-1]).found
                found = with_effect(before, self._opened.effect(keys[-1]))
            else:
                data = leave_out(self._opened.data, place[0])
                found = plain_law(data, bulge=self._opened.bulge, bound=self._opened.bound)
            self._known[place] = Fitted(found)
        return self._known[place]

    def completed(self, left_out: Sequence[str], keys: Sequence[str]) -> Fitted:
        """Return the same with the material and the residual's covariates of each model, as in `compare`."""
        quick = self.fitted(left_out, keys)
        if quick.rng is not None:
            return quick
        before = self.completed(left_out, keys[:-1]) if keys else None
        rng = np.random.default_rng(self._seed) if before is None else deepcopy(before.rng)
        assert rng is not None
        known, models = () if before is None else before.found.models, quick.found.models
        found = replace(quick.found, models=(*known, *models[len(known) :]))
        found = completed(found, rng) if len(models) > len(known) else found
        place = (tuple(sorted(left_out)), tuple(keys))
        self._known[place] = replace(quick, found=found, rng=rng)
        return self._known[place]


@dataclass(frozen=True, slots=True)
class Evidence:
    """Evidence for one effect that could be added.

    `p_adjusted` for the number of tests, NaN where it was not tested for the reason `why`; `of` what it acts on;
    `added` the models with it, `fall` their error and `shown` the residual, where it was fitted.
    """

    effect: Effect
    p_adjusted: float = nan
    why: str = ""
    of: str = OF_FORCE
    added: Comparison | None = None
    fall: ErrorFall | None = None
    shown: Strip | None = None

    @property
    def significant(self) -> bool:
        """Whether its p lies below the level."""
        return self.p_adjusted < LEVEL

    @property
    def share(self) -> float:
        """Share of the removable error that it removes; of the whole where nothing repeats; -inf: not fitted."""
        if self.fall is None:
            return -inf
        before, after = self.fall.error[0], self.fall.error[-1]
        return self.fall.removed if isfinite(self.fall.removed) else share_removed(before, after, 0.0)


def find_evidence(opened: Opened, now: Fitted, *, seed: int = 0) -> tuple[Evidence, ...]:
    """Return the evidence for every other effect, the most significant first, untestable ones last."""
    base, rng = now.found.models[-1].fitted, np.random.default_rng(seed)
    tested = score_test(base, opened.catalogue, rng=rng, of_rig=True)
    known = {effect.key: effect for effect in opened.catalogue}
    scored = sorted(tested.effects, key=lambda one: (one.p_adjusted, -one.statistic))
    pictured = _of_picture(now, rng)
    there = {one.effect.key for one in pictured}
    found = [Evidence(known[one.key], one.p_adjusted) for one in scored if one.key not in there]
    untested = [
        Evidence(known[key], why=why)
        for key, why in tested.not_testable.items()
        if key not in there and key not in base.model.keys
    ]
    return (*sorted((*found, *pictured), key=lambda one: one.p_adjusted), *untested)


def _of_picture(now: Fitted, rng: np.random.Generator) -> list[Evidence]:
    """Return the evidence for effects on the reconstructed depth, where there is a certified one."""
    pictured = now.found.pictured
    with suppress(*CANNOT_FIT):
        seen = pictured[-1].fitted if pictured else None
        if seen is not None:
            shown = {one.key: one for one in in_picture(seen.data) if one.key not in seen.model.keys}
            tested = score_test(seen, list(shown.values()), rng=rng)
            return [Evidence(shown[one.key], one.p_adjusted, of=OF_PICTURE) for one in tested.effects]
    return []


def to_fit(evidence: Sequence[Evidence], named: Sequence[str]) -> list[Evidence]:
    """Return the effects to fit at once: those named by the diagnosis, then the most significant of each depth."""
    first = [one for one in evidence if one.effect.key in named]
    likely = [one for one in evidence if one.significant and one.of == OF_FORCE][:REFITTED]
    likely += [one for one in evidence if one.significant and one.of == OF_PICTURE][:REFITTED]
    every = {one.effect.key: one for one in (*first, *likely)}
    return [one for one in every.values() if one.fall is None and not one.why]


def with_fitted(evidence: Sequence[Evidence], one: Evidence) -> tuple[Evidence, ...]:
    """Return the table with one effect fitted, those that remove most of the error first."""
    table = [one if other.effect.key == one.effect.key else other for other in evidence]
    return tuple(sorted(table, key=lambda each: -each.share))


def fitted_evidence(models: Models, left_out: Sequence[str], keys: Sequence[str], one: Evidence) -> Evidence:
    """Return the effect added to the model as `compare` adds it; with `why` where it cannot be."""
    before, found = (models.fitted(left_out, more).found for more in (keys, (*keys, one.effect.key)))
    if len(found.left_out) > len(before.left_out):
        return replace(one, why=f"it cannot be fitted: {found.left_out[-1][1]}")
    if one.of == OF_PICTURE:
        return replace(one, added=found, fall=error_fall_of_picture(found.pictured[-2:])[0])
    last = replace(found, models=found.models[-2:])
    fitted, shown = last.models[-1].fitted, None
    with suppress(*CANNOT_FIT):
        shown = overlay(last.models[0].fitted, fitted)
    return replace(one, added=found, fall=error_fall_of_comparison(last), shown=shown)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of a diagnosis in words: verdict, its sentence, remarks, warnings, and what to measure next.

    `named`: effects that it added; `candidates`: those not distinguishable from them; `odd`: outlying presses;
    `measure_next`: action, minutes, expected separation in std and the reason; `nearest`: the nearest effects of
    an UNKNOWN, joined by +, else empty; `modulus`: E of the present model with what may be unseen, where it is
    the last one; else `next_modulus`: E once all that is named is added, and `next_E_MPa`: its interval over every
    candidate, once one of them is added and is all that is missing; `own_effect`: text of an effect of the shape
    that an UNKNOWN leaves.
    """

    word: str = ""
    sentence: str = ""
    remarks: tuple[str, ...] = ()
    measure_next: tuple[tuple[str, float, float, str], ...] = ()
    named: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()
    odd: tuple[str, ...] = ()
    nearest: str = ""
    modulus: Estimate | None = None
    next_modulus: Estimate | None = None
    next_E_MPa: Pair | None = None
    warnings: tuple[str, ...] = ()
    own_effect: str = ""

    def after(self, before: Verdict | None, added: Sequence[str]) -> Verdict:
        """Return it with the E that was stated `before`, where all that was named is `added`.

        One of several candidates that is added leaves the others possible: E's interval then covers them.
        """
        if before is None or self.modulus is None:
            return self
        if before.word == "IDENTIFIED" and set(added) == set(before.named) and before.next_modulus is not None:
            return replace(self, modulus=before.next_modulus)
        if len(added) > 1 or not set(added) & set(before.candidates):
            return self
        return replace(self, modulus=holding(self.modulus, before.next_E_MPa))


@dataclass(frozen=True, slots=True)
class Asking:
    """Progress of a diagnosis: its step, and how many effects are tried `of` how many in this pass, since when."""

    what: str = ""
    tried: int = 0
    of: int = 0
    passes: int = 0
    since_s: float = 0.0

    def then(self, what: str, tried: int, of: int) -> Asking:
        """Return the progress at the next step."""
        new = of != self.of or tried < self.tried
        if new and of == tried + 1:  # a step of its own
            return replace(self, what=what, tried=0, of=0)
        return Asking(what, tried, of, self.passes + new, time.monotonic() if new else self.since_s)

    @property
    def left_s(self) -> float | None:
        """Time until the pass is done, s, at its pace so far; None before the first effect is tried."""
        return (time.monotonic() - self.since_s) / self.tried * (self.of - self.tried) if self.tried else None


Report = Callable[[str, int, int], None]
Ask = Callable[[Report], Verdict]  # a diagnosis that reports its steps; picklable


class Asked:
    """A running diagnosis; `report` gets its steps, `answer` a Verdict or why there is none."""

    def __init__(self, question: Ask, *, report: Report, answer: Callable[[Verdict | str], None]) -> None:
        context = multiprocessing.get_context("spawn")
        reader, writer = context.Pipe(duplex=False)
        self._process = context.Process(target=_answer, args=(writer, question), daemon=True)
        self._process.start()
        writer.close()
        threading.Thread(target=self._hear, args=(reader, report, answer), daemon=True).start()
        self._dropped = False

    def drop(self) -> None:
        """Stop it; it answers nothing any more."""
        self._dropped = True
        self._process.terminate()
        self._process.join()

    def _hear(self, reader: Connection, report: Report, answer: Callable[[Verdict | str], None]) -> None:
        last: Verdict | str = "the diagnosis was terminated"
        while True:
            try:
                kind, content = reader.recv()
            except (EOFError, OSError):
                break
            if kind == "answer":
                last = content
                break
            if not self._dropped:
                report(*content)
        if not self._dropped:
            answer(last)


def _answer(writer: Connection, question: Ask) -> None:
    """Run a diagnosis in the process of its own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the page's process handles it, and stops this one
    try:
        found: Verdict | str = question(lambda *step: writer.send(("tell", step)))
    except BrokenPipeError:
        return
    except (Exception, SystemExit) as fault:  # of a private effect, anything
        found = str(fault) or type(fault).__name__
    writer.send(("answer", found))


def diagnosed(
    report: Report,
    *,
    data: Observations,
    known: Sequence[str],
    own: Sequence[str],
    seed: int,
    **nu: Any,
) -> Verdict:
    """Return the verdict of `diagnose` in words.

    `known`: effects that are in the model from the start; `own`: files of private effects; `nu`: `bulge` and
    `bound` of `diagnose`.
    """
    from calibration.diagnosis.residual_shape import find_shape
    from calibration.effects import get_effect
    from calibration.effects.own_shape import own_effect
    from calibration.effects.private import load_effect
    from calibration.report import wording
    from calibration.report.diagnosis_report import allowed_for, reading_sentence, verdict_sentence
    from calibration.tasks.diagnose import diagnose

    private = {effect.key: effect for effect in map(load_effect, own)}

    def progress(done: int, total: int, what: str = "") -> None:
        report(what, done, total)

    found = diagnose(
        data,
        np.random.default_rng(seed),
        effects=[effect for key, effect in private.items() if key not in known],
        known=[private[key] if key in private else get_effect(key) for key in known],
        watch=Watch(progress),
        **nu,
    )
    last = found.fits.fitted is found.fits.base  # else the result is of a model with more effects than the page's
    shown = found.material.after if last else found.material.before
    shape = find_shape(found.fits.fitted) if found.verdict == "UNKNOWN" and found.remainder.left else None
    return Verdict(
        word=found.verdict,
        sentence=verdict_sentence(found),
        remarks=tuple(filter(None, (reading_sentence(found), allowed_for(found) if last else ""))),
        measure_next=tuple((a.action, a.minutes, a.separation_sigma, a.why) for a in found.measure_next),
        named=tuple(effect.key for effect in found.effects),
        candidates=found.candidates,
        odd=found.presses.odd.presses,
        nearest="" if found.remainder.nearest is None else found.remainder.nearest[0],
        modulus=shown.youngs_modulus if last else None,
        next_modulus=None if last else found.material.after.youngs_modulus,
        own_effect="" if shape is None else own_effect(shape, wording.covariate(shape.covariate)),
        next_E_MPa=None if last or len(found.effects) > 1 else found.material.after.youngs_modulus.interval95,
        warnings=tuple(dict.fromkeys(one for one in shown.warnings if one not in data.warnings)),
    )


# Cancellation of work that nobody waits for any more, by a signal within it.
#
# A signal cancels work by raising `Dropped` in the main thread, within a fit; in another thread, and on Windows,
# work continues to its end. `Dropping.whole` protects what must be complete.

SIGNAL = getattr(signal, "SIGUSR1", None)


class Dropped(BaseException):
    """Work was cancelled; not an Exception, so that a fit does not handle it as a failure."""


class Dropping:
    """Cancellation of one piece of work at a time, by its name."""

    def __init__(self) -> None:
        self._at, self._what, self._wanted, self._armed = "", "", False, False

    @contextmanager
    def armed(self) -> Iterator[None]:
        """Allow cancellation while the block runs, where the system supports it."""
        if SIGNAL is None or threading.current_thread() is not threading.main_thread():
            yield
            return

        def end(_number: int, _frame: FrameType | None) -> None:
            if self._at:
                raise Dropped
            self._wanted = True

        before = signal.signal(SIGNAL, end)
        self._armed = True
        try:
            yield
        finally:
            self._armed = False
            signal.signal(SIGNAL, before)

    def run(self, what: str, job: Callable[[], None]) -> bool:
        """Run a job; return False where it was cancelled."""
        try:
            self._wanted, self._what, self._at = False, what, what
            job()
            self._at = ""
        except Dropped:
            return False
        finally:
            self._at = self._what = ""
        return True

    @contextmanager
    def whole(self) -> Iterator[None]:
        """Complete the block, then cancel the work if that was requested meanwhile."""
        if threading.current_thread() is not threading.main_thread() or not self._at:
            yield
            return
        at, self._at = self._at, ""
        yield
        self._at = at
        if self._wanted:
            self._wanted = False
            raise Dropped

    def keep(self) -> None:
        """Protect the rest of the current work, which stores its result."""
        self._at = self._what = ""

    @property
    def what(self) -> str:
        """Name of the current work that can be cancelled; empty where there is none."""
        return self._what if self._armed else ""

    def drop(self, *what: str) -> None:
        """Cancel the current work if it has one of these names. May be called from any thread."""
        if self._armed and SIGNAL is not None and self._what in what:
            _thread.interrupt_main(SIGNAL)
