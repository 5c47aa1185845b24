"""State of one page: the current model, evidence for each effect, and cancellable background work.

    a change -> the model is fitted -> the page is updated -> evidence for effects -> the likeliest are fitted

The verdict comes from a process of its own. A reader gets one immutable `Shown` with a growing version number.
`Dropping` cancels work.
"""

from __future__ import annotations

import shlex
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import chain
from pathlib import Path

from calibration.report.misfit import BASE
from calibration.tasks.calibrate import HistoryRow, history
from calibration.tasks.compare import Comparison, suggest
from calibration.tasks.session import History, Labelled, Step, steps_of_comparison
from calibration.workbench import analysis
from calibration.workbench.analysis import Asking, Dropping, Evidence, Fitted, Verdict
from calibration.workbench.opened import Opened, what_changed, with_own
from tactilevision.errors import InputError
from tactilevision.files.opening import real_path
from tactilevision.records.measured import Estimate

# Actions on a model as a sequence of histories; undo returns to the last one.

NOW = "now"  # name of the current state
FIT_S = 120  # s, limit of one change: a slow effect on 39 presses takes half a minute
READ_S = 1800  # s, limit of a report: a hundred presses on a slow machine


@dataclass(frozen=True, slots=True)
class Track:
    """Current history, those before it, and those that were undone."""

    now: History
    past: tuple[History, ...] = ()
    future: tuple[History, ...] = ()

    def then(self, history: History) -> Track:
        """Return the track with one more change; undone ones are discarded."""
        return Track(history, (*self.past, self.now))

    def undo(self) -> Track:
        """Return the track without the last change. Raises InputError where there is none."""
        if not self.past:
            raise InputError("there is nothing to undo", where="workbench")
        *past, before = self.past
        taken_back = len(before.steps) + 1 == len(self.now.steps) and before.left_out == self.now.left_out
        last = self.now.undo() if taken_back else before  # `tactilevision steps --redo` restores it
        return Track(replace(last, labels=self.now.labels), tuple(past), (*self.future, self.now))

    def redo(self) -> Track:
        """Return the track with the change that was undone last. Raises InputError where there is none."""
        if not self.future:
            raise InputError("there is nothing to redo", where="workbench")
        *future, after = self.future
        return Track(replace(after, labels=self.now.labels), (*self.past, self.now), tuple(future))


def change(track: Track, action: str, value: str, opened: Opened) -> Track:
    """Return the track after an action of the page. Raises InputError for an impossible one."""
    now = track.now
    match action:
        case "undo":
            return track.undo()
        case "redo":
            return track.redo()
        case "label":
            return replace(track, now=now.label(value))
        case "add":  # one key a line
            steps = [Step(key, opened.files.get(opened.effect(key).key, "")) for key in value.splitlines() or [""]]
            return track.then(reduce(History.add, steps, now))
        case "remove":
            return track.then(now.remove(value))
        case "leave_out":
            return track.then(replace(now, left_out=tuple(sorted({*now.left_out, value}))))
        case "put_back":
            if value not in now.left_out:
                raise InputError("this press is not excluded", where="workbench", value=value)
            return track.then(replace(now, left_out=tuple(name for name in now.left_out if name != value)))
        case "restore":
            state = named_state(now, value)
            return track.then(replace(now, steps=state.steps, left_out=state.left_out, undone=()))
    raise InputError("there is no such action", where="workbench", value=action)


def named_state(history: History, name: str) -> Labelled:
    """Return a state by its name, also BASE and NOW. Raises InputError for an unknown name."""
    standard = (Labelled(BASE, (), history.left_out), Labelled(NOW, history.steps, history.left_out))
    found = next((one for one in (*history.labels, *standard) if one.name == name), None)
    if found is None:
        raise InputError("there is no state of this name", where="workbench", value=name)
    return found


def in_words(action: str, value: str) -> str:
    """Return an action in words."""
    said = " and ".join(value.splitlines()).replace("_", " ")
    return {
        "open": f"fitting the {BASE}",
        "add": f"adding {said}",
        "remove": f"removing {said}",
        "card": f"fitting {said}",
        "own": "running your effect",
        "export": "writing the report",
        "sides": "fitting both states",
        "leave_out": f"fitting without {value}",
        "put_back": f"fitting with {value}",
    }.get(action, action)


