"""Which cases make up the blind test: the full set, and a small one for the tests. Seeds are their numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np

from benchmarks.blind.cases import LEVELS, Case
from benchmarks.blind.world import HIDDEN

SOURCES = ("vision", "vision", "vision", "stage", "gauge")
CATALOGUED = tuple(key for key, hidden in HIDDEN.items() if hidden.catalogued)
OUTSIDE = tuple(key for key, hidden in HIDDEN.items() if not hidden.catalogued)
SURE = ("depth_zero", "force_bias", "clock_offset", "tilt", "lateral_boundary", "thickness_wedge", "adhesion",
        "viscoelasticity", "recovery", "mullins", "ageing", "temperature", "stiffening")  # fmt: skip


def full_set(repeats: int = 4, first_seed: int = 1) -> tuple[Case, ...]:
    """Rich design: none, each effect, pairs, outside the catalogue. Then other designs, levels, noises and the
    FE gel.
    """
    rng = np.random.default_rng(first_seed)
    drawn = [*_rich(repeats, rng), *_others(repeats, rng)]
    return _numbered(drawn, first_seed)


def small_set(first_seed: int = 1) -> tuple[Case, ...]:
    """A few seeds of what matters most: nothing, plain effects, a pair and one outside the catalogue."""
    drawn = [
        Case(0),
        Case(0),
        *(Case(0, hidden=(key,)) for key in ("depth_zero", "mullins", "clock_offset")),
        Case(0, hidden=("temperature", "lateral_boundary")),
        Case(0, hidden=("screw_error",)),
    ]
    return _numbered(drawn, first_seed)


def _rich(repeats: int, rng: np.random.Generator) -> Iterator[Case]:
    for turn in range(repeats):
        for source in SOURCES * 2:
            yield Case(0, source=source)
        for key in (*CATALOGUED, *OUTSIDE):
            yield Case(0, hidden=(key,))
        for key in OUTSIDE:  # as often again: they carry a target of their own
            yield Case(0, hidden=(key,))
        for _ in range(6 if turn else 8):
            one, two = rng.choice(SURE, 2, replace=False)
            yield Case(0, hidden=(str(one), str(two)))


def _others(repeats: int, rng: np.random.Generator) -> Iterator[Case]:
    settings = [
        Case(0, design=design, level=level)
        for design in ("plain", "medium", "rich")
        for level in LEVELS
        if (design, level) != ("rich", "one")
    ]
    settings += [Case(0, noise="ar1"), Case(0, noise="heavy"), Case(0, gel="fem")]
    for setting in settings:
        for _ in range(repeats):
            yield setting
            yield replace(setting, hidden=(str(rng.choice(SURE)),))


def _numbered(cases: list[Case], first_seed: int) -> tuple[Case, ...]:
    return tuple(replace(case, seed=seed) for case, seed in zip(cases, count(first_seed), strict=False))
