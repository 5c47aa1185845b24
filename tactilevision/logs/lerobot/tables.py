"""Parquet through the door: regular files, bounded, read in parts; what is damaged is told in a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tactilevision.door.limits import check
from tactilevision.door.names import inside
from tactilevision.door.opening import check_regular
from tactilevision.errors import InputError, TactilevisionError
from tactilevision.logs.library import library

ROWS = 64  # of a part: some tens of MB with depth maps of a whole picture


def place_in(root: Path, name: str) -> Path:
    """A file of the data set. Raises InputError where it is missing, leads elsewhere, or is no file."""
    path = inside(root, name, where=root)
    if not path.exists():
        raise InputError("the data set lacks a file", where=root, value=name, remedy="Download it whole.")
    check_regular(path)
    return path


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A Parquet file of pyarrow. Raises InputError where it is damaged, now or while it is read."""
    with told(path), library("pyarrow.parquet").ParquetFile(path) as file:
        check(file.metadata.num_columns, "MAX_COLUMNS", what="the number of its columns", where=path)
        yield file


def parts(path: Path, columns: Sequence[str] | None = None) -> Iterator[Any]:
    """Its rows in record batches; `columns` None: all. Raises InputError where one is missing or damaged."""
    with opened(path) as file:
        has = file.schema_arrow.names
        missing = [name for name in columns or () if name not in has]
        if missing:
            raise InputError("a column is missing", where=path, value=missing[0])
        for batch in file.iter_batches(batch_size=ROWS, columns=columns, use_threads=False):
            check(batch.nbytes / 1e6, "MAX_ARRAY_MB", what="a part of the table, in MB,", where=path)
            yield batch


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Raise InputError where a library of Parquet or video says that a file is damaged."""
    try:
        yield
    except TactilevisionError:
        raise
    except Exception as fault:  # the libraries raise of every kind where a file is damaged
        said = " ".join(str(fault).split())[:160] or type(fault).__name__
        raise InputError(f"is damaged: {said}", where=path, remedy="Download it again.") from fault