BACKGROUND, ACTION = "background", "action"
LOOK_S = 2.0  # s between checks of the files
TOLD_S = 0.3  # s between two reports of the progress of one step
Place = tuple[tuple[str, ...], tuple[str, ...]]  # a state: presses excluded, and effects in their order
Export = Callable[["Shown", Opened, Path], Path]
Read = Callable[["Bench"], Opened]  # certifies presses; reports to `Bench.report` and `Bench.warned`


@dataclass(frozen=True, slots=True)
class Shown:
    """Immutable content of the page.

    `earlier`: the evidence before the last change, until there is new one; `busy`: the current work since
    `since_s` (time.monotonic); `notice`: outcome of the last action; `verdict`: None while the diagnosis runs with
    its progress in `asking`; `named`: effects that the diagnosis before named and that are not added yet;
    `troubled`: why there is no verdict; `sides`: two states to compare, by name; `weeks`: each of several
    recordings alone; `changed`: changes of the files since; `stated`: E of the last model after a diagnosis.
    """

    version: int
    track: Track
    now: Fitted | None = None
    evidence: tuple[Evidence, ...] = ()
    earlier: tuple[Evidence, ...] = ()
    suggested: tuple[str, ...] = ()
    verdict: Verdict | None = None
    named: tuple[str, ...] = ()
    asking: Asking | None = None
    troubled: str = ""
    busy: str = ""
    since_s: float = 0.0
    notice: str = ""
    saved: str = ""
    changed: str = ""
    sides: tuple[tuple[str, Fitted], ...] = ()
    weeks: tuple[HistoryRow, ...] = ()
    stated: Estimate | None = None

    @property
    def history(self) -> History:
        """Current history, its steps with their errors."""
        return self.track.now

    def said(self, opened: Opened) -> tuple[list[str], list[str]]:
        """Return the verdict and its remarks, and the caveats: of the data, of it, and of excluded presses."""
        one, out = self.verdict, self.history.left_out
        verdict = ["No verdict: the search for missing effects was not finished."]
        if one is not None:
            verdict = [f"{one.word}. {one.sentence}", *one.remarks]
        excluded = [f"Excluded by hand: {', '.join(out)}."] if out else []
        return verdict, [*opened.warnings, *(() if one is None else one.warnings), *excluded]

    def found(self, opened: Opened) -> Comparison:
        """Return the models as a report shows them: with E after the diagnosis, and with every caveat."""
        assert self.now is not None
        models, caveats = [], self.said(opened)[1]
        for model in self.now.found.models:
            gel = model.material
            if gel is not None:
                gel = replace(gel, warnings=tuple(dict.fromkeys((*gel.warnings, *caveats))))
            models.append(replace(model, material=gel))
        return replace(self.now.found, models=tuple(models), suggested=self.suggested, over=self.stated)


@dataclass(slots=True)
class Known:
    """What is known of a state: evidence, effects to try (None: not looked for yet), and the verdict."""

    evidence: tuple[Evidence, ...] = ()
    suggested: tuple[str, ...] | None = None
    verdict: Verdict | None = None


