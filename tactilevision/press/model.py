"""State the forward model of a recording: force, camera depth and bevel signal of every press.

The indenter of press i meets the gel at t_i and moves on at its pace, so that its face stands at the depth w with

    w + s F(w) = alpha [m(t) - m(t_i)],      F(w) = c w^p (1 + beta u + beta_2 u^2 + eps u^(2/3)),   u = w/h

m is the motion stage, or the stated speed times the time in motion; alpha its scale, s the rig's compliance. p is
1 for a flat punch, 3/2 for a ball and 2 for a cone; eps describes a rounded edge, which gel climbs as the depth
grows. What is measured is

    force              P = z_i + g_i F(w)
    camera's depth     d = o_i + b_i B (w + d_1 w u + d_2 w u^2) + shift min(P/P_c, 1)
    bevel's signal     y = l_i + n_i w + q_i w^2 + a_i A G(w - w_i)

where the gel meets the bevel at w_i = H/(1 + rho) + eta_H + delta + b tilt_i + e_i, and G is the growth of the
dent (contact/bevel.py). Frames are taken at t plus the clocks' offset. The camera's depth is compared at
w = F^-1(P - z_i), P less the share that the bevel carries beyond its touch. Where the pace is not
even, w is F^-1((P - z_i)/g_i) throughout.
`certification.py` does not use this model yet: the steps that it replaces are compared with it on new recordings
first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactilevision.contact.bevel import Growth
from tactilevision.press.force_readings import ForceWindow
from tactilevision.press.track import PressTrack
from tactilevision.records.contact_thresholds import CONTACT
from tactilevision.records.measured import Bools, Floats

Ints = npt.NDArray[np.int_]
Named = Mapping[str, Floats]


class Whole(IntEnum):
    """Unknowns of the whole recording: clocks, alpha, s, shift, the bevel's shares of force, delta, b, length."""

    OFFSET = 0
    PACE = 1
    COMPLIANCE = 2
    SHIFT = 3
    SHARE_1 = 4
    SHARE_2 = 5
    DELAY = 6
    TILT = 7
    FILL = 8


class Own(IntEnum):
    """Unknowns of each press: z, t, g, o, b, e, a, l, n, q with its number i."""

    ZERO = 0
    START = 1
    GAIN = 2
    CAMERA_ZERO = 3
    CAMERA_GAIN = 4
    TOUCH = 5
    DENT = 6
    LEVEL = 7
    SLOPE = 8
    BEND = 9


LAW = 4  # unknowns of a contact law: ln c, beta, beta_2, eps
CAMERA = 3  # B, d_1, d_2
STREAMS = 3  # camera's depth, bevel's signal, force of the ramp
SHARE = 0.45  # initial share of a dent's growth: .3 to .6 for a wedge of 5 to 20 degrees on a bonded layer
NEWTON_STEPS = 6  # of the inverse force law, which is nearly straight


@dataclass(frozen=True, slots=True, eq=False)
class PressData:
    """Measurements of one press, and what is known of it beforehand.

    `kind` numbers punches of one shape and radius with one bevel, `height` the machined heights (-1: none),
    `nominal_mm` is H/(1 + rho), inf without a bevel; `tilt_mm` lowers the bevel by the tilt of the face.
    `signal_mm` (N,) of the bevel at the frames, NaN: not used. `way` (T,) is m at the window's readings,
    None where the pace is not even; `top_s` is the end of the way in, `released_s` that of the hold. Ramp (R,):
    means of readings, `start_s` the first estimate of first contact.
    """

    track: PressTrack
    window: ForceWindow
    kind: int
    height: int
    nominal_mm: float
    distance_mm: float | None
    tilt_mm: float
    signal_mm: Floats
    way: Floats | None
    top_s: float
    released_s: float
    ramp_s: Floats
    ramp_N: Floats
    ramp_std_N: Floats
    start_s: float

    @property
    def name(self) -> str:
        return self.track.press.press


