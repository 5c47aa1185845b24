"""Serve the effect of one file from a process of its own.

The process that fits sends pickles (method, arguments) and receives what `plain` writes: JSON and arrays. An
Observations is sent once and then named by its number. Numbers are those of a call within one process: floats and
arrays pass bit by bit, and numpy's handling of errors is the caller's.
"""

from __future__ import annotations

import faulthandler
import importlib.util
import inspect
import pickle
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple

import numpy as np

from calibration.effects import EFFECTS
from calibration.inputs.observations import EdgeDrop, Observations, Presses, Resultants, Shared, Slopes
from calibration.model.stages import Effect, EffectBase, ManualCheck, Parameter, Prior, State
from tactilevision.errors import InputError
from tactilevision.files.child import begin, fault_fields, send
from tactilevision.records.rig import Gel, Indenter

ABOUT = (*EffectBase.__annotations__, "parameters")  # what an effect states of itself
LOAD = "load"  # the first call, with the file for its argument
RECORDS = {
    kind.__name__: kind
    for kind in (State, Parameter, Prior, ManualCheck, Observations, Presses, Shared, EdgeDrop, Slopes, Resultants)
} | {kind.__name__: kind for kind in (Gel, Indenter)}


class Kept(NamedTuple):
    """An Observations, or a part of one, that the process keeps under a number."""

    number: int
    part: str = ""


def plain(value: Any, parts: list[Any], *, given: Sequence[Any], made: list[Effect]) -> Any:
    """Return a value as JSON; its arrays are added to `parts`, and effects to `made`.

    Observations that were `given`, and parts of them, are named by their numbers and names. Raises TypeError for
    any other kind of value.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biuf" or value.dtype.itemsize > 8:
            raise TypeError(f"an effect returns real numbers, not {value.dtype}")
        parts.append(value.astype(value.dtype.newbyteorder("="), copy=False))
        return {"array": len(parts) - 1}
    if isinstance(value, tuple | list):
        return [plain(one, parts, given=given, made=made) for one in value]
    if isinstance(value, EffectBase):
        number = next((k for k, one in enumerate(made) if one is value), len(made))
        made.extend([value] * (number == len(made)))
        about = {name: getattr(value, name) for name in ABOUT if hasattr(value, name)}
        said = {k: plain(v, parts, given=given, made=made) for k, v in about.items()}
        return {"effect": number, "kind": type(value).__name__, "about": said}
    name = type(value).__name__
    if RECORDS.get(name) is not type(value):
        raise TypeError(f"an effect cannot return {name}")
    alike = [k for k, one in enumerate(given) if type(one) is type(value) is Observations]
    said = {}
    for field in fields(value):
        part = getattr(value, field.name)
        at = next((k for k in alike if getattr(given[k], field.name) is part), None)
        said[field.name] = {"given": at} if at is not None else plain(part, parts, given=given, made=made)
    same = next((k for k in alike if given[k] is value), None)
    return {"record": name, "fields": said, "same": same}


# The process.

_calls: SimpleQueue[tuple[Any, ...]] = SimpleQueue()


def serve() -> None:
    """Answer the calls that come by the standard input, until it ends. What the effect prints goes to stderr."""
    out = begin(_calls, pickle.load, prints_to=2)  # of the process that started this one
    sys.stdout = sys.stderr
    made, known = list[Effect](), dict[int, Observations]()
    send(out, "ready")
    while True:
        seconds, fresh, number, method, sent, errors = _calls.get()
        if sys.platform == "win32":  # elsewhere the caller ends this process
            faulthandler.dump_traceback_later(seconds, exit=True)
        for place, stated in fresh.items():
            named = {
                name: getattr(known[one.number], one.part) if type(one) is Kept else one
                for name, one in stated.items()
            }
            known[place] = Observations(**named)
            for one in named.values():
                if isinstance(one, np.ndarray):
                    one.setflags(write=False)
        given: list[Any] = [known[one.number] if type(one) is Kept else one for one in sent]
        parts: list[Any] = []
        try:
            np.seterr(**errors)
            found = _load(Path(*given)) if method == LOAD else getattr(made[number], method)(*given)
            words = ["found", plain(found, parts, given=given, made=made)]
        except InputError as fault:
            words = ["InputError", fault_fields(fault)]
        except BaseException as fault:  # the effect may raise anything
            words = [type(fault).__name__, str(fault)]
        if sys.platform == "win32":
            faulthandler.cancel_dump_traceback_later()
        send(out, *words, *parts)


def _load(file: Path) -> Effect:
    """Run a file, and return its effect."""
    spec = importlib.util.spec_from_file_location(f"private_effect_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except InputError:
        raise
    except BaseException as fault:  # the file may raise anything
        raise InputError(f"the effect's file fails: {type(fault).__name__}: {fault}", where=file) from fault
    own = [
        kind
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, EffectBase) and kind.__module__ == module.__name__
    ]
    if len(own) != 1:
        raise InputError(
            "an effect's file defines one subclass of EffectBase",
            where=file,
            value=[kind.__name__ for kind in own],
            remedy="`tactilevision new-effect` writes one to begin from.",
        )
    return checked(own[0], file)


def checked(kind: type[EffectBase], where: Path) -> Effect:
    """Return an instance of the effect. Raises InputError where a declaration is missing or its key is taken."""
    try:
        effect = kind()
        table = effect.parameters
    except InputError:
        raise
    except BaseException as fault:
        raise InputError(f"the effect cannot be made: {type(fault).__name__}: {fault}", where=where) from fault
    if not effect.key or not hasattr(effect, "stage") or not table or "apply" not in vars(kind):
        raise InputError("an effect has a key, a stage, parameters and apply", where=where, value=kind.__name__)
    if not isinstance(effect.key, str) or effect.key in EFFECTS:
        said = "an effect's key is a name that no effect of the catalogue has"
        raise InputError(said, where=where, value=effect.key, remedy="Choose another name, in quotes.")
    return effect
