"""Slip-stick of the drive: it sticks until its spring is wound up, then jumps.

    w -> w - d frac(s/L) in loading,  w + d frac(s/L) in unloading

s is the travel since the press began, or since it turned back, frac the part after the point, by the first
HARMONICS of its series. Range: d up to .1 mm, L from .04 mm to the largest depth; vanishes at d = 0. Slips at
places of chance have no such form; they show as more scatter while loading. The fit begins at many lengths, whose
number counts as parameters do (`searched`). Source: Bowden and Leben, Proc. R. Soc. A 169 (1939) 371.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.inputs.denoised_depth import denoised_depth, unloading
from calibration.inputs.observations import Observations
from calibration.model.stages import EffectBase, ManualCheck, Parameter, Stage, State
from tactilevision.records.measured import Floats

FINEST_MM = 0.04  # shortest travel between two jumps, mm
LENGTHS = 48  # at which the fits begin, 5 % apart: over ten jumps half a length is wrong by that much
HARMONICS = 4  # of the saw tooth, which leave a twentieth of its height (rms)
MIN_PLACES = 12  # distinct depths: four for each number of the wave


class SlipStick(EffectBase):
    """Size of a jump, and travel between two."""

    key = "slip_stick"
    title = "the drive sticks and slips: the depth lags behind, and jumps"
    stage = Stage.DEPTH
    seen_in = ("w", "load/unload")
    confused_with = ("screw_error", "backlash", "depth_zero")
    separated_by = ("a dial gauge on the punch", "another speed")
    source = "Bowden and Leben, Proc. R. Soc. A 169 (1939) 371"
    order = 62.5
    acts_on = "punch"
    largest = 0.05
    searched = LENGTHS
    check = ManualCheck("follow the punch with a dial gauge along its travel: does it move evenly?", 10, 0.002)
    parameters = (
        Parameter("size_mm", "mm", 0.0, (0, 0.1), "lag before a jump", 0.005),
        Parameter("length_mm", "mm", 0.2, (FINEST_MM, 2), "travel between two jumps", 0.1),
    )

    def missing(self, data: Observations) -> str:
        """Return why these data cannot show it; empty where they can."""
        places = np.unique(np.round(4 * data.depth_mm / FINEST_MM)).size
        return "" if data.is_curves and places >= MIN_PLACES else f"needs curves of {MIN_PLACES} depths or more"

    def parameters_on(self, data: Observations) -> tuple[Parameter, ...]:
        """Return the parameters, with lengths up to the largest depth."""
        size, length = self.parameters
        most = _longest(data)
        return (size, replace(length, default=most, bounds=(FINEST_MM, most)))

    def starts(self, data: Observations) -> Floats:
        """Return starts at all lengths."""
        lengths = np.geomspace(FINEST_MM, _longest(data), LENGTHS)
        return np.column_stack([np.full(LENGTHS, 0.005), lengths])

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with the depth that the drive has reached."""
        smooth, back = denoised_depth(data), unloading(data)
        deepest = np.maximum.reduceat(smooth, data.first)[data.press]
        travel = np.where(back, deepest - smooth, smooth - smooth[data.first][data.press])
        lag = values[0] * _teeth(np.maximum(travel, 0.0) / values[1])
        return state.plus(depth_mm=np.where(back, lag, -lag))


def _teeth(turns: Floats) -> Floats:
    """Return the part of the turns (N,) after the point, smooth enough for a fit."""
    waves = sum((np.sin(2 * np.pi * n * turns) / n for n in range(1, HARMONICS + 1)), np.zeros(1))
    teeth: Floats = 0.5 - waves / np.pi
    return teeth


def _longest(data: Observations) -> float:
    return max(float(np.max(data.depth_mm)), 2 * FINEST_MM)
