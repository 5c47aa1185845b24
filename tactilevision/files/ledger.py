"""Ledger of passports: one SQLite file for many sensors, replaced as a whole, and the SHA-256 of a folder."""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from tactilevision.errors import InputError, OutputError
from tactilevision.files.opening import open_regular, read_bytes
from tactilevision.files.writing import replacing

APPLICATION = 0x7AC71E  # application_id of the file, by which it is known
WORDS = ("sensor", "sha256", "date", "recording", "content")
NUMBERS = ("youngs_modulus_MPa", "poisson_ratio", "c_N_per_mm", "thickness_mm")
COLUMNS = dict.fromkeys(WORDS, "TEXT NOT NULL") | dict.fromkeys(NUMBERS, "REAL")
TABLE = f"CREATE TABLE entries ({', '.join(map(' '.join, COLUMNS.items()))}, PRIMARY KEY (sensor, sha256))"
_AGAIN = "Name another file with --ledger, or restore this one from a copy."
_CHUNK = 1 << 20  # bytes of a file that are hashed at a time


def folder_digest(folder: Path) -> tuple[str, int]:
    """Return the SHA-256 of a folder's files, and their number; names that begin with a dot are left out.

    That of the lines "HASH  ./NAME" of the files, sorted by name, as `sha256sum` prints them.
    """
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    shown = [name for name in names if not any(part.startswith(".") for part in name.split("/"))]
    whole = hashlib.sha256()
    for name in shown:
        digest = hashlib.sha256()
        with open_regular(folder / name, limit=None) as file:
            while part := file.read(_CHUNK):
                digest.update(part)
        whole.update(f"{digest.hexdigest()}  ./{name}\n".encode(errors="surrogateescape"))
    return whole.hexdigest(), len(shown)


def read_ledger(path: Path, sensor: str) -> list[Any]:
    """Return the content of a sensor's entries in order of date; none where there is no file.

    Raises InputError for a file that is no ledger.
    """
    if not path.exists():
        return []
    if not read_bytes(path).startswith(b"SQLite format 3\0"):
        raise InputError("is no ledger of passports", where=path, remedy=_AGAIN)
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path.absolute()))}?immutable=1&mode=ro", uri=True)) as base:
            _check(base, path)
            rows = base.execute("SELECT content FROM entries WHERE sensor = ? ORDER BY date, rowid", [sensor])
            found = [json.loads(content) for (content,) in rows]
    except (sqlite3.Error, ValueError) as fault:
        raise InputError(f"the ledger is damaged: {fault}", where=path, remedy=_AGAIN) from fault
    return found


def write_ledger(path: Path, entries: Sequence[Mapping[str, Any]]) -> None:
    """Add entries, or replace those of the same sensor and hash; the old file stays whole until the new one is.

    Raises InputError for a file that is no ledger, OutputError where the disk is full.
    """
    old = read_bytes(path) if path.exists() else b""
    with replacing(path) as temporary:
        temporary.write_bytes(old)
        try:
            with closing(sqlite3.connect(temporary)) as base:
                base.execute("PRAGMA journal_mode = MEMORY")  # the file is not seen before it is complete
                if old:
                    _check(base, path)
                else:
                    base.execute(f"PRAGMA application_id = {APPLICATION}")
                    base.execute(TABLE)
                marks = ", ".join("?" for _ in COLUMNS)
                base.executemany(f"INSERT OR REPLACE INTO entries VALUES ({marks})", map(_row, entries))  # noqa: S608
                base.commit()
        except sqlite3.Error as fault:
            remedy = "Free some space, or name another file with --ledger."
            raise OutputError(f"the ledger cannot be written: {fault}", where=path, remedy=remedy) from fault
        with temporary.open("rb") as file:
            os.fsync(file.fileno())


def _row(entry: Mapping[str, Any]) -> list[Any]:
    told = {name: entry["numbers"][name]["value"] for name in NUMBERS}
    return [({**entry, **told, "content": json.dumps(entry, ensure_ascii=False)})[name] for name in COLUMNS]


def _check(base: sqlite3.Connection, path: Path) -> None:
    """Raise InputError for a file with anything but our table: a view or a trigger is a program."""
    base.execute("PRAGMA trusted_schema = OFF")
    own = base.execute("PRAGMA application_id").fetchone() == (APPLICATION,)
    held = base.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL").fetchall() if own else []
    if held != [(TABLE,)]:
        raise InputError("is no ledger of passports", where=path, remedy=_AGAIN)
