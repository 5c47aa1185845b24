"""How strongly a hidden effect shows: the whitened length of what it adds, less what the usual law would absorb.

    S^2 = min over theta of |L^-1 (y_with - y_without - J theta)|^2 + |theta/prior|^2,    L L^T = noise of a press

J: Young's modulus, nu (with its prior), one curvature for each radius. The angle between two such signals says how
well two effects can be told apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind import figures
from benchmarks.blind.contact import Curves, elastic_N
from benchmarks.blind.design import Design
from benchmarks.blind.rig import AR1, Noise, Reads, read
from benchmarks.blind.world import HIDDEN, World
from tactilevision.records.measured import Floats

NU_STD = 0.005


@dataclass(frozen=True, slots=True)
class Stage:
    """A clean world, its design and its noise, with what is needed to weigh signals in it."""

    world: World
    design: Design
    noise: Noise
    clean: Reads
    slope: Floats
    root: Floats
    nuisance: Floats

    def signal(self, world: World) -> Floats:
        """What `world` adds to the clean one (N,), white, freed of what the law absorbs, then what the picture
        adds.
        """
        reads = read(world, self.design)
        force = reads.force_N[:, :, 2] - self.clean.force_N[:, :, 2]
        force = force - self.slope * (reads.depth_mm - self.clean.depth_mm)
        white = _whiten(self.root, force).ravel()
        basis = self.nuisance
        padded = np.concatenate([white, np.zeros(len(basis) - white.size)])
        seen = (reads.seen_mm - reads.depth_mm) - (self.clean.seen_mm - self.clean.depth_mm)
        picture = self._picture(seen) if world.source == "gauge" else np.zeros(0)
        return np.concatenate([padded - basis @ (basis.T @ padded), picture])

    def strength(self, world: World) -> float:
        """The length of the signal: signal over noise."""
        return float(np.linalg.norm(self.signal(world)))

    def _picture(self, seen: Floats) -> Floats:
        depth = np.maximum(self.clean.depth_mm, 0)
        variance = np.array([np.outer(d, d) for d in depth]) * (0.6 * self.noise.gain) ** 2
        variance += np.eye(depth.shape[1]) * (0.5 * self.noise.zero_mm) ** 2 + self.noise.zero_mm**2
        return _whiten(_root(variance), seen).ravel()


def set_stage(world: World, design: Design, noise: Noise) -> Stage:
    """Everything about the clean world that signals are weighed with."""
    bare = replace(world, amounts={})
    clean = read(bare, design)
    force = clean.force_N[:, :, 2]
    slope = (_elastic(bare, design, clean.depth_mm + 5e-4) - _elastic(bare, design, clean.depth_mm - 5e-4)) / 1e-3
    root = _root(_covariance(noise, force, slope))
    columns = [force, (_elastic(replace(bare, nu=bare.nu + 1e-3), design, clean.depth_mm) - force) / 1e-3]
    radius = np.array([t.radius_mm for t in design.touches])
    columns += [force * clean.depth_mm * (radius == a)[:, None] for a in np.unique(radius)]
    table = np.column_stack([_whiten(root, c).ravel() for c in columns])
    prior = np.zeros((1, table.shape[1]))
    prior[0, 1] = 1 / NU_STD
    basis, _ = np.linalg.qr(np.vstack([table, prior]))
    return Stage(bare, design, noise, clean, slope, root, np.asarray(basis, dtype=np.float64))


def sized(stage: Stage, world: World, key: str, strength: float) -> World:
    """`world` with as much of an effect as shows with this strength, or as its range allows."""
    hidden = HIDDEN[key]
    sign = np.sign(world.amount(key)) or 1.0
    others = stage.signal(world.with_amount(key, 0.0))
    low, high = np.log(hidden.low), np.log(hidden.high)
    for _ in range(9):
        middle = (low + high) / 2
        seen = np.linalg.norm(stage.signal(world.with_amount(key, sign * float(np.exp(middle)))) - others)
        low, high = (middle, high) if seen < strength else (low, middle)
    return world.with_amount(
        key, sign * min(float(np.exp(high)), hidden.high)
    )  # what acts as a threshold is at its far side


def apart(one: Floats, other: Floats) -> float:
    """Sigmas between two signals when the second may be smaller, or larger by half."""
    size = float(other @ other)
    share = float(np.clip(one @ other / size, 0.0, 1.5)) if size > 0 else 0.0
    return float(np.linalg.norm(one - share * other))


def _elastic(world: World, design: Design, depth: Floats) -> Floats:
    pairs = zip(design.touches, depth, strict=True)
    known: Curves = {}
    return np.array([np.where(d > 0, elastic_N(world, touch, d, known), 0.0) for touch, d in pairs])


def _covariance(noise: Noise, force: Floats, slope: Floats) -> Floats:
    lag = np.abs(np.subtract.outer(np.arange(force.shape[1]), np.arange(force.shape[1])))
    own = noise.sample_N**2 * (AR1**lag if noise.kind == "ar1" else (lag == 0))
    gain = noise.gain**2 * force[:, :, None] * force[:, None, :]
    return np.asarray(own + gain + noise.zero_mm**2 * slope[:, :, None] * slope[:, None, :])


def _root(covariance: Floats) -> Floats:
    return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)


def _whiten(root: Floats, values: Floats) -> Floats:
    return np.asarray(np.linalg.solve(root, values[:, :, None])[:, :, 0], dtype=np.float64)


def beta_of(world: World, radius_mm: float) -> float:
    """Curvature of P/w against w/h that a straight fit of this gel's first .45 mm would give."""
    strain = np.linspace(0.01, 0.15, 15)
    bent = figures.bend(strain, np.full(15, radius_mm / world.thickness_mm), straight=world.straight)
    slope, start = np.polyfit(strain, bent, 1)
    return float(slope / start)
