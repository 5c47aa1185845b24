"""Effects of a user's own file, which run in a process of their own."""

from __future__ import annotations

import builtins
import inspect
import keyword
import os
import pickle
import threading
import time
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from calibration.effects import EFFECTS
from calibration.effects.private_process import LOAD, RECORDS, Kept
from calibration.inputs.observations import Observations
from calibration.model.stages import Effect, EffectBase, Parameter, Stage
from tactilevision.errors import InputError, OutputError
from tactilevision.files.child import Child
from tactilevision.files.opening import limit
from tactilevision.files.writing import write_text

METHODS = tuple(name for name, _ in inspect.getmembers(EffectBase, inspect.isfunction) if name[0] != "_")
KEPT = 8  # Observations that the process keeps: a fit calls with some, thousands of times
START_S = 60  # s for the process to import the library, even if other programs keep the processor


class _Process:
    """The process of one file: it starts for the first call, and again after one that was ended."""

    def __init__(self, file: Path) -> None:
        self.file, self.starts = file, 0
        self._lock, self._child = threading.RLock(), None  # type: tuple[Any, Child | None]
        self._owner = 0  # the process that started it
        self._kept: list[Observations] = []
        self._parts: list[dict[int, Kept]] = []  # of each, by id
        self._sent = 0

    def call(self, effect: PrivateEffect | None, method: str, given: tuple[Any, ...]) -> Any:
        """Return what a method of an effect returns; None: of the file.

        Raises InputError where it does not end within MAX_EFFECT_SECONDS or ends its process, and what it raises.
        """
        with self._lock:
            if self._child is None or self._owner != os.getpid():  # a copy of this process starts its own
                self._start()
                if effect is not None:
                    self.call(None, LOAD, (str(self.file),))
            number = 0 if effect is None else effect.number()
            where = str(self.file) if effect is None else f"{effect.kind}.{method}"
            try:
                answer = self._ask(number, method, given, where)
            except BaseException:  # an interrupt: the rest of an answer is in the pipe
                self._end()
                raise
        return self._found(answer, effect, method, given)

    def _start(self) -> None:
        self._owner = os.getpid()
        self._child = Child("calibration.effects.private_process", settings={})
        self._kept, self._parts, self._sent, self.starts = [], [], 0, self.starts + 1
        try:
            self._child.receive(until_s=time.monotonic() + START_S)
        except BaseException as fault:
            self._end()
            if isinstance(fault, EOFError | TimeoutError):
                raise InputError("the effect's process does not start", where=self.file) from fault
            raise

    def _end(self) -> None:
        if self._child is not None:
            self._child.kill()
        self._child = None

    def _ask(self, number: int, method: str, given: tuple[Any, ...], where: str) -> list[Any]:
        assert self._child is not None
        seconds, fresh = limit("MAX_EFFECT_SECONDS"), dict[int, dict[str, Any]]()
        sent = [self._kept_as(one, fresh) if type(one) is Observations else one for one in given]
        self._child.send(
            pickle.dumps((seconds, fresh, number, method, sent, np.geterr()), pickle.HIGHEST_PROTOCOL)
        )
        try:
            return self._child.receive(until_s=time.monotonic() + seconds)
        except TimeoutError:
            what = f"did not end within {seconds} s"
            remedy = "Look for a loop without end. A slow effect: set TACTILEVISION_MAX_EFFECT_SECONDS."
        except EOFError:
            what, remedy = "ended its process", "Look for what exits, or takes all memory."
        raise InputError(what, where=where, remedy=remedy)

    def _kept_as(self, data: Observations, fresh: dict[int, dict[str, Any]]) -> Kept:
        """Return the number of Observations; if it is new, `fresh` gets what differs from those that are kept."""
        for number, one in enumerate(self._kept):
            if one is data:
                return Kept(number)
        known = {key: at for each in self._parts for key, at in each.items()}
        parts = {field.name: getattr(data, field.name) for field in fields(data)}
        number, self._sent = self._sent % KEPT, self._sent + 1
        fresh[number] = {name: known.get(id(part), part) for name, part in parts.items()}
        self._kept[number : number + 1] = [data]
        self._parts[number : number + 1] = [{id(part): Kept(number, name) for name, part in parts.items()}]
        return Kept(number)

    def _found(self, answer: list[Any], effect: PrivateEffect | None, method: str, given: tuple[Any, ...]) -> Any:
        kind, said, *arrays = answer
        if kind == "found":
            return restored(said, arrays, given=given, make=partial(PrivateEffect, self, (effect, method, given)))
        if kind == "InputError":
            raise InputError(said[0], **said[1])
        own = getattr(builtins, kind, getattr(np.linalg, kind, None))
        if isinstance(own, type) and issubclass(own, Exception) and not issubclass(own, UnicodeError):
            raise own(said)
        raise RuntimeError(f"{kind}: {said}")


