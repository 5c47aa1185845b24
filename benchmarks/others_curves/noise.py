"""What is read of a press: samples with a noise, presses with a gain and a zero of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.others_curves.law import Array


@dataclass(frozen=True, slots=True)
class Reader:
    """Noise of one rig. `tails`, `heavy`: degrees of freedom of the samples' and of the presses' Student t, inf
    for a normal one; `step_N`: what the force is rounded to.
    """

    force_N: float
    depth_mm: float
    gain: float
    zero_mm: float
    alike: float
    tails: float
    heavy: float
    step_N: float
    stated: bool

    @property
    def kind(self) -> str:
        """In a word."""
        if self.alike:
            return "alike"
        if np.isfinite(self.tails):
            return "tails"
        if np.isfinite(self.heavy):
            return "heavy presses"
        return "steps" if self.step_N > 0 else "white"


def draw(rng: np.random.Generator) -> Reader:
    """Half of them white; the others with neighbours alike, heavy tails, heavy presses or coarse steps."""
    kind = str(rng.choice(["white", "alike", "tails", "heavy", "steps"], p=[0.5, 0.125, 0.125, 0.125, 0.125]))
    return Reader(
        force_N=float(rng.choice([0.002, 0.004, 0.008])),
        depth_mm=float(rng.choice([0.0, 0.002, 0.004])),
        gain=float(rng.choice([0.003, 0.005, 0.008])),
        zero_mm=float(rng.choice([0.002, 0.004, 0.006])),
        alike=0.6 if kind == "alike" else 0.0,
        tails=4.0 if kind == "tails" else np.inf,
        heavy=4.0 if kind == "heavy" else np.inf,
        step_N=0.01 if kind == "steps" else 0.0,
        stated=bool(rng.random() < 0.6),
    )


def student(rng: np.random.Generator, dof: float, size: int) -> Array:
    """Numbers (size,) of unit variance."""
    if not np.isfinite(dof):
        return rng.standard_normal(size)
    return np.asarray(rng.standard_t(dof, size) * np.sqrt((dof - 2) / dof))


def samples(rng: np.random.Generator, reader: Reader, size: int) -> Array:
    """Noise of one press's samples (size,), unit variance."""
    white = student(rng, reader.tails, size)
    out = white.copy()
    for k in range(1, size):
        out[k] = reader.alike * out[k - 1] + np.sqrt(1 - reader.alike**2) * white[k]
    return out
