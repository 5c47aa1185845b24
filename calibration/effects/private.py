"""Load a private effect from one Python file of the user, and limit the time of its calls."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import inspect
import keyword
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from calibration.effects import EFFECTS
from calibration.model.stages import Effect, EffectBase
from tactilevision.errors import InputError, OutputError
from tactilevision.files.opening import limit
from tactilevision.files.writing import write_text

METHODS = ("parameters_on", "missing", "starts", "apply", "absent", "supposed", "freed", "richer", "in_picture")


@contextlib.contextmanager
def within_time(what: str) -> Iterator[None]:
    """Limit the time of the block to MAX_EFFECT_SECONDS, and send what it prints to stderr.

    The timer is the system's (SIGALRM), so it also ends a call that sleeps; in a thread other than the main one,
    and on Windows, there is no limit. Raises InputError, which names `what`, where the block takes longer.
    """
    with contextlib.redirect_stdout(sys.stderr):
        if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
            yield
            return
        seconds = limit("MAX_EFFECT_SECONDS")

        def end(_number: int, _frame: FrameType | None) -> NoReturn:
            raise InputError(
                f"did not end within {seconds} s",
                where=what,
                remedy="Look for a loop without end. A slow effect: set TACTILEVISION_MAX_EFFECT_SECONDS.",
            )

        before = signal.signal(signal.SIGALRM, end)
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, before)


def limited(kind: type[EffectBase]) -> type[EffectBase]:
    """Return the class of a private effect with a time limit on each of its own METHODS."""
    limits = {name: _limited(method, kind.__name__) for name in METHODS if (method := vars(kind).get(name))}
    return type(kind.__name__, (kind,), limits)


def _limited(method: Callable[..., Any], of: str) -> Callable[..., Any]:
    @functools.wraps(method)
    def call(*given: Any, **named: Any) -> Any:
        with within_time(f"{of}.{method.__name__}"):
            return method(*given, **named)

    return call


TEMPLATE = Path(__file__).parent / "template.txt"


def load_effect(path: Path | str) -> Effect:
    """Load the one effect that a file defines: a subclass of EffectBase that can be made without arguments.

    The file is run like any script of the user's; only a path that the user names is loaded. Raises InputError
    where the file cannot be run, defines none or several effects, or an incomplete one.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError("there is no such file", where="--effect", value=str(file))
    spec = importlib.util.spec_from_file_location(f"private_effect_{file.stem}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        with within_time(str(file)):
            spec.loader.exec_module(module)
    except InputError:
        raise
    except (Exception, SystemExit) as fault:  # the file may raise anything
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
        with within_time(kind.__name__):
            effect = limited(kind)()
            table = effect.parameters
    except InputError:
        raise
    except Exception as fault:
        raise InputError(f"the effect cannot be made: {type(fault).__name__}: {fault}", where=where) from fault
    if not effect.key or not hasattr(effect, "stage") or not table or "apply" not in vars(kind):
        raise InputError("an effect has a key, a stage, parameters and apply", where=where, value=kind.__name__)
    if not isinstance(effect.key, str) or effect.key in EFFECTS:
        said = "an effect's key is a name that no effect of the catalogue has"
        raise InputError(said, where=where, value=effect.key, remedy="Choose another name, in quotes.")
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
