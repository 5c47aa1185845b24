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

from calibration.effects import EFFECTS, PLAIN
from calibration.model.stages import Effect, EffectBase
from tactilevision.errors import InputError, OutputError
from tactilevision.files.opening import limit
from tactilevision.files.writing import write_text

# Calls of a private effect: they end in time, and what they print goes to stderr, not between the results.
#
# The timer is the system's own (SIGALRM): it also ends a call that sleeps. It belongs to a program's main thread;
# in another thread, and on Windows, a call has no limit.

METHODS = ("parameters_on", "missing", "starts", "apply", "absent", "supposed", "freed", "richer", "in_picture")


@contextlib.contextmanager
def within_time(what: str) -> Iterator[None]:
    """Let the block run for MAX_EFFECT_SECONDS and print to stderr.

    Raises InputError, which names `what`, where it takes longer.
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
    """The class of a private effect, each of its own METHODS within the time."""
    own = {name: _limited(method, kind.__name__) for name in METHODS if (method := vars(kind).get(name))}
    return type(kind.__name__, (kind,), own)


def _limited(method: Callable[..., Any], of: str) -> Callable[..., Any]:
    @functools.wraps(method)
    def call(*given: Any, **named: Any) -> Any:
        with within_time(f"{of}.{method.__name__}"):
            return method(*given, **named)

    return call


# A private effect from one Python file of the user's own, and a template to begin one from.
#
# The file is run as any script of the user's would be: only a path that the user names is ever loaded.

TEMPLATE = Path(__file__).parent / "template.txt"


def load_effect(path: Path | str) -> Effect:
    """The one Effect that the file defines: a subclass of EffectBase that can be made without arguments.

    Raises InputError where the file cannot be run, or defines none or several, or leaves a part out.
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
    except (Exception, SystemExit) as fault:  # anything may happen in somebody else's file
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
    """An instance, once its declarations are whole."""
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
    if not isinstance(effect.key, str) or effect.key in {*EFFECTS, *PLAIN}:
        raise InputError(
            "an effect's key is a name that no effect of the catalogue has",
            where=where,
            value=effect.key,
            remedy="Give it a name of its own, in quotes.",
        )
    if not isinstance(effect, Effect):
        raise InputError("the effect does not keep the protocol", where=where, value=kind.__name__)
    return effect


def new_effect(path: Path | str, key: str) -> None:
    """Write a template of a private effect.

    Raises InputError for a key that is no name in Python or one of the catalogue's, OutputError where the file
    exists.
    """
    if not key.isidentifier() or keyword.iskeyword(key) or key in {*EFFECTS, *PLAIN}:
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
