"""The limits of what a file may hold, each far beyond what a sensor gives; a user can raise them.

TACTILEVISION_MAX_PIXELS=200000000 in the environment, and likewise for each of the other names.
"""

from __future__ import annotations

import os

from tactilevision.errors import InputError

MAX_PIXELS = 50_000_000  # of one picture: 8192 x 6144
MAX_ARRAY_MB = 2_000  # unpacked, of one .npy or .npz file: a film of floating point maps
MAX_FILE_MB = 4_000  # of one picture, table or array on disk
MAX_TEXT_MB = 64  # of one TOML or JSON file; calibrations have less than one
MAX_COLUMNS = 2_000  # of a table; recordings have some tens
MAX_DEPTH = 64  # of brackets within brackets, and of the dotted parts of a key; files have less than ten
MAX_DIGITS = 300  # of one number: 1e308 is the largest that there is
MAX_NUMBER = 1_000_000_000_000  # of any number in mm, N, s, MPa or px; a time in s since 1970 has ten digits
MAX_EFFECT_SECONDS = 10  # of one call of a private effect; those of the catalogue take milliseconds
_NAMES = frozenset(name for name in globals() if name.startswith("MAX_"))


def limit(name: str) -> int:
    """A limit by its name, as the environment has it. Raises InputError where that is no number above 0."""
    stated = os.environ.get(f"TACTILEVISION_{name}")
    if stated is None:
        return int(globals()[name])
    if not stated.isdigit() or int(stated) == 0:
        raise InputError("a limit is a whole number above 0", where=f"TACTILEVISION_{name}", value=stated)
    return int(stated)


def check(found: float, name: str, *, what: str, where: object) -> None:
    """Raise InputError where what was found in a file is beyond the limit of this name."""
    most = limit(name)
    if found > most:
        raise InputError(
            f"{what} is beyond the limit of {most:,}",
            where=where,
            value=found,
            remedy=f"If it is meant, set TACTILEVISION_{name} in the environment to a larger number.",
        )
