"""What a person can do to a model, as histories that follow each other; to undo is to go back to the last."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from calibration.inputs.observations import press_names
from calibration.report.misfit import BASE
from calibration.tasks.session import History, Labelled, Step
from calibration.workbench.opened import Opened
from tactilevision.errors import InputError

NOW = "now"  # the state that stands, beside those with a name
FIT_S = 120.0  # s that one change may take: a slow effect on 39 presses takes half a minute
READ_S = 1800.0  # s where a report is drawn: a hundred presses on a slow machine


@dataclass(frozen=True, slots=True)
class Track:
    """The history that stands, those before it, and those that were undone."""

    now: History
    past: tuple[History, ...] = ()
    future: tuple[History, ...] = ()

    def then(self, history: History) -> Track:
        """One more change; what was undone is forgotten."""
        return Track(history, (*self.past, self.now))

    def undo(self) -> Track:
        """Without the last change. Raises InputError where there is none."""
        if not self.past:
            raise InputError("there is nothing to undo", where="workbench")
        *past, before = self.past
        taken_back = len(before.steps) < len(self.now.steps) and before.left_out == self.now.left_out
        undone = self.now.undo() if taken_back else before  # `tactilevision steps --redo` puts it back
        back = replace(undone, labels=self.now.labels)
        return Track(back, tuple(past), (*self.future, self.now))

    def redo(self) -> Track:
        """With the change that was undone last. Raises InputError where there is none."""
        if not self.future:
            raise InputError("there is nothing to redo", where="workbench")
        *future, after = self.future
        return Track(replace(after, labels=self.now.labels), (*self.past, self.now), tuple(future))


def change(track: Track, action: str, value: str, opened: Opened) -> Track:
    """The track after an action of the page. Raises InputError for one that is not possible."""
    if action == "undo":
        return track.undo()
    if action == "redo":
        return track.redo()
    if action == "label":
        return replace(track, now=track.now.label(value))
    if action not in _CHANGES:
        raise InputError("there is no such action", where="workbench", value=action)
    return track.then(_CHANGES[action](track.now, value, opened))


def _add(history: History, value: str, opened: Opened) -> History:
    effect = opened.effect(value)
    return history.add(Step(value, opened.files.get(effect.key, "")))


def _remove(history: History, value: str, _opened: Opened) -> History:
    return history.remove(value)


def _leave_out(history: History, value: str, opened: Opened) -> History:
    names = press_names(opened.data)
    if value not in names or value in history.left_out:
        raise InputError("there is no such press to leave out", where="workbench", value=value)
    return replace(history, left_out=tuple(sorted((*history.left_out, value))))


def _put_back(history: History, value: str, _opened: Opened) -> History:
    if value not in history.left_out:
        raise InputError("this press is not left out", where="workbench", value=value)
    return replace(history, left_out=tuple(name for name in history.left_out if name != value))


def _restore(history: History, value: str, _opened: Opened) -> History:
    state = named_state(history, value)
    return replace(history, steps=state.steps, left_out=state.left_out, undone=())


def named_state(history: History, name: str) -> Labelled:
    """A state by its name; the plain law and what stands are always two. Raises InputError for an unknown name."""
    found = next((one for one in history.labels if one.name == name), None)
    if found is None and name == BASE:
        return Labelled(BASE, (), history.left_out)
    if found is None and name == NOW:
        return Labelled(NOW, history.steps, history.left_out)
    if found is None:
        raise InputError("there is no state of this name", where="workbench", value=name)
    return found


_CHANGES: Mapping[str, Callable[[History, str, Opened], History]] = {
    "add": _add,
    "remove": _remove,
    "leave_out": _leave_out,
    "put_back": _put_back,
    "restore": _restore,
}


def seconds_allowed(action: str) -> float:
    """After how many s a change is stopped, and the page says so."""
    return FIT_S if action in ("card", "add") else READ_S


def in_words(action: str, value: str) -> str:
    """What is at work, as a person says it."""
    said = value.replace("_", " ")
    return {
        "open": "fitting the plain law",
        "add": f"adding {said}",
        "remove": f"removing {said}",
        "card": f"fitting {said}",
        "export": "writing the report",
        "sides": "fitting both states",
        "leave_out": f"fitting without {value}",
        "put_back": f"fitting with {value}",
    }.get(action, action)
