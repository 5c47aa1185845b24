"""The record, digest.json: one value a line, a table for each case, and the tolerances with their reasons.

digest_changes.toml lists the results that the latest change may move, with the reason; no other is recorded anew.
"""

from __future__ import annotations

import json
import re
import tempfile
import tomllib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from benchmarks.digest.compare import TOLERANCES, differences
from benchmarks.digest.values import Value, Values
from benchmarks.digest.workspace import ROOT

RECORD = ROOT / "tests" / "digest.json"
CHANGES = ROOT / "tests" / "digest_changes.toml"


def read_record(path: Path = RECORD) -> dict[str, Values]:
    """The recorded values of every case."""
    cases: dict[str, Values] = json.loads(path.read_text(encoding="utf-8"))["cases"]
    return cases


def read_changes(path: Path = CHANGES) -> list[re.Pattern[str]]:
    """The patterns of "CASE: NAME" that may change; each has its reason."""
    listed = tomllib.loads(path.read_text(encoding="utf-8")).get("change", [])
    assert all(one["why"] for one in listed), path
    return [re.compile(one["keys"]) for one in listed]


def changed(case: str, before: Values, after: Values, may: list[re.Pattern[str]]) -> tuple[Values, list[str]]:
    """The values to record, old where a change is not listed, and the differences that are not."""
    values: Values = {}
    refused: list[str] = []
    for name in dict.fromkeys([*before, *after]):
        old, new = ({name: given[name]} if name in given else {} for given in (before, after))
        lines = list(differences(old, new, case))
        listed = any(pattern.fullmatch(f"{case}: {name}") for pattern in may)
        refused += [] if listed else lines
        values |= new if listed or not lines else old
    return values, refused


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
