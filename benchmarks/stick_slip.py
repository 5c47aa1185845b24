"""Contacts that are pressed and then sheared until they slide, by Coulomb's law on the exact layer.

Apart from the code that is tested: the compliance is that of benchmarks.layer_truth, on points of the plane, and
each step of the load is a quadratic problem under friction cones,

    min 1/2 t A t - t (A t_old + C_tz (p_old - p) + d),    |t_i| <= mu p_i,

A the tangential compliance, d the rigid motion of the indenter in the step, solved by accelerated projected
gradients (Nesterov); pressures p >= 0 by an active set. A point that sticks moves with the indenter from where the
gel was when they met, so pressing leaves shear behind.

A gel that creeps answers with the compliance J(t) = 1 + c (1 - exp(-t/T)) times its own, c = g/(1 - g), where g of
the force relaxes at rest. Its memory m is a traction, implicit in a step of time s, with w = s/(s + T):

    u = C (J_s t + (1 - w) m_old),    m = (1 - w) m_old + w c t,    J_s = 1 + c w
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

    def relief(self, x: Floats, y: Floats) -> Floats:
        """Height of the face above its lowest point at x, y mm from the axis, to be pressed in by `depth_mm`."""
        a, w, r = self.radius_mm, self.depth_mm, np.hypot(x, y)
        if self.kind == "ball":
            return np.asarray(0.55 * w * (r / a) ** 2)
        if self.kind == "rounded punch":
            return np.asarray(0.4 * w * np.clip(r / a - 0.6, 0, None) ** 2 / 0.16)
        if self.kind == "two contacts":
            return np.asarray(0.55 * w * ((np.abs(x) / a - 0.6) ** 2 + (y / a) ** 2) / 0.16)
        if self.kind == "star":
            return np.where(r <= a * (0.65 + 0.35 * np.cos(5 * np.arctan2(y, x))), 0.0, np.inf)
        return np.where((r <= a) & (r >= (0.6 * a if self.kind == "ring" else 0.0)), 0.0, np.inf)


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


SIDE, DOWN, ALL = slice(0, 2), slice(2, 3), slice(0, 3)


@dataclass(frozen=True)
class Hold:
    """A stop at `share` of the limit, by force (`by_force`) or in place: `relaxes` g, and steps of s/T time."""

    share: float
    by_force: bool
    relaxes: float
    steps: int = 6
    step: float = 0.5


class Contact:
    """Tractions `t` (3, n) of a contact, and where its gel is, through the steps of a load."""

    def __init__(self, layer: Layer, one: Indenter, creeps: float) -> None:
        self.layer, self.one, self.creeps = layer, one, creeps
        self.row, self.column, x, y = layer.points(one)
        self.moved, self.relief = layer.product(self.row, self.column), one.relief(x, y)
        self.press, self.curve = Press(layer.normal(self.row, self.column)), _largest(self.moved, len(x))
        turn = one.turn_per_mm
        self.ahead = np.stack([np.cos(one.direction) - turn * y, np.sin(one.direction) + turn * x])
        self.t, self.memory, self.were = np.zeros((3, len(x))), np.zeros((3, len(x))), np.zeros((2, len(x)))

    @property
    def push(self) -> float:
        """Tangential force, in units of the area of a point."""
        return float(np.hypot(*self.t[:2].sum(axis=1)))

    def stuck(self) -> float:
        """Tangential force for 1 mm of motion if nothing slipped, in the same unit."""
        hold = np.where(self.t[2] > 0, np.inf, 0.0)
        return float(np.hypot(*_held(self.moved, self.ahead, hold, self.t[:2], self.curve).sum(axis=1)))

    def advance(self, depth_mm: float, motion_mm: float, step: float = 0.1) -> float:
        """Go to a depth and on by a motion, in a time; return the share of the area that slips."""
        moved, w, rigid = self.moved, step / (1 + step), motion_mm * self.ahead
        softer, old = 1 + self.creeps * w, moved((1 - w) * self.memory, ALL, ALL)
        t = np.empty_like(self.t)
        t[2] = self.press((depth_mm - self.relief - old[2]) / softer - moved(self.t[:2], SIDE, DOWN)[0])
        by_pressure = moved(t[2:], DOWN, SIDE)
        aim = (self.were + rigid - old[:2]) / softer - by_pressure
        t[:2] = _held(moved, aim, self.one.friction * t[2], self.t[:2], self.curve)
        by_shear = moved(t[:2], SIDE, SIDE)
        self.were = softer * (by_shear + by_pressure) + old[:2]
        self.t, self.memory = t, (1 - w) * self.memory + w * self.creeps * t
        lag = np.hypot(*(aim - by_shear))
        return float(np.mean(lag[t[2] > 0] > 0.01 * max(float(np.abs(rigid).max()), 1e-9)))

    def state(self, sliding: float, moved_mm: float) -> Step:
        """What it is now; of a gel that creeps, the tractions that an elastic one would need for its place."""
        view = self.layer.view
        fields = np.zeros((3, *(n * view.fine for n in view.shape)))
        fields[:, self.row, self.column] = self.t + self.memory
        return Step(fields, self.push / (self.one.friction * float(self.t[2].sum())), sliding, moved_mm)


def load(layer: Layer, one: Indenter, hold: Hold | None = None) -> Iterator[Step]:
    """States while it is sheared, from pressed to sliding, or to a hold and through it."""
    contact = Contact(layer, one, hold.relaxes / (1 - hold.relaxes) if hold else 0.0)
    for k in range(1, PRESS + 1):
        contact.advance(one.depth_mm * k / PRESS, 0.0)
    limit, stuck = min(one.friction, 1.0) * float(contact.t[2].sum()), contact.stuck()
    step, at, depth = REACH * limit / stuck / SHEAR, 0.0, one.depth_mm
    for k in range(SHEAR + 1):
        at = k * step
        yield contact.state(contact.advance(depth, step) if k else 0.0, at)
        if hold and contact.push >= hold.share * limit:
            break
    pushed, pressed = contact.push, contact.t[2].sum()
    for _ in range(hold.steps if hold else 0):
        assert hold is not None
        more = (pushed - contact.push) / stuck if hold.by_force else 0.0
        depth *= float(np.sqrt(pressed / contact.t[2].sum())) if hold.by_force else 1.0
        at += more
        yield contact.state(contact.advance(depth, more, hold.step), at)


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
