"""Mutants of a valid file: some keep its form and change what it says, others change its bytes."""

from __future__ import annotations

from hypothesis import strategies as st

from benchmarks.fuzz.binary_mutants import archives, arrays, depths, fields, pictures
from benchmarks.fuzz.readers import Form
from benchmarks.fuzz.text_mutants import documents, tables


def mutants(form: Form, data: bytes) -> st.SearchStrategy[bytes]:
    """Files of this form that say something else than `data`; a few are `data` with other bytes."""
    made = {
        "table": tables,
        "toml": documents,
        "json": documents,
        "npy": arrays,
        "npz": archives,
        "tiff": depths,
        "picture": pictures,
        "bytes": fields,
    }[form]
    return made(form, data) if form in ("toml", "json", "picture") else made(data)  # type: ignore[operator,no-any-return]
