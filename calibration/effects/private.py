"""Effects of a user's own file, which run in a process of their own."""

from __future__ import annotations

import builtins
import inspect
import keyword
import os
import pickle
import threading
import time
from functools import partial, partialmethod
from pathlib import Path
from typing import Any

import numpy as np

from calibration.effects import EFFECTS
from calibration.effects.private_process import Shelf, calls
from calibration.inputs.observations import Observations
from calibration.model.stages import Effect, EffectBase, Parameter
from tactilevision.errors import InputError, OutputError
from tactilevision.files.child import WAIT_S, Child, raised
from tactilevision.files.opening import limit
from tactilevision.files.writing import write_text

METHODS = tuple(name for name, _ in inspect.getmembers(EffectBase, inspect.isfunction) if name[0] != "_")
KEPT = 8  # Observations that the process keeps: a fit calls with some, thousands of times


class _Process:
    """The process of one file: it starts for the first call, and again after one that was ended."""

    def __init__(self, file: Path) -> None:
        self.file, self.starts = file, 0
        self._lock, self._child = threading.RLock(), None  # type: tuple[Any, Child | None]
        self._owner = 0  # the process that started it

    def call(self, effect: PrivateEffect | None, method: str = "", given: tuple[Any, ...] = ()) -> Any:
        """Return what a method of an effect returns; None: the effect of the file.

        Raises InputError where it does not end within MAX_EFFECT_SECONDS or ends its process, and what it raises.
        """
        with self._lock:
            try:
                kind, *found = self._ask(effect, method, given)
            except BaseException:  # an interrupt: the rest of an answer is in the pipe
                self._end()
                raise
            if kind == "found":
                make = partial(PrivateEffect, self, (effect, method, given))
                return self._shelf.unpack(found[0].tobytes(), make)
        if len(found) > 1:
            raise raised(kind, *found)
        own = getattr(builtins, kind, getattr(np.linalg, kind, None))
        if isinstance(own, type) and issubclass(own, Exception) and not issubclass(own, UnicodeError):
            raise own(*found)
        raise RuntimeError(f"{kind}: {found[0]}")

    def _end(self) -> None:
        if self._child is not None:
            self._child.kill()
        self._child = None

    def _ask(self, effect: PrivateEffect | None, method: str, given: tuple[Any, ...]) -> list[Any]:
        if self._child is None or self._owner != os.getpid():  # a copy of this process starts its own
            self._owner, self._shelf, self._sent, self.starts = os.getpid(), Shelf(), 0, self.starts + 1
            self._child = Child({})
            self._child.start(calls, (str(self.file),))
            self._receive(str(self.file), time.monotonic(), WAIT_S)
            if effect is not None:
                self.call(None)
        number, where = (0, str(self.file)) if effect is None else (effect.number(), f"{effect.kind}.{method}")
        for data in given:
            if type(data) is Observations and id(data) not in self._shelf.names:
                place, self._sent = self._sent % KEPT, self._sent + 1
                self._child.ask(self._shelf.pack((None, "", (place, data), {})))
                self._shelf.keep(place, data)
        asked_s, seconds = time.monotonic(), limit("MAX_EFFECT_SECONDS")
        self._child.ask(self._shelf.pack((number, method, given, np.geterr())), within_s=seconds)
        return self._receive(where, asked_s, seconds)

    def _receive(self, where: str, asked_s: float, seconds: int) -> list[Any]:
        assert self._child is not None
        try:
            return self._child.receive(until_s=asked_s + seconds)[1:]
        except (EOFError, TimeoutError):
            what, remedy = "ended its process", "Look for what exits, or takes all memory."
        if time.monotonic() >= asked_s + seconds:
            what = f"did not end within {seconds} s"
            remedy = "Look for a loop without end. A slow effect: set TACTILEVISION_MAX_EFFECT_SECONDS."
        raise InputError(what, where=where, remedy=remedy)


class PrivateEffect(EffectBase):
    """An effect of a user's file: what it states of itself, and its methods as calls of its process.

    It cannot be pickled, so that what is sent to workers is computed here.
    """

    def __init__(
        self, process: _Process, origin: tuple[Any, ...], number: int, kind: str, about: dict[str, Any]
    ) -> None:
        self._process, self._origin, self._number, self.kind = process, origin, (process.starts, number), kind
        self._parameters: tuple[Parameter, ...] = about.pop("parameters")
        vars(self).update(about)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._parameters

    __eq__, __hash__ = object.__eq__, object.__hash__  # statements may hide what differs

    def __reduce__(self) -> Any:
        raise pickle.PicklingError("an effect of a user's file stays in this process")

    def _call(self, method: str, *given: Any) -> Any:
        return self._process.call(self, method, given)

    def number(self) -> int:
        """Return its number in the process, where it is made again if that was started again."""
        starts, number = self._number
        parent, method, given = self._origin
        if starts != self._process.starts:
            number = 0 if parent is None else self._process.call(parent, method, given)._number[1]
            self._number = self._process.starts, number
        return number


for _name in METHODS:
    setattr(PrivateEffect, _name, partialmethod(PrivateEffect._call, _name))
TEMPLATE = Path(__file__).parent / "template.txt"


def load_effect(path: Path | str) -> Effect:
    """Load the one effect that a file defines: a subclass of EffectBase that can be made without arguments.

    The file is run like any script of the user's, in a process of its own, which is ended where a call lasts
    longer than MAX_EFFECT_SECONDS; only a path that the user names is loaded. Raises InputError where the file
    cannot be run, defines none or several effects, or an incomplete one.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError("there is no such file", where="--effect", value=str(file))
    effect: Effect = _Process(file).call(None)
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
    name = "".join(word.capitalize() for word in key.split("_"))
    write_text(file, TEMPLATE.read_text(encoding="utf-8").replace("KEY", key).replace("NAME", name))
