"""Made-up measurements for the tests of fitting: depth and force written out by hand, with known truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.inputs.observations import Observations, Presses
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Gel, Indenter

NAN = float("nan")
GEL = Gel(thickness_mm=3.0, shape="disc", radius_mm=15.0, poisson_ratio=0.48, poisson_ratio_std=0.002)


def indenter(name: str = "A", radius_mm: float = 2.5, height_std_mm: float = 0.0) -> Indenter:
    return Indenter(name, radius_mm=radius_mm, height_std_mm=height_std_mm)


def observations(
    depth_mm: Sequence[Floats],
    indenters: Sequence[Indenter],
    *,
    time_s: Sequence[Floats] | None = None,
    gel: Gel = GEL,
    place_mm: Sequence[tuple[float, float]] | None = None,
    phase: Sequence[Sequence[str]] | None = None,
) -> Observations:
    """One entry a press: its depths and its indenter. Forces are zero; noise is not stated."""
    kinds = tuple(dict.fromkeys(indenters))
    count, sizes = len(depth_mm), [d.size for d in depth_mm]
    size = sum(sizes)
    if time_s is None:
        time_s = [100.0 * k + np.arange(float(n)) for k, n in enumerate(sizes)]
    x, y = zip(*(place_mm or [(0.0, 0.0)] * count), strict=True)
    nothing = np.full(count, NAN)
    speed = [
        np.median(np.diff(d) / np.diff(t)) if d.size > 1 else NAN for d, t in zip(depth_mm, time_s, strict=True)
    ]
    gap = [NAN] + [time_s[k][0] - time_s[k - 1][-1] for k in range(1, count)]
    presses = Presses(
        label=tuple(f"p{k}" for k in range(count)),
        recording=np.zeros(count, dtype=np.int64),
        indenter=np.array([kinds.index(i) for i in indenters]),
        radius_mm=np.array([i.radius_mm for i in indenters]),
        x_mm=np.array(x),
        y_mm=np.array(y),
        rest_s=np.array(gap),
        speed_mm_s=np.array(speed),
        hold_s=nothing,
        temperature_C=nothing,
        lubricated=nothing,
        day=np.array([t[0] / 86400 for t in time_s]),
        order=np.arange(float(count)),
    )
    return Observations(
        gel=gel,
        indenters=kinds,
        presses=presses,
        press=np.repeat(np.arange(count), sizes),
        time_s=np.concatenate(time_s),
        depth_mm=np.concatenate(depth_mm),
        force_N=np.zeros((size, 3)),
        phase=np.concatenate(phase) if phase else np.full(size, "load"),
        temperature_C=np.full(size, NAN),
        depth_std_mm=np.full(size, NAN),
        force_std_N=np.full(size, NAN),
    )
