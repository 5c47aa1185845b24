"""`diagnose` beside the page: in a process of its own, so that no click waits for it; ended when it is stale."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from calibration.inputs.deadline import Watch
from calibration.inputs.observations import Observations
from calibration.workbench.opened import Opened
from tactilevision.records import Estimate, Pair


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
    from calibration.effects.support.private import load_effect
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
