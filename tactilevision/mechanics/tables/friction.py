"""From one tabulated friction to the next: a monotone cubic in mu/(mu + 3).

What friction does grows in proportion to mu and stops at some mu of .1 to .3, where the whole face sticks. This
cubic follows both and never swings beyond its nodes, as one without bounds does by .9 % of the force.
Source: Fritsch, Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300, with the weights of Brodlie.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.mechanics.friction import friction_place
from tactilevision.mechanics.tables.blocks import Block
from tactilevision.records import Floats

ROUNDING = 1e-9  # of the way from node to node: met but for rounding, and the other node must not lend its reach


@dataclass(frozen=True, slots=True)
class Neighbours:
    """The one block of a friction that is tabulated, else those about it: at most two on either side, at ascending
    `places`; it lies at `at`, between the two that `about` gives."""

    blocks: tuple[Block, ...]
    places: tuple[float, ...] = (0.0,)
    at: float = 0.0

    @property
    def about(self) -> tuple[Block, ...]:
        """The block itself, or the next on either side: what they know is known here."""
        low = _interval(self.places, self.at)
        return self.blocks[low : low + 2]

    def blend(self, values: Sequence[Floats]) -> Floats:
        """What lies between the blocks' `values`."""
        return values[0] if len(values) == 1 else monotone(np.array(self.places), np.array(values), at=self.at)


def neighbours(blocks: Sequence[Block], friction: float) -> Neighbours:
    """Of `blocks`, alike but for their frictions, those that lie about `friction`, which is among theirs."""
    ordered = sorted(blocks, key=lambda block: block.friction)
    places = [friction_place(block.friction) for block in ordered]
    at = friction_place(friction)
    for block, place in zip(ordered, places, strict=True):
        if abs(at - place) < ROUNDING:
            return Neighbours((block,))
    low = _interval(places, at)
    near = slice(max(low - 1, 0), low + 3)
    return Neighbours(tuple(ordered[near]), tuple(places[near]), at)


def monotone(places: Floats, values: Floats, *, at: float) -> Floats:
    """Monotone cubic through `values` (K, ...) at ascending `places` (K,), K >= 2, read at `at` in their unit."""
    step = np.diff(places)
    secant = np.diff(values, axis=0) / step.reshape(-1, *[1] * (values.ndim - 1))
    low = _interval(places.tolist(), at)
    t = (at - places[low]) / step[low]
    slopes = step[low] * _slope(step, secant, low), step[low] * _slope(step, secant, low + 1)
    bend = (1 - t) * (slopes[0] - step[low] * secant[low]) - t * (slopes[1] - step[low] * secant[low])
    return np.asarray((1 - t) * values[low] + t * values[low + 1] + t * (1 - t) * bend)


def _slope(step: Floats, secant: Floats, node: int) -> Floats:
    """The cubic's slope at a node: the harmonic mean of its neighbours', 0 where they differ in sign."""
    if len(step) == 1:
        return np.asarray(secant[0])
    if node in (0, len(step)):
        return _end_slope(step if node == 0 else step[::-1], secant if node == 0 else secant[::-1])
    before, after = secant[node - 1], secant[node]
    weights = step[node - 1] + 2 * step[node], 2 * step[node - 1] + step[node]
    both = before * after
    under = weights[0] * after + weights[1] * before
    return np.asarray(np.divide(sum(weights) * both, under, out=np.zeros_like(both), where=both > 0))


def _end_slope(step: Floats, secant: Floats) -> Floats:
    """At the outermost node, from the parabola through three; never against its own secant, nor too steep."""
    slope = ((2 * step[0] + step[1]) * secant[0] - step[0] * secant[1]) / (step[0] + step[1])
    slope = np.where(slope * secant[0] > 0, slope, 0.0)
    steep = (secant[0] * secant[1] < 0) & (np.abs(slope) > 3 * np.abs(secant[0]))
    return np.asarray(np.where(steep, 3 * secant[0], slope))


def _interval(places: Sequence[float], at: float) -> int:
    return min(max(bisect_right(places, at) - 1, 0), max(len(places) - 2, 0))
