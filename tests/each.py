"""A property of many cases as one test: every case runs, and all that fail are reported together."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import Any

import pytest

LONGEST = 200  # characters of a case in the report


def each(names: str, cases: Iterable[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test for each case, as `pytest.mark.parametrize` does, within one item.

    A case has an empty folder as `tmp_path`, a `monkeypatch` of its own, and nothing captured by `capsys`.
    """
    keys = [name.strip() for name in names.split(",")]
    rows = [case if len(keys) > 1 else (case,) for case in cases]
    values = [dict(zip(keys, row, strict=True)) for row in rows]

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @wraps(test)
        def run(**given: Any) -> None:
            failed: list[BaseException] = []
            for number, case in enumerate(values):
                with pytest.MonkeyPatch.context() as patch:
                    try:
                        test(**case, **_fresh(given, number, patch))
                    except (Exception, pytest.fail.Exception) as error:
                        told = ", ".join(f"{key}={value!r}"[:LONGEST] for key, value in case.items())
                        error.add_note(f"case {number}: {told}")
                        failed.append(error)
            if failed:
                raise BaseExceptionGroup(f"{len(failed)} of {len(values)} cases", failed)

        signature = inspect.signature(test)
        fixtures = [one for one in signature.parameters.values() if one.name not in keys]
        run.__signature__ = signature.replace(parameters=fixtures)  # type: ignore[attr-defined]
        return run

    return decorate


def _fresh(given: dict[str, Any], number: int, patch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The fixtures of one case."""
    own = dict(given)
    if "tmp_path" in own:
        folder: Path = own["tmp_path"] / f"case{number}"
        folder.mkdir()
        own["tmp_path"] = folder
    if "monkeypatch" in own:
        own["monkeypatch"] = patch
    if "capsys" in own:
        own["capsys"].readouterr()
    return own
