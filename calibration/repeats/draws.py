"""Draws of a fit's error model for a bootstrap, with the tails that its samples and its presses have.

Samples and presses' gains and zeros are Student's t of unit variance, of the likeliest degrees of freedom; normal
where these bring no more than they cost (Schwarz, Ann. Stat. 6 (1978) 461).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.fit.least_squares import Fit
from calibration.noise.model import Noise, Whitener
from calibration.repeats.outlying_presses import TAILS, log_student, press_dof
from tactilevision.records import Floats

NORMAL_DOF = 100.0  # degrees of freedom from which a t is drawn as a normal
MIN_DOF = 2.5  # degrees of freedom: with 2 a t has no variance


def draw_errors(fitted: Fit, rng: np.random.Generator, draws: int, *, noises: Sequence[Noise] = ()) -> Floats:
    """Errors (N, draws), N, of the fit's error model, with the tails that its samples and presses have.

    `noises`: the sizes of each draw, where they are not the fit's own.
    """
    noise, about, press = fitted.noise, fitted.about, fitted.data.press
    own = replace(noise, gain=0.0, zero_mm=0.0)
    sizes = np.array([[n.scale, n.gain, n.zero_mm] for n in noises or [noise] * draws]).T
    of_samples = student(rng, sample_dof(fitted), (fitted.data.size, draws))
    errors = Whitener(fitted.data, own, about).colour(of_samples) * sizes[0] / noise.scale
    if noise.gain or noise.zero_mm:
        gain, zero = student(rng, press_dof(fitted), (2, fitted.data.count, draws))
        errors += sizes[1] * about.force_N[:, None] * gain[press]
        errors += sizes[2] * about.slope_N_per_mm[:, None] * zero[press]
    return np.asarray(errors)


def student(rng: np.random.Generator, dof: float, shape: tuple[int, ...]) -> Floats:
    """Student's t of this shape, unit variance; normal from 100 degrees of freedom on."""
    if dof > NORMAL_DOF:
        return rng.standard_normal(shape)
    dof = max(dof, MIN_DOF)
    return np.asarray(rng.standard_t(dof, shape) * np.sqrt((dof - 2) / dof))


def sample_dof(fitted: Fit) -> float:
    """The likeliest degrees of freedom of white residuals, of unit variance; normal unless it brings its cost."""
    white = Whitener(fitted.data, fitted.noise, fitted.about).apply(fitted.residual_N)
    white = white / max(float(np.std(white)), 1e-300)

    def likelihood(dof: float) -> float:
        size = float(np.sqrt((dof - 2) / dof))
        return float(np.sum(log_student(white / size, dof)) - white.size * np.log(size))

    tails = [dof for dof in TAILS if dof > MIN_DOF]
    best = max(tails, key=likelihood)
    return best if likelihood(best) - likelihood(tails[-1]) > np.log(white.size) else tails[-1]
