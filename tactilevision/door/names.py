"""Names that stand in files: none leads out of its folder, by "..", an absolute path or a link."""

from __future__ import annotations

import os
import re
from pathlib import Path

from tactilevision.errors import InputError

MAX_NAME = 255  # bytes of a file's name; file systems take no more
_OUTWARD = re.compile(r"^[/\\~]|^[A-Za-z]:|(^|[/\\])\.\.([/\\]|$)")
# controls but the tab, line breaks, what turns the direction of text; Python has undecodable bytes as the last
_UNPLAIN = re.compile(r"[\x00-\x08\x0a-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def is_plain(text: str) -> bool:
    """Whether a table or a message can hold it: no line break, no escape, no NUL, and UTF-8."""
    return _UNPLAIN.search(text) is None


def as_plain(text: str) -> str:
    """The same lines with every other unplain letter spelt out (\\x1b), so that it steers no terminal."""
    return "\n".join(_UNPLAIN.sub(lambda found: ascii(found[0])[1:-1], line) for line in text.split("\n"))


def check_plain(name: str, *, where: object) -> None:
    """Raise InputError for a file's name that is not plain."""
    if not is_plain(name):
        raise InputError(
            "a file's name holds a control character, or is not UTF-8",
            where=where,
            value=name,
            remedy="Rename it.",
        )


def inside(folder: Path, name: str, *, where: object) -> Path:
    """`folder / name`. Raises InputError where that leads out of the folder, is too long, or is not plain.

    `where` is the file that says so.
    """
    path = folder / name
    check_plain(name, where=where)
    if len(name.encode(errors="replace")) > MAX_NAME:
        raise InputError("a name is longer than a file can have", where=where, value=f"{name[:40]}...")
    if not name or _OUTWARD.search(name) or (_linked(folder, name) and not _within(path, folder)):
        raise InputError(
            "a name leads out of its folder",
            where=where,
            value=name,
            remedy=f"Name a file within {folder}; copy it there if it lies elsewhere.",
        )
    return path


def _linked(folder: Path, name: str) -> bool:
    """Whether a part of the way from the folder to the file is a link."""
    place = os.fspath(folder)
    for part in re.split(r"[/\\]", name):
        place = os.path.join(place, part)
        if os.path.islink(place):
            return True
    return False


def _within(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
