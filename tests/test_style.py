"""Rules of style that can be measured: length of functions, judgements with a meaning, shapes in docstrings."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from sources import statements

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for package in ("tactilevision", "calibration") for path in (ROOT / package).rglob("*.py"))
LONGEST_FUNCTION = 60  # lines of code: a step is read whole on one screen
LONGEST_FILE = 600  # lines: a chapter
TABLES = 60  # statements laid out by hand; the formatter lays out all else

Function = ast.FunctionDef | ast.AsyncFunctionDef
_ARRAYS = re.compile(r"\b(Floats|Bools|Ints|Array|Planes|Picture|Singles|NDArray|HeightMap|SlopeMap)\b")
_SHAPE = re.compile(r"\((?:[\w.+*\-/ ]+,)[\w.+*\-/, ]*\)|\bscalar|\bshape|like `|of `|as `")
_UNIT = re.compile(
    r"\b(mm[\d²³]?|um|µm|N|MPa|s|Hz|px|deg|rad|degrees|grey|per|[Ss]hares?|slopes?|ratios?|relative|[Mm]ask|1"
    r"|dimensionless|(?:its|their|any) unit)\b|[%-]1"
)


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def functions() -> Iterator[tuple[Path, Function]]:
    for path in SOURCES:
        for node in statements(tree_of(path)):
            if isinstance(node, Function):
                yield path, node


def where(path: Path, node: ast.stmt) -> str:
    return f"{path.relative_to(ROOT)}:{node.lineno}"


@cache
def code_lines(path: Path) -> frozenset[int]:
    """Lines that hold code: no comment, no blank line."""
    idle = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(path.read_text()).readline):
        if token.type not in idle:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return frozenset(lines)


def size(path: Path, node: Function) -> int:
    """Lines of code of a function's body, without its docstring."""
    body = node.body[1:] if ast.get_docstring(node) is not None else node.body
    lines = code_lines(path)
    return sum(k in lines for s in body for k in range(s.lineno, (s.end_lineno or s.lineno) + 1))


def test_functions_are_short() -> None:
    spans = [one for one in functions() if (one[1].end_lineno or 0) - one[1].lineno >= LONGEST_FUNCTION]
    sizes = [(size(path, node), f"{where(path, node)} {node.name}") for path, node in spans]
    long = [one for one in sizes if one[0] > LONGEST_FUNCTION]
    assert long == []


def test_files_are_short() -> None:
    assert [str(p) for p in SOURCES if p.read_text().count("\n") > LONGEST_FILE] == []


def test_only_tables_are_laid_out_by_hand() -> None:
    files = [
        p
        for folder in ("tactilevision", "calibration", "tests", "benchmarks", "examples")
        for p in (ROOT / folder).rglob("*.py")
    ]
    assert sum(p.read_text().count("# fmt: " + "skip") for p in files) <= TABLES


def _is_number(node: ast.expr | None) -> bool:
    """Whether an expression holds a number literal and neither calls nor names anything."""
    if node is None:
        return False
    parts = list(ast.walk(node))
    literal = any(isinstance(p, ast.Constant) and type(p.value) in (int, float) for p in parts)
    return literal and not any(isinstance(p, ast.Call | ast.Dict | ast.JoinedStr) for p in parts)


def judgements() -> Iterator[tuple[Path, ast.stmt, str]]:
    """Module-level constants that are numbers: (file, statement, names)."""
    for path in SOURCES:
        for node in tree_of(path).body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or not _is_number(node.value):
                continue
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
            if names and all(re.fullmatch(r"_?[A-Z][A-Z0-9_a-z]*", name) for name in names):
                yield path, node, " ".join(names)


def test_every_judgement_says_what_it_means() -> None:
    silent, crowded = [], []
    for path, node, names in judgements():
        lines = path.read_text().split("\n")
        own = "\n".join(lines[node.lineno - 1 : node.end_lineno])
        above = lines[node.lineno - 2].strip() if node.lineno > 1 else ""
        comment = own.partition("#")[2] or (above if above.startswith("#") else "")
        if len(comment.split()) < 3:
            silent.append(f"{where(path, node)} {names}")
        if len(names.split()) > 1:
            crowded.append(f"{where(path, node)} {names}")
    assert silent == []
    assert crowded == []


def _takes_arrays(node: Function) -> bool:
    if any(isinstance(mark, ast.Name) and mark.id == "overload" for mark in node.decorator_list):
        return False  # the implementation tells
    notes = [a.annotation for a in (*node.args.args, *node.args.kwonlyargs)] + [node.returns]
    return any(note is not None and _ARRAYS.search(ast.unparse(note)) for note in notes)


def test_public_array_functions_name_shape_and_unit() -> None:
    missing = []
    for path in SOURCES:
        if {"report", "cli"} & set(path.parts):  # their Picture is a figure
            continue
        for node in tree_of(path).body:
            if not isinstance(node, Function) or node.name.startswith("_") or not _takes_arrays(node):
                continue
            told = ast.get_docstring(node) or ""
            if not (_SHAPE.search(told) and _UNIT.search(told)):
                missing.append(f"{where(path, node)} {node.name}")
    assert missing == []
