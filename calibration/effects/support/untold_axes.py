"""Two parameters, one an axis: an axis along which nothing varies tells nothing of its own, which is then 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.model.parameters import Parameter
from tactilevision.records import Bools, Floats


def with_told(parameters: Sequence[Parameter], told: Bools) -> tuple[Parameter, ...]:
    """The parameters, held at 0 in their unit where their axis is not `told` (p,)."""
    pairs = zip(parameters, told, strict=True)
    return tuple(p if seen else replace(p, bounds=(0.0, 0.0)) for p, seen in pairs)


def told_starts(starts: Floats, told: Bools) -> Floats:
    """Those of the starts (s, p), in their unit, that leave axes alone that are not `told` (p,)."""
    return np.asarray(starts[~(starts[:, ~told] != 0).any(axis=1)])
