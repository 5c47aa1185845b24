"""Several sets of measurements on one gel as one."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import accumulate
from typing import Any

import numpy as np

from calibration.inputs.observations import Observations, Presses
from tactilevision.records import Floats

OF_SAMPLES = ("time_s", "depth_mm", "force_N", "phase", "temperature_C", "depth_std_mm", "force_std_N")


def join(*sets: Observations) -> Observations:
    """The presses of these sets in turn, indenters and order renumbered; what a picture read is left out."""
    indenters = tuple(indenter for one in sets for indenter in one.indenters)
    first_indenter = accumulate((len(one.indenters) for one in sets), initial=0)
    first_press = accumulate((one.count for one in sets), initial=0)

    def whole(name: str) -> Floats:
        return np.concatenate([getattr(one.presses, name) for one in sets])

    kept: dict[str, Any] = {
        f.name: whole(f.name) for f in fields(Presses) if f.name not in ("label", "indenter", "order")
    }
    presses = Presses(
        label=tuple(label for one in sets for label in one.presses.label),
        indenter=np.concatenate([one.presses.indenter + k for one, k in zip(sets, first_indenter, strict=False)]),
        order=np.arange(float(sum(one.count for one in sets))),
        **kept,
    )
    press = np.concatenate([one.press + k for one, k in zip(sets, first_press, strict=False)])
    samples: dict[str, Any] = {name: np.concatenate([getattr(one, name) for one in sets]) for name in OF_SAMPLES}
    return replace(
        sets[0], indenters=indenters, presses=presses, press=press,
        reconstructed_mm=None, reconstructed_std_mm=None, falls=(), slopes=None, **samples,
    )  # fmt: skip
