"""The rig: motion of the indenter, and the force and clock that are recorded.

The force of the punch is E times that of finite elements of its gel (punch.py) at the true depth of the face. A
bevel that overlaps the gel by δ(t) along its edge adds 1/2 E/(1 - ν²) ∫ δ dt, which starts from zero at the first
touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.records.measured import Floats

QUANTUM_N = (1 / 160, 1 / 160, 1 / 80)  # N, steps of the readings fx, fy, fz


@dataclass(frozen=True, slots=True)
class Protocol:
    """Course of a press.

    `free_s` in air before the ramp and after the release, `gap_mm` above the gel; `rest_s` between presses;
    `dwell_s`: pause at the touch of the bevel; `overtravel_mm` of the face after it; `hold_s`: pause there.
    """

    free_s: float = 0.8
    gap_mm: float = 0.15
    rest_s: float = 3.0
    speed_mm_s: float = 0.25
    release_mm_s: float = 1.0
    dwell_s: float = 0.0
    overtravel_mm: float = 0.07
    hold_s: float = 0.6


@dataclass(frozen=True, slots=True)
class Motion:
    """Height of the face against the camera's clock: corners of a polygon; below 0 the face is in the air."""

    time_s: Floats
    face_mm: Floats
    phase: tuple[str, ...]

    def at(self, time_s: Floats | float) -> Floats:
        """Return the depth (mm) of the face at times (T,) s."""
        return np.asarray(np.interp(time_s, self.time_s, self.face_mm), dtype=np.float64)

    def loading_time_s(self, depth_mm: float) -> float:
        """Return the time s at which the face first reaches a depth; NaN if it never does."""
        reached = np.flatnonzero(self.face_mm >= depth_mm - 1e-12)
        if reached.size == 0:
            return float("nan")
        leg = slice(max(int(reached[0]) - 1, 0), int(reached[0]) + 1)
        return float(np.interp(depth_mm, self.face_mm[leg], self.time_s[leg]))

    def released_s(self) -> float:
        """Return the time s at which the face leaves the gel."""
        turn = self.face_mm.size - 1 - int(np.argmax(self.face_mm[::-1]))
        return float(np.interp(0.0, -self.face_mm[turn:], self.time_s[turn:]))

    def phase_at(self, time_s: Floats) -> list[str]:
        """Return free, load, hold or unload at each of the times (T,) s."""
        spans = np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, len(self.phase) - 1)
        words = [self.phase[i] for i in spans]
        return ["free" if face <= 0 else word for face, word in zip(self.at(time_s), words, strict=True)]


def move(protocol: Protocol, touch_mm: float, *, deepest_mm: float) -> Motion:
    """Return the motion: air, ramp to the bevel's touch, dwell, ramp to the deepest point, hold, release, air."""
    legs = [(protocol.free_s, -protocol.gap_mm, "free")]
    if touch_mm < deepest_mm:
        legs.append(((touch_mm + protocol.gap_mm) / protocol.speed_mm_s, touch_mm, "load"))
        if protocol.dwell_s > 0:
            legs.append((protocol.dwell_s, touch_mm, "hold"))
    travelled = legs[-1][1]
    legs += [
        ((deepest_mm - travelled) / protocol.speed_mm_s, deepest_mm, "load"),
        (protocol.hold_s, deepest_mm, "hold"),
        ((deepest_mm + protocol.gap_mm) / protocol.release_mm_s, -protocol.gap_mm, "unload"),
        (protocol.free_s, -protocol.gap_mm, "free"),
    ]
    times = np.concatenate([[0.0], np.cumsum([leg[0] for leg in legs])])
    return Motion(times, np.array([-protocol.gap_mm] + [leg[1] for leg in legs]), tuple(leg[2] for leg in legs))


@dataclass(frozen=True, slots=True)
class ForceSensor:
    """Errors of a six-axis sensor: `noise_N` of a reading, `bias_N`, linear `drift_N_s`, symmetric `range_N`."""

    noise_N: tuple[float, float, float] = QUANTUM_N
    bias_N: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_N_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    range_N: float = float("inf")

    def read(self, force_N: Floats, time_s: Floats, rng: np.random.Generator) -> Floats:
        """Return readings of true forces (T, 3): with bias, drift, noise, limits and quantisation."""
        reading = force_N + np.asarray(self.bias_N) + np.outer(time_s, self.drift_N_s)
        reading = reading + rng.standard_normal(force_N.shape) * np.asarray(self.noise_N)
        reading = np.clip(reading, -self.range_N, self.range_N)
        return np.asarray(np.round(reading / QUANTUM_N) * QUANTUM_N)
