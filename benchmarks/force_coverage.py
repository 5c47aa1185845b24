"""Wrenches of random contacts against planted ones: bias, and coverage of each component's standard deviation.

python -m benchmarks.force_coverage [contacts] [seed]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from benchmarks.force_cases import KINDS, SLIPPING, Forward, View, draw_case, seen
from tactilevision.force.field import NO_CONTACT, ForceField, ForceSettings
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

VIEW = View((120, 160), 0.171, 2)
GEL, MATERIAL = Gel(3.0), Material(0.2, 0.48)
EVERY = (*KINDS, SLIPPING)
LINEAR = ForceSettings(large_depth=False, cell_std=False)  # the planted gel is linear
NOISE = [
    (std_um, alike_mm) for std_um in (5, 20) for alike_mm in (0.0, 1.5)
]  # um; correlation length in mm, 0: white
NAMES = ("fx", "fy", "fz", "mx", "my", "mz")


def planted(seed: int, number: int, forward: Forward) -> tuple[Floats, Floats]:
    """Displacement (3, H, W) of a random contact, and its wrench (6,) about the pad's centre, N and N mm."""
    traction = draw_case(EVERY[number % len(EVERY)], VIEW, np.random.default_rng([seed, number]))
    x, y = VIEW.mesh()
    fx, fy, fz = traction * (VIEW.mm_per_px / VIEW.fine) ** 2
    moment = (y * fz).sum(), -(x * fz).sum(), (x * fy - y * fx).sum()
    return forward(traction), np.array([fx.sum(), fy.sum(), fz.sum(), *moment])


def read(field: ForceField, u: Floats, true: Floats, *, std_um: float, alike_mm: float, seed: int) -> Floats:
    """Error (6,) and standard deviation (6,) of the wrench; NaN where no contact is seen."""
    rng = np.random.default_rng([seed, round(10 * alike_mm), round(1e3 * std_um)])
    found = field(*seen(u, VIEW, std_mm=1e-3 * std_um, rng=rng, correlation_mm=alike_mm))
    if NO_CONTACT in found.flags:
        return np.full(12, np.nan)
    wrench = found.wrench
    return np.concatenate(
        [np.array([*wrench.force_N, *wrench.moment_Nmm]) - true, [*wrench.force_std_N, *wrench.moment_std_Nmm]]
    )


def coverage(contacts: int, *, seed: int) -> tuple[Floats, Floats]:
    """Rows (noises, contacts, 12) as `read`, and the true wrenches (contacts, 6)."""
    forward = Forward(VIEW, GEL, MATERIAL)
    field = ForceField(GEL, MATERIAL, (VIEW.mm_per_px,) * 2, view_px=VIEW.shape, settings=LINEAR)
    rows, truths = np.empty((len(NOISE), contacts, 12)), np.empty((contacts, 6))
    for number in range(contacts):
        u, truths[number] = planted(seed, number, forward)
        for at, (std_um, alike_mm) in enumerate(NOISE):
            rows[at, number] = read(
                field, u, truths[number], std_um=std_um, alike_mm=alike_mm, seed=seed + 1000 * number
            )
    return rows, truths


def report(rows: Floats, truths: Floats) -> None:
    """Print the table."""
    kinds = np.arange(len(truths)) % len(EVERY)
    for (std_um, alike_mm), part in zip(NOISE, rows, strict=True):
        known = np.isfinite(part[:, 2])
        score, bias = np.abs(part[:, :6] / part[:, 6:])[known], 100 * part[:, 2] / truths[:, 2]
        kind = "white" if alike_mm == 0 else f"alike over {alike_mm:g} mm"
        by_kind = [f"{np.nanmean(bias[kinds == k]):+.1f}" for k in range(len(EVERY))]
        print(
            f"{std_um} um, {kind}: {known.sum()} of {len(part)} seen; fz {np.nanmean(bias):+.2f} % (mean), ",
            end="",
        )
        print(f"{np.nanmedian(bias):+.2f} % (median), by kind {' '.join(by_kind)}")
        for least in (1, 2):
            inside = [
                f"{name} {100 * share:.0f}" for name, share in zip(NAMES, (score < least).mean(0), strict=True)
            ]
            print(f"    within {least} std, %: {', '.join(inside)}", flush=True)


def main(arguments: Sequence[str]) -> None:
    """Print everything."""
    contacts, seed = (int(one) for one in [*arguments, 500, 77][:2]) if len(arguments) < 2 else map(int, arguments)
    report(*coverage(contacts, seed=seed))


def quick() -> None:
    report(*coverage(5, seed=77))


if __name__ == "__main__":
    main(sys.argv[1:])
