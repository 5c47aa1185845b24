"""Units stated by the names of columns and keys (`fz_mN`, `depth (um)`), and factors to those of the format."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from fractions import Fraction
from typing import Any

_SIZES = {  # quantity: its units, each with its size in one of them
    "length": {
        **{"nm": "1e-9", "um": "1e-6", "mm": "1e-3", "cm": "1e-2", "m": "1"},
        **{"mil": "25.4e-6", "inch": ".0254"},
    },
    "time": {"ns": "1e-9", "us": "1e-6", "ms": "1e-3", "s": "1", "min": "60", "h": "3600"},
    "force": {
        **{"uN": "1e-6", "mN": "1e-3", "N": "1", "kN": "1e3"},
        **{"gf": ".00980665", "g": ".00980665", "kgf": "9.80665", "kg": "9.80665", "lbf": "4.4482216152605"},
    },
    "torque": {"uNm": "1e-6", "mNm": "1e-3", "Nmm": "1e-3", "Ncm": "1e-2", "Nm": "1"},
    "pressure": {"Pa": "1", "kPa": "1e3", "MPa": "1e6", "GPa": "1e9", "bar": "1e5", "psi": "6894.757293168"},
    "angle": {"deg": "1", "rad": "57.29577951308232", "mrad": ".05729577951308232"},
    "frequency": {"Hz": "1", "kHz": "1e3"},
    "temperature": {"C": "1"},
}
_PARTS: dict[str, dict[str, Fraction]] = {
    quantity: {unit: Fraction(size) for unit, size in sizes.items()} for quantity, sizes in _SIZES.items()
}
UNITS = _PARTS | {
    "speed": {f"{a}_{b}": x / y for a, x in _PARTS["length"].items() for b, y in _PARTS["time"].items()},
    "scale": {f"{unit}_per_px": size for unit, size in _PARTS["length"].items()},
}
_QUANTITY = {unit: quantity for quantity, sizes in UNITS.items() for unit in sizes}
_SPELT = {  # other spellings of units
    **{"sec": "s", "second": "s", "seconds": "s", "msec": "ms", "usec": "us", "degC": "C", "degrees": "deg"},
    **{"micron": "um", "microns": "um", "newton": "N", "newtons": "N", "lb": "lbf", "N_mm": "Nmm", "N_m": "Nm"},
}
BRACKETS = re.compile(r"\s*(.*?)[\s_,]*[\[(](.*)[\])]\s*")


def _unit(text: str) -> str:
    """Return a unit as `UNITS` spells it: mm/s as mm_s, N·m as Nm, µm as um."""
    plain = re.sub(r"[\s·⋅*.^]", "", text).replace("µ", "u").replace("μ", "u").replace("°", "deg")
    plain = plain.replace("/", "_")
    return _SPELT.get(plain, plain)


def _splits(name: str) -> Iterator[tuple[str, str]]:
    """Yield what a name may say: the quantity's name in small letters, and its unit, the longest first."""
    bracketed = BRACKETS.fullmatch(name)
    parts = re.split(r"[\s,_]+", name)
    pairs = (("_".join(parts[:k]), "_".join(parts[k:])) for k in range(len(parts)))
    for stem, unit in [bracketed.groups()] if bracketed else pairs:
        yield re.sub(r"\W+", "_", stem.casefold()).strip("_"), _unit(unit)


def _stated(name: str) -> tuple[str, str]:
    """Return the quantity's name and the unit of a name of the format; ("", "") of one without a unit."""
    return next(((stem, unit) for stem, unit in _splits(name) if unit in _QUANTITY), ("", ""))


def _matches(name: str, known: Iterable[str]) -> Iterator[tuple[str, str, str]]:
    """Yield each `known` name of a quantity that `name` may state, its unit, and that of the known one."""
    stated = [(other, *_stated(other)) for other in known]
    for stem, unit in _splits(name):
        yield from ((other, unit, own) for other, known_stem, own in stated if own and stem == known_stem)


def same_quantity(name: str, known: Iterable[str]) -> tuple[str, Fraction] | None:
    """Return which of the `known` names states this quantity in its own unit, and the factor to that unit."""
    for other, unit, own in _matches(name, known):
        sizes = UNITS[_QUANTITY[own]]
        if unit in sizes:
            return other, sizes[unit] / sizes[own]
    return None


def with_own_unit(name: str, known: str) -> str:
    """Return how `name`, a slip of `known`, is spelt in the unit that it states; `known` if it states none."""
    stem, own = _stated(known)
    sizes = UNITS.get(_QUANTITY.get(own, ""), {})
    return next((f"{stem}_{unit}" for _, unit in _splits(name) if stem and unit in sizes), known)


def fault_of_unit(name: str, known: Iterable[str]) -> str:
    """Return a sentence if a name states one of the `known` quantities in no known unit of it, else ""."""
    for _, unit, own in _matches(name, known):
        if unit:
            units = ", ".join(UNITS[_QUANTITY[own]])
            return f"{name}: {unit} is no known unit of {_QUANTITY[own]}; known are {units}"
    return ""


def scaled(value: Any, factor: Fraction) -> Any:
    """Return a number, or an array (N,), of any unit, times a factor, rounded once where one part of it is 1."""
    return value * float(factor.numerator) / float(factor.denominator)