def restored(said: Any, arrays: list[Any], *, given: tuple[Any, ...], make: Any) -> Any:
    """Return the value that `plain` wrote; `make` returns an effect of its number, kind and statements."""
    again = partial(restored, arrays=arrays, given=given, make=make)
    if isinstance(said, list):
        return tuple(map(again, said))
    if not isinstance(said, dict):
        return said
    if "array" in said:
        return arrays[said["array"]]
    if "effect" in said:
        return make(said["effect"], said["kind"], {name: again(value) for name, value in said["about"].items()})
    if said["same"] is not None:
        return given[said["same"]]
    parts = {
        name: getattr(given[part["given"]], name) if isinstance(part, dict) and "given" in part else again(part)
        for name, part in said["fields"].items()
    }
    return RECORDS[said["record"]](**parts)


class PrivateEffect(EffectBase):
    """An effect of a user's file: what it states of itself, and its methods as calls of its process.

    It cannot be pickled, so that what is sent to workers is computed here.
    """

    def __init__(
        self, process: _Process, origin: tuple[Any, ...], number: int, kind: str, about: dict[str, Any]
    ) -> None:
        self._process, self._origin, self._number, self.kind = process, origin, (process.starts, number), kind
        self._parameters: tuple[Parameter, ...] = about.pop("parameters")
        vars(self).update(about, stage=Stage(about["stage"]), analytic=False)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._parameters

    __eq__, __hash__ = object.__eq__, object.__hash__  # statements may hide what differs

    def __reduce__(self) -> Any:
        raise pickle.PicklingError("an effect of a user's file stays in this process")

    def number(self) -> int:
        """Return its number in the process, where it is made again if that was started again."""
        starts, number = self._number
        parent, method, given = self._origin
        if starts != self._process.starts:
            number = 0 if parent is None else self._process.call(parent, method, given)._number[1]
            self._number = self._process.starts, number
        return number


def _calling(name: str) -> Any:
    def method(self: PrivateEffect, *given: Any) -> Any:
        return self._process.call(self, name, given)

    return method


for _name in METHODS:
    setattr(PrivateEffect, _name, _calling(_name))
TEMPLATE = Path(__file__).parent / "template.txt"


def load_effect(path: Path | str) -> Effect:
    """Load the one effect that a file defines: a subclass of EffectBase that can be made without arguments.

    The file is run like any script of the user's, in a process of its own, which is ended where a call lasts
    longer than MAX_EFFECT_SECONDS; only a path that the user names is loaded. Raises InputError where the file
    cannot be run, defines none or several effects, or an incomplete one.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError("there is no such file", where=file)
    effect: Effect = _Process(file).call(None, LOAD, (str(file),))
    return effect


def new_effect(path: Path | str, key: str) -> None:
    """Write a template of a private effect with this key.

    Raises InputError for a key that is no name in Python or one of the catalogue's, OutputError where the file
    exists.
    """
    if not key.isidentifier() or keyword.iskeyword(key) or key in EFFECTS:
        raise InputError(
            "an effect's key is one word that no effect of the catalogue has",
            where="--key",
            value=key,
            remedy="Use letters and underscores, as in my_effect.",
        )
    file = Path(path)
    if file.exists():
        raise OutputError("the file exists already", where=file, remedy="Choose another name.")
    write_text(file, template(key))


def template(key: str) -> str:
    """Return the text of a template with this key."""
    name = "".join(word.capitalize() for word in key.split("_"))
    return TEMPLATE.read_text(encoding="utf-8").replace("KEY", key).replace("NAME", name)
