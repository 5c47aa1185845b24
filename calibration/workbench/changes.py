"""Actions on a model as a sequence of histories; undo returns to the last one."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibration.inputs.observations import press_names
from calibration.report.misfit import BASE
from calibration.tasks.session import History, Labelled, Step
from calibration.workbench.opened import Opened
from tactilevision.errors import InputError

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
        taken_back = len(before.steps) < len(self.now.steps) and before.left_out == self.now.left_out
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
        case "add":
            return track.then(now.add(Step(value, opened.files.get(opened.effect(value).key, ""))))
        case "remove":
            return track.then(now.remove(value))
        case "leave_out":
            if value not in press_names(opened.data) or value in now.left_out:
                raise InputError("there is no such press to exclude", where="workbench", value=value)
            return track.then(replace(now, left_out=tuple(sorted((*now.left_out, value)))))
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


def seconds_allowed(action: str) -> float:
    """Return the time limit of a change, s."""
    return FIT_S if action in ("card", "add") else READ_S


def in_words(action: str, value: str) -> str:
    """Return an action in words."""
    said = value.replace("_", " ")
    return {
        "open": f"fitting the {BASE}",
        "add": f"adding {said}",
        "remove": f"removing {said}",
        "card": f"fitting {said}",
        "export": "writing the report",
        "sides": "fitting both states",
        "leave_out": f"fitting without {value}",
        "put_back": f"fitting with {value}",
    }.get(action, action)