@dataclass(frozen=True, eq=False)
class PressModel:
    """The forward model for the presses of one recording.

    `powers` (kinds,) p; `force_N` (T,) at `force_time_s`: smoothed normal force without its zeros; `fill_mm` the
    unit of the dent's length.
    """

    presses: Sequence[PressData]
    powers: Floats
    heights: int
    force_time_s: Floats
    force_N: Floats
    thickness_mm: float
    fill_mm: float

    @cached_property
    def top_N(self) -> float:
        return float(np.ptp(self.force_N))

    @cached_property
    def blocks(self) -> dict[str, tuple[slice, tuple[int, ...]]]:
        """Places and shapes of the shared unknowns."""
        kinds = self.powers.size
        shapes = {
            "recording": (len(Whole),),
            "law": (kinds, LAW),
            "camera": (kinds, CAMERA),
            "amplitude": (kinds, 1),
            "height": (self.heights,),
        }
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes.values())])
        places = (slice(int(a), int(b)) for a, b in pairwise(ends))
        return {name: (place, shape) for (name, shape), place in zip(shapes.items(), places, strict=True)}

    @property
    def shared(self) -> int:
        """Number of shared unknowns."""
        return int(self.blocks["height"][0].stop)

    def block(self, shared: Floats, name: str) -> Floats:
        """Return a view of one block of the shared unknowns."""
        place, shape = self.blocks[name]
        return shared[place].reshape(shape)

    @cached_property
    def frame_press(self) -> Ints:
        """The press of each frame (N,)."""
        return np.repeat(np.arange(len(self.presses)), [one.track.time_s.size for one in self.presses])

    @cached_property
    def _ends(self) -> Ints:
        return np.cumsum([one.track.time_s.size for one in self.presses])[:-1]

    @cached_property
    def rows(self) -> tuple[Ints, Ints]:
        """Press and stream of each measurement."""
        ramp = np.repeat(np.arange(len(self.presses)), [one.ramp_s.size for one in self.presses])
        press = np.concatenate([self.frame_press] * 2 + [ramp])
        return press, np.repeat(np.arange(STREAMS), [self.frame_press.size] * 2 + [ramp.size])

    @cached_property
    def measured(self) -> Floats:
        """All measurements, stream after stream; NaN where there is none."""
        streams = [[one.track.depth_mm, one.signal_mm, one.ramp_N] for one in self.presses]
        return np.concatenate([rows[k] for k in range(STREAMS) for rows in streams])

    @cached_property
    def kinds(self) -> Ints:
        return np.array([one.kind for one in self.presses])

    def force(self, law: Floats, depth_mm: Floats, power: Floats | float) -> Floats:
        """Return F (N) at depths (N,) mm for laws (N, 4) or (4,)."""
        u = np.maximum(depth_mm, 0.0) / self.thickness_mm
        shape = 1 + law[..., 1] * u + law[..., 2] * u**2 + law[..., 3] * np.cbrt(u**2)
        return np.asarray(np.exp(law[..., 0]) * np.sign(depth_mm) * np.abs(depth_mm) ** power * shape)

    def rate(self, law: Floats, depth_mm: Floats, power: Floats | float) -> Floats:
        """Return dF/dw (N/mm)."""
        w = np.maximum(np.abs(depth_mm), 1e-6)
        u = np.maximum(depth_mm, 0.0) / self.thickness_mm
        shape = 1 + law[..., 1] * u + law[..., 2] * u**2 + law[..., 3] * np.cbrt(u**2)
        change = law[..., 1] * u + 2 * law[..., 2] * u**2 + 2 / 3 * law[..., 3] * np.cbrt(u**2)
        return np.asarray(np.exp(law[..., 0]) * w ** (power - 1) * (power * shape + change))

    def depth(self, law: Floats, force_N: Floats, power: Floats | float) -> Floats:
        """Return F^-1 (mm) at forces (N,) N."""
        start = np.exp(law[..., 0])
        w = np.sign(force_N) * (np.abs(force_N) / start) ** (1 / np.asarray(power))
        for _ in range(NEWTON_STEPS):
            rate = np.maximum(self.rate(law, w, power), 0.2 * start * np.maximum(np.abs(w), 1e-6) ** (power - 1))
            w = w - (self.force(law, w, power) - force_N) / rate
        return np.asarray(w)

    def touches(self, shared: Floats, own: Floats) -> Floats:
        """Return the depths w_i (presses,) mm at which the signals show the touch; inf without a bevel."""
        delay, tilt = self.block(shared, "recording")[[Whole.DELAY, Whole.TILT]]
        heights = np.append(self.block(shared, "height"), 0.0)  # -1: none
        nominal, tilt_mm, height = (
            np.array([getattr(one, name) for one in self.presses]) for name in ("nominal_mm", "tilt_mm", "height")
        )
        return np.asarray(nominal + heights[height] + delay + tilt * tilt_mm + own[:, Own.TOUCH])

    def growth(self, shared: Floats) -> Growth:
        """Return the growth of the dent beyond a touch."""
        return Growth(SHARE, self.fill_mm * float(np.exp(self.block(shared, "recording")[Whole.FILL])))

    def path(self, shared: Floats, own: Floats, k: int, time_s: Floats) -> Floats:
        """Return the depth (T,) mm of press k at times (T,) of the F/T clock, on the way in and at the top."""
        return self.paths(shared, own, [k], [time_s])

    def paths(self, shared: Floats, own: Floats, which: Sequence[int], times_s: Sequence[Floats]) -> Floats:
        """Return the depths of some presses, each at its times, one after another."""
        press = np.repeat(which, [time.size for time in times_s])
        law, power = self.block(shared, "law")[self.kinds[press]], self.powers[self.kinds[press]]
        _, pace, compliance, *_ = self.block(shared, "recording")
        drive = np.concatenate([self._drive(own, k, time) for k, time in zip(which, times_s, strict=True)])
        travel = pace * np.maximum(drive, 0.0)
        w = travel
        for _ in range(3):  # s F is a hundredth of w
            w = travel - compliance * self.force(law, w, power)
        uneven = np.array([one.way is None for one in self.presses])[press]
        if uneven.any():
            w[uneven] = self.depth(law[uneven], drive[uneven], power[uneven])
        return np.asarray(w)

    def _drive(self, own: Floats, k: int, time_s: Floats) -> Floats:
        """Return m(t) - m(t_i); where the pace is not even, the force F."""
        one = self.presses[k]
        if one.way is None:
            return np.asarray((one.window.at(time_s) - own[k, Own.ZERO]) / own[k, Own.GAIN])
        begun = np.interp(one.start_s + own[k, Own.START], one.window.time_s, one.way)
        return np.asarray(np.interp(time_s, one.window.time_s, one.way) - begun)

    def predict(self, shared: Floats, own: Floats) -> Floats:
        """Return what the model expects of each measurement."""
        press, powers = self.frame_press, self.powers[self.kinds][self.frame_press]
        offset, _, _, shift, share_1, share_2, *_ = self.block(shared, "recording")
        law = self.block(shared, "law")[self.kinds][press]
        time = np.concatenate([one.track.time_s for one in self.presses]) + offset
        one = own[press]
        whole = np.interp(time, self.force_time_s, self.force_N) - one[:, Own.ZERO]
        touch = self.touches(shared, own)[press]
        touched = np.isfinite(touch)
        level = one[:, Own.GAIN] * self.force(law, np.where(touched, touch, 0.0), powers)
        beyond = np.where(touched, np.maximum(whole - level, 0.0), 0.0)
        w = self.depth(law, whole - share_1 * beyond - share_2 * beyond**2 / self.top_N, powers)
        u = w / self.thickness_mm
        scale, bend_1, bend_2 = self.block(shared, "camera")[self.kinds][press].T
        seen = one[:, Own.CAMERA_ZERO] + one[:, Own.CAMERA_GAIN] * scale * w * (1 + bend_1 * u + bend_2 * u**2)
        seen = seen + shift * np.clip(whole / (CONTACT.reading_share * self.top_N), 0, 1)
        every = range(len(self.presses))
        ways = [*np.split(time, self._ends), *(one.ramp_s for one in self.presses)]
        x = self.paths(shared, own, [*every, *every], ways)
        x, ramp = x[: press.size], x[press.size :]
        amplitude = np.exp(self.block(shared, "amplitude")[self.kinds][press, 0])
        dent = amplitude * one[:, Own.DENT] * self.growth(shared)(x - touch)
        signal = dent + one[:, Own.LEVEL] + one[:, Own.SLOPE] * x + one[:, Own.BEND] * x**2
        press = self.rows[0][-ramp.size :] if ramp.size else press[:0]
        force = self.force(self.block(shared, "law")[self.kinds][press], ramp, self.powers[self.kinds][press])
        return np.concatenate([seen, signal, own[press, Own.ZERO] + own[press, Own.GAIN] * force])

    def usable(self, shared: Floats, own: Floats) -> Bools:
        """Return the rows that are fitted: of the bevel's signal those of the way in, of the ramp those before it.

        A dent creeps in the hold; it still shows there that the bevel touched.
        """
        good = np.isfinite(self.measured)
        offset = float(shared[0])
        way_in = [one.track.time_s + offset <= one.top_s for one in self.presses]
        good[self.rows[1] == 1] &= np.concatenate(way_in)
        touch = self.touches(shared, own)
        ramps = self.rows[1] == STREAMS - 1
        depth = self.paths(shared, own, range(len(self.presses)), [one.ramp_s for one in self.presses])
        good[ramps] &= depth < touch[self.rows[0][ramps]] - BEFORE_MM
        return good


BEFORE_MM = 0.004  # mm before a touch, from which readings of the ramp count: twice what is open of its place
