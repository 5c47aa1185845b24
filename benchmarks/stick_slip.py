"""Contacts that are pressed and then sheared until they slide, by Coulomb's law on the exact layer.

Apart from the code that is tested: the compliance is that of benchmarks.layer_truth, on points of the plane, and
each step of the load is a quadratic problem under friction cones,

    min 1/2 t A t - t (A t_old + C_tz (p_old - p) + d),    |t_i| <= mu p_i,

A the tangential compliance, d the rigid motion of the indenter in the step, solved by accelerated projected
gradients (Nesterov); pressures p >= 0 by an active set. A point that sticks moves with the indenter from where the
gel was when they met, so pressing leaves shear behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.linalg import cho_factor, cho_solve

from benchmarks.force_cases import Forward, View
from tactilevision.records.measured import Bools, Floats, Pair

Ints = npt.NDArray[np.intp]
Moved = Callable[[Floats, slice, slice], Floats]
KINDS = ("ball", "flat punch", "rounded punch")
PRESS, SHEAR = 3, 12  # steps of the load
REACH = 1.9  # of the motion at which all would slide, were the contact stuck until then
ACTIVE_ROUNDS = 15  # of the points that touch
ROUNDS, TOLERANCE = 300, 1e-4  # of the projected gradients; relative to the largest traction
STUCK = 50.0  # a friction at which nothing slips


@dataclass(frozen=True)
class Step:
    """State of a contact: tractions (3, H', W') MPa on the fine points, tangential over limiting force; `sliding`
    the share of the area that has slipped in this step; `moved_mm` of the indenter since the press."""

    traction: Floats
    share: float
    sliding: float
    moved_mm: float


@dataclass(frozen=True)
class Indenter:
    """Shape, place and motion: `radius_mm` of the contact, depth, friction, direction, rotation in rad per mm."""

    kind: str
    radius_mm: float
    depth_mm: float
    friction: float
    direction: float
    turn_per_mm: float
    centre_mm: Pair

    def relief(self, r: Floats) -> Floats:
        """Height of the face above its lowest point at r mm from the axis, to be pressed in by `depth_mm`."""
        a, w = self.radius_mm, self.depth_mm
        if self.kind == "ball":
            return np.asarray(0.55 * w * (r / a) ** 2)
        if self.kind == "rounded punch":
            return np.asarray(0.4 * w * np.clip(r / a - 0.6, 0, None) ** 2 / 0.16)
        return np.where(r <= a, 0.0, np.inf)


def draw(rng: np.random.Generator, kind: str, view: View, *, stuck: bool = False) -> Indenter:
    """A random one in view."""
    radius = rng.uniform(1.4, 3.0)
    x, y = (rng.uniform(-1, 1) * (size / 2 - radius - 2.5) for size in view.size_mm)
    turn = rng.choice([0.0, rng.uniform(-0.15, 0.15)])
    friction = STUCK if stuck else rng.uniform(0.3, 1.2)
    return Indenter(
        kind, radius, rng.uniform(0.12, 0.35), friction, rng.uniform(0, 2 * np.pi), float(turn), (x, y)
    )


class Layer:
    """Compliance between the fine points of a view, as a table of offsets."""

    def __init__(self, view: View, forward: Forward, reach_mm: float) -> None:
        self.view, self.step = view, view.mm_per_px / view.fine
        n = self.half = int(np.ceil(reach_mm / self.step)) + 1
        near = np.arange(-2 * n, 2 * n + 1)
        self.table = np.empty((3, 3, near.size, near.size))
        for i, j in np.ndindex(3, 3):
            self.table[i, j] = fft.irfft2(forward.compliance[..., i, j], forward.count)[np.ix_(near, near)]

    def points(self, one: Indenter) -> tuple[Ints, Ints, Floats, Floats]:
        """Rows and columns of the points that may touch, and x, y from the axis."""
        x, y = self.view.mesh()
        away = np.hypot(x - one.centre_mm[0], y - one.centre_mm[1])
        row, column = np.nonzero(away <= 1.25 * one.radius_mm)
        return row, column, x[row, column] - one.centre_mm[0], y[row, column] - one.centre_mm[1]

    def normal(self, row: Ints, column: Ints) -> Floats:
        """Depth by pressure (n, n)."""
        down, across = (np.subtract.outer(k, k) + 2 * self.half for k in (row, column))
        return np.asarray(self.table[2, 2, down, across])

    def product(self, row: Ints, column: Ints) -> Moved:
        """Displacement (components `to`, n) by tractions (components `of`, n), as a function of them."""
        row, column = row - row.min(), column - column.min()
        shape = [fft.next_fast_len(2 * int(k.max()) + 1, real=True) for k in (row, column)]
        reach = [slice(2 * self.half - int(k.max()), 2 * self.half + int(k.max()) + 1) for k in (row, column)]
        placed = np.zeros((3, 3, *shape))
        middle = self.table[:, :, reach[0], reach[1]]
        placed[:, :, : middle.shape[2], : middle.shape[3]] = middle
        waves = fft.rfft2(np.roll(placed, (-int(row.max()), -int(column.max())), axis=(2, 3)))

        def moved(t: Floats, of: slice, to: slice) -> Floats:
            fields = np.zeros((len(t), *shape))
            fields[:, row, column] = t
            spectrum = (waves[to, of] * fft.rfft2(fields)).sum(axis=1)
            return np.asarray(fft.irfft2(spectrum, shape)[:, row, column])

        return moved


SIDE, DOWN = slice(0, 2), slice(2, 3)


def load(layer: Layer, one: Indenter) -> Iterator[Step]:
    """States while it is sheared, from pressed to sliding."""
    row, column, x, y = layer.points(one)
    moved, relief = layer.product(row, column), one.relief(np.hypot(x, y))
    press = Press(layer.normal(row, column))
    curve = _largest(moved, len(row))
    p, t = np.zeros(len(row)), np.zeros((2, len(row)))

    def advance(depth_mm: float, rigid: Floats) -> float:
        nonlocal p, t
        before, p = p, press(depth_mm - relief - moved(t, SIDE, DOWN)[0])
        aim = moved(t, SIDE, SIDE) + moved((before - p)[None], DOWN, SIDE) + rigid
        t = _held(moved, aim, one.friction * p, t, curve)
        lag = np.hypot(*(aim - moved(t, SIDE, SIDE)))
        return float(np.mean(lag[p > 0] > 0.01 * max(float(np.abs(rigid).max()), 1e-9)))

    for k in range(1, PRESS + 1):
        advance(one.depth_mm * k / PRESS, np.zeros_like(t))
    ahead = np.stack([np.cos(one.direction) - one.turn_per_mm * y, np.sin(one.direction) + one.turn_per_mm * x])
    limit = min(one.friction, 1.0) * p.sum()
    stuck = _held(moved, ahead, np.where(p > 0, np.inf, 0.0), t, curve)
    reach = REACH * limit / float(np.hypot(*stuck.sum(axis=1)))
    for k in range(SHEAR + 1):
        sliding = 0.0 if k == 0 else advance(one.depth_mm, ahead * reach / SHEAR)
        fields = np.zeros((3, *(n * layer.view.fine for n in layer.view.shape)))
        fields[:, row, column] = *t, p
        share = float(np.hypot(*t.sum(axis=1)) / (one.friction * p.sum()))
        yield Step(fields, share, sliding, reach * k / SHEAR)


class Press:
    """Pressures (n,) >= 0 that make at least a depth (n,), and none where it is deeper."""

    def __init__(self, matrix: Floats) -> None:
        self.matrix, self.active = matrix, np.zeros(len(matrix), dtype=bool)
        self.factor: tuple[Floats, bool] | None = None

    def __call__(self, depth: Floats) -> Floats:
        """Solve, from the points that touched before."""
        if not self.active.any():
            self._touch(depth > 0.3 * depth.max())
        for _ in range(ACTIVE_ROUNDS):
            found = np.zeros(len(depth))
            assert self.factor is not None
            found[self.active] = cho_solve(self.factor, depth[self.active])
            pulls, short = self.active & (found < 0), ~self.active & (self.matrix @ found < depth - 1e-7)
            if not (pulls | short).any():
                break
            self._touch((self.active & ~pulls) | short)
        return np.maximum(found, 0.0)

    def _touch(self, active: Bools) -> None:
        self.active, self.factor = active, cho_factor(self.matrix[np.ix_(active, active)])


def _largest(moved: Moved, count: int) -> float:
    """Greatest eigenvalue of the tangential compliance, by powers."""
    vector = np.ones((2, count))
    for _ in range(30):
        vector = moved(vector / np.linalg.norm(vector), SIDE, SIDE)
    return 1.05 * float(np.linalg.norm(vector))


def _held(moved: Moved, aim: Floats, limit: Floats, start: Floats, curve: float) -> Floats:
    """Tangential tractions (2, n) within `limit` (n,) that move the gel to `aim` (2, n) where they can."""

    def within(t: Floats) -> Floats:
        return np.asarray(t * np.minimum(1.0, limit / np.maximum(np.hypot(*t), 1e-30)))

    found = ahead = within(start)
    weight = 1.0
    for _ in range(ROUNDS):
        new = within(ahead - (moved(ahead, SIDE, SIDE) - aim) / curve)
        change = new - found
        if float(((ahead - new) * change).sum()) > 0:
            weight = 1.0
        follow = (1 + np.sqrt(1 + 4 * weight**2)) / 2
        ahead = new + (weight - 1) / follow * change
        found, weight = new, follow
        if np.abs(change).max() < TOLERANCE * max(float(np.abs(new).max()), 1e-12):
            break
    return found