class Bench:
    """One analysis. `act` and `wait` may be called from any thread; `work` runs in one.

    `opened` may lack what `read` returns, which is called first, while the page shows presses and frames.
    """

    def __init__(
        self,
        opened: Opened,
        begin: History,
        *,
        export: Export,
        keep: Callable[[History], None],
        out: Path,
        asks: bool = True,
        read: Read | None = None,
    ) -> None:
        self.opened, self._read, self._told_s, self._saved = opened, read, 0.0, False
        self.models = analysis.Models(opened, begin.seed)
        self._export, self._keep, self._out, self._asks = export, keep, out, asks
        self._turn = threading.Condition()
        self._todo: deque[tuple[str, str]] = deque([("open", "")])
        self._ended = False
        self._asked: analysis.Asked | None = None
        self._known: defaultdict[Place, Known] = defaultdict(Known)
        self._model_since = 1
        self._dropping = Dropping()
        self._shown = Shown(1, Track(begin), busy=f"fitting the {BASE}", since_s=time.monotonic())

    @property
    def again(self) -> str:
        """Command that goes on where this page ends."""
        folder = str(real_path(self._out))
        own = [("--effect", file) for file in self.opened.files.values()]
        begin = f"tactilevision workbench --state {shlex.quote(folder)}"
        begin = begin if self._saved else self._shown.history.command("workbench")
        return f"{begin} {shlex.join(['--out', folder, *chain(*own)])}"

    @property
    def shown(self) -> Shown:
        """Current content of the page."""
        with self._turn:
            return self._shown

    def act(self, action: str, value: str = "", *, version: int | None = None) -> None:
        """Queue an action; `version` of the state that the user saw.

        Raises InputError where the model has changed since.
        """
        with self._turn:
            if version is not None and action != "stop" and self._stale(version):
                raise InputError(
                    "the model has been changed since, in another tab", where="workbench", value=action,
                    remedy="Check the present model and repeat the action if it still applies.",
                )  # fmt: skip
            if action != "stop":
                self._todo.append((action, value))
            self._turn.notify_all()
        self._dropping.drop(*((BACKGROUND, ACTION) if action == "stop" else (BACKGROUND,)))

    def wait(self, version: int, seconds: float) -> Shown:
        """Return the content once it differs from `version`, or after so many s."""
        until = time.monotonic() + seconds
        while True:
            changed = what_changed(self.opened)
            with self._turn:
                if changed != self._shown.changed:
                    self._show(changed=changed)
            left = until - time.monotonic()
            with self._turn:
                if self._turn.wait_for(
                    lambda: self._shown.version != version or self._ended, min(left, LOOK_S)
                ) or (left <= LOOK_S):
                    return self._shown

    def end(self) -> None:
        """Stop all work and waiting."""
        with self._turn:
            self._ended = True
            self._turn.notify_all()
        self._drop_question()

    def work(self, *, until_idle: bool = False) -> None:
        """Process the queue until `end`, or until it is empty."""
        with self._dropping.armed():
            while self.work_once(until_idle=until_idle):
                if not self._waiting:
                    self._dropping.run(BACKGROUND, self._look_on)
                    self._show(busy="")

    def work_once(self, *, until_idle: bool = True) -> bool:
        """Process the next action; return False where there is none."""
        one = self._next(until_idle=until_idle)
        if one is None:
            return False
        began, limit = time.monotonic(), FIT_S if one[0] in ("card", "add", "own") else READ_S
        over = threading.Timer(limit, self._dropping.drop, (ACTION,))
        over.daemon = True
        over.start()
        if not self._dropping.run(ACTION, lambda: self._do(*one)):
            why = f" after {limit:.0f} s" if time.monotonic() - began >= limit else ""
            self._show(busy="", notice=f"{in_words(*one)} was stopped{why}; nothing is changed")
        over.cancel()
        return True

    def _next(self, *, until_idle: bool) -> tuple[str, str] | None:
        """Wait for the next action; return None at the end."""
        with self._turn:
            self._turn.wait_for(lambda: self._ended or bool(self._todo) or until_idle)
            return None if self._ended or not self._todo else self._todo.popleft()

    @property
    def _waiting(self) -> bool:
        return bool(self._todo) or self._ended

    @property
    def stoppable(self) -> bool:
        """Whether the current action can be stopped."""
        return self._dropping.what == ACTION

    def _stale(self, version: int) -> bool:
        """Return whether the model has changed since this version; new evidence does not count."""
        return version < self._model_since or any(
            action not in ("card", "export", "sides", "look") for action, _ in self._todo
        )

    def _show(self, **news: object) -> None:
        with self._dropping.whole(), self._turn:
            self._shown = replace(self._shown, version=self._shown.version + 1, **news)  # type: ignore[arg-type]
            self._turn.notify_all()

    def _do(self, action: str, value: str) -> None:
        """Process one action; an error is shown on the page, and the state is kept."""
        if action == "look":  # there is more to look for
            return
        certifies = action == "open" and self._read is not None
        said = "certifying the presses" if certifies else in_words(action, value)
        self._show(busy=said, since_s=time.monotonic(), notice="")
        try:
            if action == "card":
                self._open_card(value)
            elif action == "sides":
                self._show(sides=self._side_by_side(value.splitlines(), self._quick))
            elif action == "export":
                self._complete()
                self._show(saved=str(self._export(self._shown, self.opened, self._out)))
            elif action == "own":
                self._add_own(value)
            else:
                self._change(action, value)
        except Exception as fault:  # a private effect may raise anything; the page lives on
            self._show(notice=str(fault) or type(fault).__name__)
        self._show(busy="")

    def report(self, what: str, done: int, of: int) -> None:
        """Show the step of certifying that runs, `done` of so many; not more often than every TOLD_S."""
        asking, now_s = self._shown.asking or Asking(), time.monotonic()
        if what != asking.what or now_s > self._told_s + TOLD_S:
            self._told_s = now_s
            self._show(asking=asking.then(what, done, of))

    def warned(self, lines: Sequence[str]) -> None:
        """Show warnings as they arise."""
        self.opened = replace(self.opened, warnings=tuple(dict.fromkeys((*self.opened.warnings, *lines))))
        self._show()

    def _certify(self) -> None:
        """Certify the presses; where that fails, the page keeps what it shows, and says why."""
        self._dropping.keep()  # what is half certified serves nobody
        assert self._read is not None
        try:
            self.opened = self._read(self)
        except Exception as fault:
            self._show(troubled=str(fault) or type(fault).__name__, busy="", asking=None)
            raise
        self.models = analysis.Models(self.opened, self._shown.history.seed)
        self._show(asking=None, busy=in_words("open", ""), since_s=time.monotonic())

    def _add_own(self, text: str) -> None:
        """Add the private effect of this text; where it cannot be run or fitted, everything stays."""
        before = self.opened
        self.opened, key = with_own(before, text, self._out)
        try:
            if key in (step.key for step in self._shown.history.steps):
                said = "an effect of this key is in the model"
                raise InputError(said, where="your effect", value=key, remedy="Remove it, or change the key.")
            self.models.use(self.opened, key)
            self._change("add", key)
        except BaseException:
            self.opened = before
            self.models.use(before, key)
            raise
        for place, known in self._known.items():
            known.evidence = ()
            if key in place[1]:
                known.verdict, known.suggested = None, None

    def _stated(self, at: History, found: Comparison) -> Estimate | None:
        """Return E of a state by its own diagnosis, else by the one of the base model that named its effects."""
        left_out, keys = self._place(at)
        own, base = (self._known[left_out, one].verdict for one in (keys, ()))
        if own is not None and own.modulus is not None:
            return own.modulus
        named = base is not None and base.word == "IDENTIFIED" and set(found.models[-1].effects) == set(base.named)
        return base.next_modulus if base is not None and named else None

    def _change(self, action: str, value: str) -> None:
        if action == "open" and self._read is not None:
            self._certify()
        track = self._shown.track if action == "open" else change(self._shown.track, action, value, self.opened)
        now = track.now
        fitted = self.models.fitted(now.left_out, [step.key for step in now.steps])
        if fitted.found.left_out:
            key, why = fitted.found.left_out[-1]
            raise InputError(f"{key.replace('_', ' ')} cannot be added: {why.rstrip('.')}")
        same = self._shown.now is fitted
        steps = tuple(steps_of_comparison(fitted.found, self.opened.files))
        track = replace(track, now=replace(now, steps=steps))
        self._dropping.keep()
        self._saved = self._saved or action != "open" or track.now != History(track.now.recordings)
        if self._saved:
            self._keep(track.now)
        if same:
            self._show(track=track)
            return
        self._drop_question()
        known, before, keys = self._known[self._place(track.now)], self._shown, {step.key for step in steps}
        sure = before.verdict is not None and before.verdict.word != "AMBIGUOUS"
        named = before.verdict.named if before.verdict is not None and sure else before.named
        earlier = () if known.evidence else before.evidence or before.earlier
        self._model_since = self._shown.version + 1
        self._show(
            track=track,
            now=fitted,
            evidence=known.evidence,
            earlier=tuple(one for one in earlier if one.effect.key not in keys),
            suggested=known.suggested or (),
            verdict=known.verdict,
            named=() if known.verdict else tuple(key for key in named if key not in keys),
            asking=None,
            stated=self._stated(track.now, fitted.found),
            troubled="",
            saved="",
            sides=(),
        )

    @staticmethod
    def _place(at: History) -> Place:
        return at.left_out, tuple(step.key for step in at.steps)

    def _look_on(self) -> None:
        """Complete the current model, its evidence, and the fits of the likeliest effects."""
        shown = self._shown
        if shown.now is None:
            return
        place = self._place(shown.history)
        self._ask(shown, place)
        try:
            if shown.now.rng is None:
                self._show(busy="determining the material", since_s=time.monotonic())
                self._complete()
            known = self._known[place]
            self._show(busy="testing effects", since_s=time.monotonic())
            if not known.evidence:
                self._keep_look(place, analysis.find_evidence(self.opened, shown.now, seed=shown.history.seed))
            named = () if known.verdict is None else (*known.verdict.named, *known.verdict.candidates)
            for one in analysis.to_fit(known.evidence, named):
                if not self._fit_card(one):
                    return
            if known.suggested is None:
                known.suggested = suggest(self._completed(shown.history).found)
            self._show(suggested=known.suggested, busy="")
            if any(fitted.rng is None for _, fitted in shown.sides):
                self._show(busy="determining the material of both states", since_s=time.monotonic())
                self._show(sides=self._side_by_side([name for name, _ in shown.sides], self._completed))
            if len(self.opened.measured) > 1 and not shown.weeks:
                self._show(busy="fitting each recording alone", since_s=time.monotonic())
                self._show(weeks=history(self.opened.measured), busy="")
        except Exception as fault:  # as above
            self._show(notice=str(fault) or type(fault).__name__)

    def _complete(self) -> None:
        """Determine the material and the residual's covariates of the current model."""
        self._show(now=self._completed(self._shown.history))

    def _completed(self, state: History | Labelled) -> Fitted:
        return self.models.completed(state.left_out, [step.key for step in state.steps])

    def _keep_look(self, place: Place, table: tuple[Evidence, ...]) -> bool:
        self._known[place].evidence = table
        self._show(evidence=table, earlier=())
        return not self._waiting

    def _open_card(self, key: str) -> None:
        """Fit one effect of the list, to show its residual."""
        for one in self._shown.evidence:
            if one.effect.key == key and one.fall is None:
                self._fit_card(one)

    def _fit_card(self, one: Evidence) -> bool:
        """Fit one effect on top of the current model; return whether nothing else waits."""
        left_out, keys = place = self._place(self._shown.history)
        fitted = analysis.fitted_evidence(self.models, left_out, keys, one)
        return self._keep_look(place, analysis.with_fitted(self._known[place].evidence, fitted))

    def _side_by_side(
        self, names: Sequence[str], fitted: Callable[[Labelled], Fitted]
    ) -> tuple[tuple[str, Fitted], ...]:
        """Return two states by their names; nothing for another number of names."""
        if len(names) != 2:
            return ()
        return tuple((name, fitted(named_state(self._shown.history, name))) for name in names)

    def _quick(self, state: Labelled) -> Fitted:
        """Return the models of a state as far as they are known; none is fitted again."""
        return self.models.fitted(state.left_out, [step.key for step in state.steps])

    def _ask(self, shown: Shown, place: Place) -> None:
        if not self._asks or shown.now is None or self._known[place].verdict or self._asked is not None:
            return
        keys = [step.key for step in shown.history.steps]

        def hear(found: Verdict | str) -> None:
            verdict, why = (found, "") if isinstance(found, Verdict) else (None, found)
            for count in range(len(keys)) if verdict else ():
                earlier = self._known[place[0], place[1][:count]].verdict
                verdict = verdict.after(earlier, keys[count:]) if verdict else None
            self._known[place].verdict = verdict
            if self._place(self._shown.history) == place:
                now = self._shown.now
                stated = self._stated(self._shown.history, now.found) if now else None
                self._show(verdict=verdict, named=(), asking=None, troubled=why, stated=stated)
                with self._turn:
                    self._todo.append(("look", ""))  # the effects that it named may not be fitted yet
                    self._turn.notify_all()

        def report(what: str, tried: int, of: int) -> None:
            self._show(asking=(self._shown.asking or Asking()).then(what, tried, of))

        opened, data = self.opened, shown.now.found.stated
        own, seed = tuple(opened.files.values()), shown.history.seed
        question = partial(
            analysis.diagnosed, data=data, known=keys, own=own, seed=seed, bulge=opened.bulge, bound=opened.bound
        )
        self._show(asking=Asking("reading the measurements"))
        with self._dropping.whole():
            self._asked = analysis.Asked(question, report=report, answer=hear)

    def _drop_question(self) -> None:
        if self._asked is not None:
            self._asked.drop()
            self._asked = None
