"""The record, digest.json: one value a line, a table for each case, and the tolerances with their reasons."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from benchmarks.digest.compare import TOLERANCES
from benchmarks.digest.values import Value, Values
from benchmarks.digest.workspace import ROOT

RECORD = ROOT / "tests" / "digest.json"


def read_record(path: Path = RECORD) -> dict[str, Values]:
    """The recorded values of every case."""
    cases: dict[str, Values] = json.loads(path.read_text(encoding="utf-8"))["cases"]
    return cases


def write_record(cases: Mapping[str, Values], path: Path = RECORD) -> None:
    """Write the values of every case, floats with every digit, by way of a temporary file."""
    tolerances = ",\n  ".join(json.dumps(asdict(tolerance)) for tolerance in TOLERANCES)
    tables = ",\n ".join(f"{json.dumps(name)}: {{\n  {_lines(values)}\n }}" for name, values in cases.items())
    text = f'{{\n"tolerances": [\n  {tolerances}\n ],\n"cases": {{\n {tables}\n }}\n}}\n'
    json.loads(text)
    with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
        file.write(text)
    Path(file.name).chmod(0o644)
    Path(file.name).replace(path)


def _lines(values: Values) -> str:
    return ",\n  ".join(f"{json.dumps(name)}: {_compact(value)}" for name, value in values.items())


def _compact(value: Value) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
