"""Force that a map without contact hides: punches and balls pressed until they are seen, against the stated limit.

Rigid, frictionless contacts on the layer of benchmarks.layer_truth. Of each the deepest press that is still unseen
counts, and one of random depth below it.

python -m benchmarks.force_unseen [contacts] [seed]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from scipy import fft

from benchmarks.force_cases import Forward, noise
from benchmarks.force_coverage import GEL, LINEAR, MATERIAL, NOISE, VIEW
from tactilevision.force.field import ForceField
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Bools, Floats

RADII, STEPS, DEEPEST_MM = 14, 12, 0.4  # radii of a run; bisections; a depth that is always seen
STEP = VIEW.mm_per_px / VIEW.fine


class Pressed:
    """Depth (H', W') about the middle of a plane and force, N/mm, of contacts of unit depth."""

    def __init__(self, forward: Forward) -> None:
        self.kernel, self.count = forward.compliance[..., 2, 2].real, forward.count
        y, x = (STEP * (np.arange(n) - n // 2) for n in self.count)
        self.r = np.hypot(*np.meshgrid(x, y))

    def punch(self, radius_mm: float) -> tuple[Floats, float]:
        """Return them for a flat punch."""
        pressure = self._solved(np.ones(self.r.shape), self.r <= radius_mm)
        return self._moved(pressure), float(pressure.sum() * STEP**2)

    def ball(self, radius_mm: float) -> tuple[Floats, float]:
        """Return them for a ball of this contact radius: no pressure at its edge."""
        inside = self.r <= radius_mm
        punch, bowl = (self._solved(shape, inside) for shape in (np.ones(self.r.shape), self.r**2))
        edge = inside & (self.r > radius_mm - STEP)
        pressure = np.maximum(bowl[edge].sum() / punch[edge].sum() * punch - bowl, 0.0)
        moved = self._moved(pressure)
        return moved / moved.max(), float(pressure.sum() * STEP**2 / moved.max())

    def _moved(self, pressure: Floats) -> Floats:
        return np.asarray(fft.irfft2(self.kernel * fft.rfft2(pressure), self.count))

    def _solved(self, depth: Floats, inside: Bools) -> Floats:
        """Return the pressure `inside` that makes this depth there, by conjugate gradients."""
        pressure, left = np.zeros(depth.shape), np.where(inside, depth, 0.0)
        along, size = left.copy(), float((left**2).sum())
        first = size
        while size > 1e-10 * first:
            moved = np.where(inside, self._moved(along), 0.0)
            step = size / float((along * moved).sum())
            pressure += step * along
            left -= step * moved
            size, before = float((left**2).sum()), size
            along = left + size / before * along
        return pressure


def placed(depth: Floats, radius_mm: float, rng: np.random.Generator) -> Floats:
    """Return the depth (H, W) of the pixels with the contact anywhere in the view."""
    rows, columns = (n * VIEW.fine for n in VIEW.shape)
    reach = int((radius_mm + 1) / STEP)
    row, column = (int(rng.integers(reach, n - reach)) for n in (rows, columns))
    top, left = depth.shape[0] // 2 - row, depth.shape[1] // 2 - column
    whole = np.roll(depth, (-top, -left), axis=(0, 1))[:rows, :columns]
    return np.asarray(whole.reshape(VIEW.shape[0], VIEW.fine, VIEW.shape[1], VIEW.fine).mean(axis=(1, 3)))


def hidden(field: ForceField, unit: Floats, off: Floats, std_mm: float, share: float) -> tuple[float, Floats]:
    """Return the greatest unseen depth, mm, and the limits, N, there and at a share of it."""

    def seen(depth_mm: float) -> HeightMap:
        everywhere = np.ones(VIEW.shape, dtype=bool)
        std = np.full(VIEW.shape, std_mm)
        return HeightMap(depth_mm * unit + off, everywhere, (VIEW.mm_per_px,) * 2, std_mm=std)

    low, high = 0.0, DEEPEST_MM
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if field.free(seen(middle)) is None else (middle, high)
    return low, np.array([field(seen(part * low)).could_hide_N for part in (1.0, share)])


def unseen(contacts: int, *, seed: int) -> Floats:
    """Rows (noises, contacts, 4): hidden force and limit at the greatest unseen depth, and at a random one."""
    rng, pressed = np.random.default_rng(seed), Pressed(Forward(VIEW, GEL, MATERIAL))
    field = ForceField(GEL, MATERIAL, (VIEW.mm_per_px,) * 2, view_px=VIEW.shape, settings=LINEAR)
    radii = np.exp(rng.uniform(np.log(0.5), np.log(GEL.thickness_mm), RADII))
    shapes = [(a, *made(a)) for a in radii for made in (pressed.punch, pressed.ball)]
    rows = np.empty((len(NOISE), contacts, 4))
    for number in range(contacts):
        radius, depth, force = shapes[rng.integers(len(shapes))]
        unit = placed(depth, radius, rng)
        for at, (std_um, alike_mm) in enumerate(NOISE):
            off = noise(VIEW, std_mm=1e-3 * std_um, rng=rng, correlation_mm=alike_mm)[2]
            share = float(rng.uniform())
            deepest, limits = hidden(field, unit, off, 1e-3 * std_um, share)
            rows[at, number] = force * deepest, limits[0], share * force * deepest, limits[1]
    return rows


def report(rows: Floats) -> None:
    """Print the table."""
    for (std_um, alike_mm), part in zip(NOISE, rows, strict=True):
        most, limit, less, other = part.T
        known = most > 0
        ratio = limit[known] / most[known]
        kind = "white" if alike_mm == 0 else f"alike over {alike_mm:g} mm"
        print(
            f"{std_um} um, {kind}: deepest unseen {np.median(most):.4f} N (median), {most.max():.4f} at most; ",
            end="",
        )
        print(
            f"limit holds in {100 * np.mean(limit >= most):.1f} %, {np.median(ratio):.2f} times the force (median)"
        )
        print(f"    any depth below: holds in {100 * np.mean(other >= less):.1f} %", flush=True)


def main(arguments: Sequence[str]) -> None:
    """Print everything."""
    contacts, seed = map(int, [*arguments, "500", "78"][:2]) if len(arguments) != 1 else (int(arguments[0]), 78)
    report(unseen(contacts, seed=seed))


def quick() -> None:
    report(unseen(2, seed=78))


if __name__ == "__main__":
    main(sys.argv[1:])
