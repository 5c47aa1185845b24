"""What tests look for in the sources of the packages."""

from __future__ import annotations

import ast
from collections.abc import Iterator


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Statements at any depth: those of a file are a tenth of its nodes."""
    for one in ast.iter_child_nodes(node):
        if not isinstance(one, ast.expr):
            yield one
            yield from statements(one)
