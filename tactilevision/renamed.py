"""Modules and names of before under their names of today, each with a DeprecationWarning; they go in version 0.2.

renamed.txt has a line for each: the old dotted name, then the new one; a package that is gone has none. An old
module is a thin one: it loads the module of today when a name of it is asked for.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

PACKAGES = ("tactilevision.", "calibration.")


@cache
def renamed() -> dict[str, str]:
    """New dotted names by old ones, of modules and of what stands in them; "" for a package that is gone."""
    lines = Path(__file__).with_name("renamed.txt").read_text(encoding="utf-8").splitlines()
    return {old: new for old, _, new in (line.partition(" ") for line in lines if line)}


def find(old_module: str, name: str) -> Any:
    """What an old module's name is today, with a warning that says so. Raises AttributeError where it is gone."""
    new = renamed().get(f"{old_module}.{name}") or f"{renamed().get(old_module, '')}.{name}"
    module, _, attribute = new.rpartition(".")
    if not module or name.startswith("__"):
        raise AttributeError(f"module {old_module!r} has no attribute {name!r}")
    found = getattr(import_module(module), attribute)
    warnings.warn(f"{old_module}.{name} is now {new}; the old name goes in 0.2", DeprecationWarning, stacklevel=3)
    return found


def names_of(old_module: str) -> Callable[[str], Any]:
    """The `__getattr__` of an old module, or of a package that stands in its place."""
    return lambda name: find(old_module, name)


class _OldModules(MetaPathFinder, Loader):
    """Asked last, for modules that nothing else finds."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: object = None) -> ModuleSpec | None:
        """An old module, as a package where other old modules lie in it."""
        if not fullname.startswith(PACKAGES) or fullname not in renamed():
            return None
        holds = any(old.startswith(f"{fullname}.") and old in renamed() for old in renamed())
        return ModuleSpec(fullname, self, origin="renamed", is_package=holds)

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """A plain one."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """It holds nothing: each name is looked up."""
        module.__getattr__ = names_of(module.__name__)  # type: ignore[method-assign]


def install() -> None:
    """Let old names be imported; once, however often it is called."""
    if not any(isinstance(finder, _OldModules) for finder in sys.meta_path):
        sys.meta_path.append(_OldModules())


class PublicPackage(ModuleType):
    """A package whose public names stay what they are when an old module of the same name is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        """Importing a submodule sets it on its package: not over a public name."""
        if not (isinstance(value, ModuleType) and name in self.__dict__.get("__all__", ())):
            super().__setattr__(name, value)
