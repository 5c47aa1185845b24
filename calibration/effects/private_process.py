"""Serve the effect of one file from a process of its own.

The process that fits asks with pickles, and is answered with pickles, of which it takes RECORDS and numbers alone.
An Observations is sent once; pickles then name it, and its parts, by a number that both processes know. Floats and
arrays pass bit by bit, and numpy's handling of errors is the caller's.
"""

from __future__ import annotations

import importlib.util
import inspect
import io
import pickle
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from calibration.effects import EFFECTS
from calibration.inputs.observations import EdgeDrop, Observations, Presses, Resultants, Shared, Slopes
from calibration.model.stages import Effect, EffectBase, ManualCheck, Parameter, Prior, Stage, State
from tactilevision.errors import InputError
from tactilevision.files.child import Answer, asked, stated
from tactilevision.records.rig import Gel, Indenter

ABOUT = (*EffectBase.__annotations__, "parameters")  # what an effect states of itself
_DATA = (Gel, Indenter, Observations, Presses, Shared, EdgeDrop, Slopes, Resultants)
RECORDS = {kind.__name__ for kind in (*_DATA, State, Stage, Parameter, Prior, ManualCheck)}
_NUMBERS = (np.ndarray, np.generic)  # which hold numbers, or anything
_NUMPY = ("_frombuffer", "_reconstruct", "dtype", "ndarray", "scalar")  # what pickles of arrays and numbers call
_PARTS = ("", *(field.name for field in fields(Observations)))  # "": the whole


class Shelf:
    """Observations that both processes keep under the same numbers, and pickles that name them."""

    def __init__(self) -> None:
        self.kept: dict[int, Observations] = {}
        self.names: dict[int, tuple[int, str]] = {}  # number and part, by the id of an object

    def keep(self, number: int, data: Observations) -> None:
        """Keep Observations, in the order in which the other process does."""
        self.kept[number] = data
        self.names = {id(self.part(k, name)): (k, name) for k in self.kept for name in _PARTS}

    def part(self, number: int, name: str) -> Any:
        """Return what a name in a pickle stands for."""
        return getattr(self.kept[number], name) if name else self.kept[number]

    def pack(self, value: Any, made: list[Effect] | None = None) -> bytes:
        """Return a pickle. In the process of the effect, `made` are the effects so far; others are added.

        Raises TypeError for an array of other things than real numbers there.
        """
        packed = io.BytesIO()
        _Packer(packed, self, made).dump(value)
        return packed.getvalue()

    def unpack(self, packed: bytes, make: Callable[..., Effect] | None = None) -> Any:
        """Return the value of a pickle of `pack`; `make` returns an effect of its number, kind and statements.

        With `make`, raises TypeError for other things than RECORDS, arrays and plain values.
        """
        return _Unpacker(io.BytesIO(packed), self, make).load()


class _Packer(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shelf: Shelf, made: list[Effect] | None) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.names, self.made = shelf.names, made

    def persistent_id(self, value: Any) -> tuple[Any, ...] | None:
        if (name := self.names.get(id(value))) is not None or self.made is None:
            return name
        if isinstance(value, _NUMBERS) and value.dtype.kind not in "biuf":
            raise TypeError(f"an effect returns real numbers, not {value.dtype}")
        if not isinstance(value, EffectBase):
            return None
        number = next((k for k, one in enumerate(self.made) if one is value), len(self.made))
        self.made.extend([value] * (number == len(self.made)))
        return number, type(value).__name__, {name: getattr(value, name) for name in ABOUT if hasattr(value, name)}


class _Unpacker(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shelf: Shelf, make: Callable[..., Effect] | None) -> None:
        super().__init__(file)
        self.shelf, self.make = shelf, make

    def persistent_load(self, name: Any) -> Any:
        return self.shelf.part(*name) if self.make is None or len(name) == 2 else self.make(*name)

    def find_class(self, module: str, name: str) -> Any:
        known = name in _NUMPY if module.startswith("numpy") else name in RECORDS
        if self.make is not None and not known:
            raise TypeError(f"an effect cannot return {name}")
        return super().find_class(module, name)


# The process.


def calls(path: str) -> Iterator[Answer]:
    """Yield answers to calls: "found" and the value, or the error; before them one that the process has started.

    A call has a number (None: keep an Observations) and what is given. Effect 0 is the file's, once it is loaded.
    """
    shelf, made = Shelf(), list[Effect]()
    yield ("ready",)
    for packed in asked():
        number, method, given, errors = shelf.unpack(packed)
        if number is None:
            shelf.keep(*given)
            for part in (shelf.part(given[0], name) for name in _PARTS):
                if isinstance(part, np.ndarray):
                    part.setflags(write=False)
            continue
        try:
            np.seterr(**errors)
            found = getattr(made[number], method)(*given) if method else _load(Path(path))
            answer: Answer = "found", shelf.pack(found, made)
        except InputError as fault:
            answer = stated(fault)
        except BaseException as fault:  # the effect may raise anything
            answer = type(fault).__name__, str(fault)
        yield answer


def _load(file: Path) -> Effect:
    """Run a file, and return its effect. Raises InputError where it fails, or what it states is not complete."""
    spec = importlib.util.spec_from_file_location(f"private_effect_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        kinds = [kind for _, kind in inspect.getmembers(module, inspect.isclass) if kind.__module__ == spec.name]
        own = [kind for kind in kinds if issubclass(kind, EffectBase)]
        made = [kind() for kind in own if len(own) == 1]
        complete = [
            one.key and hasattr(one, "stage") and one.parameters and "apply" in vars(own[0]) for one in made
        ]
    except InputError:
        raise
    except BaseException as fault:  # the file may raise anything
        raise InputError(f"the effect's file fails: {type(fault).__name__}: {fault}", where=file) from fault
    names = [kind.__name__ for kind in own]
    if len(own) != 1:
        remedy = "`tactilevision new-effect` writes one to begin from."
        raise InputError(
            "an effect's file defines one subclass of EffectBase", where=file, value=names, remedy=remedy
        )
    if not all(complete):
        raise InputError("an effect has a key, a stage, parameters and apply", where=file, value=names[0])
    if not isinstance(made[0].key, str) or made[0].key in EFFECTS:
        said = "an effect's key is a name that no effect of the catalogue has"
        raise InputError(said, where=file, value=made[0].key, remedy="Choose another name, in quotes.")
    return made[0]
