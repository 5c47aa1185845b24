"""Three near lamps or more, found from balls and the picture of the untouched gel.

A lamp l is a strip of length L in a place C_l, its front turned to the pad. At a place P it gives the vector

    e_l(P) = mean over points Q of the strip of  max(-f.d, 0)/r^2 d        d = (Q - P)/r,  r = |Q - P|

and a matt surface of slopes p, q shows in channel k, untouched gel = 1,

    I_k / I0_k = (sum_l m_kl (e_z - e_x p - e_y q)/(e_z sqrt(1 + p^2 + q^2)))^(1/g)
    m_kl = c_kl e_lz / sum_j c_kj e_jz

c_kl is what lamp l gives to channel k (a lamp is not a colour), g the camera's power. Balls tell the directions,
weighted by m; how the untouched picture changes over the pad tells the lamps apart, since each falls off from its
own side. All is fitted together by least squares, with wide priors of place and size.

Two lamps of one colour on different sides look like one between them, to balls that both reach: their light on a
slope is the same. The untouched picture tells them apart, since it is bright on both sides. So three lamps are
fitted first; where these leave the untouched picture of one colour unexplained, that colour is given one more lamp
at a time, which stays if it leaves less of all misfit, and the balls are explained better, too.

Assumes lamps beside the pad, a matt ink and a surface that hardly lights itself. On three sensors drawn by a
path tracer (strip lamps, gloss, interreflection) azimuths came out within .1 rad, elevations 5 to 15 % low, and
colours within .06 of a lamp's main one. Source of the near-light model: Quéau et al., J. Math. Imaging Vis. 60
(2018) 313.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.photometric.drift import SOFTENING_GREY
from tactilevision.photometric.reference import Reference
from tactilevision.records.measured import Floats, Pair

POINTS = 5  # along a strip: more change no elevation by 1 %
SAMPLES = 800  # of balls in the fit: more change no parameter by its deviation
BLOCKS = (10, 14)  # rows and columns in which the untouched picture is compared
SOFT = 0.05  # of a lamp's light on level gel: rounds off where the surface turns away from it
STD_OF_BALLS = (0.01, 0.03)  # relative deviation of a ball's pixel, level, and for each unit of slope
STD_OF_FREE = 0.015  # relative deviation of the untouched picture from the law: ink, vignetting
ROBUST = 3.0  # deviations beyond which a ball's pixel counts less: shadow, gloss
MAX_KNOWN = 64  # lamps whose light is kept during the fit: a step and its derivatives
DARKEST = 0.02  # of the untouched gel's grey level
MIN_COUNT = 200  # samples of balls, fewer do not tell three lamps
PRIORS = {  # of ln distance, ln tangent of elevation, ln length, aim; lengths in half widths of the pad
    "distance": (np.log(1.7), 0.3),
    "tangent": (np.log(0.45), 0.5),
    "length": (np.log(1.35), 0.5),
    "aim": (0.3, 0.3),
}
PRIOR_CROSS = (-1.5, 3.0)  # ln of a lamp's light to another channel over its own, and deviation
PRIOR_POWER = (2.0, 0.3)  # of a camera: sRGB and video, and their deviation
LENGTHS = (0.3, 3.0)  # of a lamp, in half widths of the pad: from a point to a strip along all of a side
MAX_POWER = 3.0  # of a camera, beyond all that are in use
BRIGHTEST = 50.0  # ln of a lamp's light to a channel: no number overflows
FAINTEST = 1e-6  # of a lamp's light to a channel
OWN = 8  # unknowns of a lamp: ln distance, tangent, length, its azimuth, aim and three colours
UNEXPLAINED = 0.05  # of a colour's light, rms: as many lamps as drawn leave .012 to .040, too few .07 to .14
MAX_LAMPS = 6  # two of each colour
LESS = 0.8  # of all misfit, the most that a lamp more leaves to stay: where one was missing .3 to .7
BEST_MISFIT = 3.0  # of balls, by three lamps or all: what fits worse is lit by something else
TURNS = (0.5, 1.0, 1.5)  # pi, from the colour's first lamp to where its next one is looked for


@dataclass(frozen=True)
class Lamp:
    """A strip beside the pad: `azimuth_rad` of its middle (x to the right, y down), `distance_mm` from the pad's
    centre in the plane, `height_mm` over the gel, `length_mm`; its front faces the point `aim_mm` beyond the
    centre. `colour` (3,): what it gives to red, green, blue, in light."""

    azimuth_rad: float
    distance_mm: float
    height_mm: float
    length_mm: float
    aim_mm: float
    colour: tuple[float, float, float]

    @cached_property
    def points_mm(self) -> Floats:
        """Points (POINTS, 3), mm, along the strip."""
        out, side = _directions(self.azimuth_rad)
        along = self.length_mm * ((np.arange(POINTS) + 0.5) / POINTS - 0.5)
        plane = self.distance_mm * out + along[:, None] * side
        return np.column_stack([plane, np.full(POINTS, self.height_mm)])

    def light(self, x_mm: Floats, y_mm: Floats, z_mm: Floats | float = 0.0) -> Floats:
        """Vector of light (3, ...) at places of the pad (any shape, mm), `z_mm` over it; its unit is open."""
        return np.asarray(np.sum(self._lights(x_mm, y_mm, z_mm), axis=0) * self.distance_mm**2 / POINTS)

    def lights(self, x_mm: Floats, y_mm: Floats, z_mm: Floats | float = 0.0) -> Floats:
        """As `light`, of each of the strip's points (POINTS, 3, ...)."""
        return np.asarray(self._lights(x_mm, y_mm, z_mm) * self.distance_mm**2)

    def _lights(self, x_mm: Floats, y_mm: Floats, z_mm: Floats | float) -> Floats:
        out, _ = _directions(self.azimuth_rad)
        front = np.array([*(-(self.aim_mm + self.distance_mm) * out), -self.height_mm])
        front /= np.linalg.norm(front)
        light = np.empty((POINTS, 3, *np.shape(x_mm)))
        for one, point in zip(light, self.points_mm, strict=True):
            way = np.stack([point[0] - x_mm, point[1] - y_mm, np.broadcast_to(point[2] - z_mm, np.shape(x_mm))])
            square = np.sum(way**2, axis=0)
            shine = np.maximum(-np.tensordot(front, way, axes=1), 1e-6 * self.distance_mm)
            one[:] = shine / square**2 * way
        return light


@dataclass(frozen=True, slots=True)
class Lamps:
    """The lamps of a sensor, the camera's `power`, and the rms `misfit` of the balls in stated deviations.

    `refined`: the same lamps by a fit that knows gloss and raised gel (glossy_lamps.py), by which lengths of
    shadows are read; None where there is none. `unexplained`: rms share of the untouched picture's
    light, in its worst colour, off the law; 0 where it is not known.
    """

    lamps: tuple[Lamp, ...]
    power: float
    misfit: float
    refined: Lamps | None = None
    unexplained: float = 0.0

    @property
    def doubtful(self) -> bool:
        """Whether they do not explain the untouched picture: there are others, and shadows fall elsewhere."""
        return self.unexplained > UNEXPLAINED


def fit_lamps(
    change: Floats, slopes: Floats, *, place: Floats, reference: Reference, mm_per_px: Pair
) -> Lamps | None:
    """Lamps that explain colour changes (N, 3) and slopes (N, 2) under balls, and the untouched picture in grey.

    `place` (N, 2) runs from -1 to 1 over the picture. None where there are too few samples, or where channels are
    mixtures of fewer than three, as in grey pictures. No unit of light is known: colours hold among each other
    alone.
    """
    if len(place) < MIN_COUNT or np.linalg.matrix_rank(change) < change.shape[1]:
        return None
    some = np.linspace(0, len(place) - 1, min(SAMPLES, len(place))).astype(np.intp)
    return LampTask.of(change[some], slopes[some], place[some], reference, mm_per_px).solved()


@dataclass(frozen=True)
class LampTask:
    """One fit. Parameters: OWN for each lamp, the camera's power, four of the ink's and the lens's fall-off, and
    those of gloss, where the law has some. `noise` (3, n) of the balls' pixels, a share of their level."""

    x_mm: Floats
    y_mm: Floats
    slopes: Floats
    ratio: Floats
    noise: Floats
    free_x_mm: Floats
    free_y_mm: Floats
    free: Floats
    half_mm: float
    others: int = 5
    known: dict[Lamp, tuple[Floats, Floats]] = field(default_factory=dict)  # a derivative moves one lamp of all

    @classmethod
    def of(cls, change: Floats, slopes: Floats, place: Floats, reference: Reference, mm_per_px: Pair) -> Self:
        height, width = reference.shape
        half = 0.5 * np.array([(width - 1) * mm_per_px[0], (height - 1) * mm_per_px[1]])
        columns, rows = np.rint(0.5 * (place + 1.0) * (width - 1, height - 1)).astype(np.intp).T
        level = np.maximum(reference.rgb[rows, columns], 1.0).T
        ratio = np.maximum(1.0 + change.T * (level + SOFTENING_GREY) / level, DARKEST)
        blocks = cv2.resize(np.asarray(reference.rgb, np.float32), BLOCKS[::-1], interpolation=cv2.INTER_AREA)
        down, across = ((2 * np.arange(n) + 1.0) / n - 1.0 for n in BLOCKS)
        free_x, free_y = (at.ravel() for at in np.meshgrid(across * half[0], down * half[1]))
        free = np.log(np.maximum(blocks.transpose(2, 0, 1).reshape(3, -1), 1.0) / 255.0)
        x, y = (place * half).T
        noise = np.array(reference.noise_grey)[:, None] / level
        return cls(x, y, slopes.T, ratio, noise, free_x, free_y, free, float(half[0]))

    def start(self) -> Floats:
        """Each lamp in the direction in which its channel grows brighter with slope."""
        change = np.linalg.lstsq(self.slopes.T, self.ratio.T**2 - 1.0, rcond=None)[0]
        own = [_usual_lamp(float(np.arctan2(-change[1, k], -change[0, k])), k) for k in range(3)]
        return np.concatenate([*own, [PRIOR_POWER[0]], np.zeros(4)])

    def solved(self) -> Lamps:
        """The lamps that leave the least: three, or more where these leave the untouched picture unexplained."""
        values, left = self._least(self.start())
        most = MAX_LAMPS if self.misfit(values) < BEST_MISFIT else 3
        while len(self.parts(values)[0]) < most and self.unexplained(values).max() > UNEXPLAINED:
            more, rest = self._with_one_more(values)
            if rest > LESS * left or self.misfit(more) > self.misfit(values):
                break
            values, left = more, rest
        power, unexplained = float(self.parts(values)[1][0]), float(self.unexplained(values).max())
        return Lamps(self.lamps(values), power, self.misfit(values), unexplained=unexplained)

    def misfit(self, values: Floats) -> float:
        """Robust rms of the balls' pixels off the law, in stated deviations."""
        return float(np.sqrt(np.median(self.of_balls(values) ** 2)) / 0.6745)

    def _least(self, start: Floats) -> tuple[Floats, float]:
        """The parameters that leave the least, and half the sum of squares that they leave."""
        from scipy.optimize import least_squares

        low, high = np.full(start.size, -np.inf), np.full(start.size, np.inf)
        camera = OWN * len(self.parts(start)[0])
        low[camera], high[camera] = 1.0, MAX_POWER
        low[3:camera:OWN], high[3:camera:OWN] = np.log(LENGTHS)
        found = least_squares(self.residual, start, bounds=(low, high), x_scale="jac", max_nfev=60)
        return found.x, float(found.cost)

    def _with_one_more(self, values: Floats) -> tuple[Floats, float]:
        """As `_least`, with a lamp more of the colour that is explained worst, looked for on other sides."""
        own, others = self.parts(values)
        colour = int(np.argmax(self.unexplained(values)))
        first, best, least = own[np.argmax(own[:, 5 + colour])], values, np.inf
        for turn in TURNS:
            lamp = _usual_lamp(float(first[0]) + turn * np.pi, colour)
            lamp[5:] += first[5 + colour] - np.log(2.0)
            found, left = self._least(np.concatenate([own.ravel(), lamp, others]))
            best, least = (found, left) if left < least else (best, least)
            if self.unexplained(best).max() < UNEXPLAINED:
                break
        return best, least

    def parts(self, values: Floats) -> tuple[Floats, Floats]:
        """Parameters of the lamps (lamps, OWN), and the others."""
        many = (values.size - self.others) // OWN
        return values[: many * OWN].reshape(many, OWN), values[many * OWN :]

    def lamps(self, values: Floats) -> tuple[Lamp, ...]:
        found = []
        for own in self.parts(values)[0]:
            distance = float(np.exp(own[1])) * self.half_mm
            red, green, blue = np.exp(np.minimum(own[5:], BRIGHTEST))
            found.append(
                Lamp(
                    float(own[0]),
                    distance,
                    distance * float(np.exp(own[2])),
                    float(np.exp(own[3])) * self.half_mm,
                    float(own[4]) * self.half_mm,
                    (float(red), float(green), float(blue)),
                )
            )
        return tuple(found)

    def parameters(self, lamps: Lamps) -> Floats:
        """Parameters of these lamps and their camera, of a lens without fall-off."""
        own = [
            [
                lamp.azimuth_rad,
                np.log(lamp.distance_mm / self.half_mm),
                np.log(lamp.height_mm / lamp.distance_mm),
                np.log(lamp.length_mm / self.half_mm),
                lamp.aim_mm / self.half_mm,
                *np.log(np.maximum(lamp.colour, FAINTEST)),
            ]
            for lamp in lamps.lamps
        ]
        return np.concatenate([*own, [lamps.power], np.zeros(4)])

    def _light(self, lamp: Lamp) -> tuple[Floats, Floats]:
        """Its light on the balls (3, n), and upright on the untouched picture, whatever its colour."""
        plain = replace(lamp, colour=(0.0, 0.0, 0.0))
        if plain not in self.known:
            if len(self.known) > MAX_KNOWN:
                self.known.clear()
            self.known[plain] = lamp.light(self.x_mm, self.y_mm), lamp.light(self.free_x_mm, self.free_y_mm)[2]
        return self.known[plain]

    def of_balls(self, values: Floats) -> Floats:
        """Misfit (3, n) of the balls' pixels in stated deviations."""
        lamps = self.lamps(values)
        vectors = np.stack([self._light(lamp)[0] for lamp in lamps])
        seen = self._seen(lamps, vectors[:, 2], shading(vectors[:, :2] / vectors[:, 2:], *self.slopes))
        return self._off_balls(seen, power=float(self.parts(values)[1][0]))

    def _seen(self, lamps: tuple[Lamp, ...], upright: Floats, shades: npt.NDArray[np.floating]) -> Floats:
        """Light (3, n) of lamps that shine (lamps, n) upright, on slopes where each is a ratio (lamps, n)."""
        shares = light_shares(np.array([lamp.colour for lamp in lamps]).T, upright)
        return np.asarray(np.einsum("klN,lN->kN", shares, shades))

    def _off_balls(self, seen: Floats, *, power: float) -> Floats:
        std = np.hypot(STD_OF_BALLS[0] + STD_OF_BALLS[1] * np.hypot(*self.slopes), self.noise)
        return np.asarray((self.ratio - np.maximum(seen, 1e-3) ** (1.0 / power)) / std)

    def of_free(self, values: Floats) -> Floats:
        """Misfit (3, blocks) of the untouched picture in STD_OF_FREE."""
        lamps, others = self.lamps(values), self.parts(values)[1]
        light = np.stack([self._light(lamp)[1] for lamp in lamps])
        x, y, fall_off = self.free_x_mm / self.half_mm, self.free_y_mm / self.half_mm, others[1:5]
        lens = fall_off[0] + fall_off[1] * x + fall_off[2] * y + fall_off[3] * (x * x + y * y)
        shown = np.log(np.array([lamp.colour for lamp in lamps]).T @ light) + lens
        return np.asarray((self.free - shown / others[0]) / STD_OF_FREE)

    def unexplained(self, values: Floats) -> Floats:
        """Rms (3,) share of the untouched picture's light, by colour, that the lamps do not explain."""
        of_light = STD_OF_FREE * self.parts(values)[1][0]
        return np.asarray(of_light * np.sqrt(np.mean(self.of_free(values) ** 2, axis=1)))

    def residual(self, values: Floats) -> Floats:
        off, free = self.of_balls(values), self.of_free(values)
        balls = np.sign(off) * ROBUST * (np.sqrt(1.0 + 2.0 * np.abs(off) / ROBUST) - 1.0)
        weight = np.sqrt(10.0 * 6.0 / free.shape[1]), np.sqrt(600.0 / off.shape[1])  # as if so many told apart
        return np.concatenate([(weight[1] * balls).ravel(), (weight[0] * free).ravel(), self.priors(values)])

    def priors(self, values: Floats) -> Floats:
        found: list[float] = []
        lamps, others = self.parts(values)
        for own in lamps:
            pairs = zip(own[1:5], (PRIORS[name] for name in ("distance", "tangent", "length", "aim")), strict=True)
            found += [(value - mean) / std for value, (mean, std) in pairs]
            cross = np.delete(own[5:], np.argmax(own[5:])) - own[5:].max()
            found += list((cross - PRIOR_CROSS[0]) / PRIOR_CROSS[1])
        found.append((others[0] - PRIOR_POWER[0]) / PRIOR_POWER[1])
        return np.array([*found, *(others[2:5] / 0.1), 0.05 * lamps[:, 5].sum()])


def _usual_lamp(azimuth_rad: float, colour: int) -> Floats:
    """Parameters (OWN,) of a usual lamp of one colour on a side."""
    own = np.full(OWN, np.log(0.15))
    own[0] = azimuth_rad
    own[1:5] = [PRIORS[name][0] for name in ("distance", "tangent", "length", "aim")]
    own[5 + colour] = 0.0
    return own


def shading(
    leans: npt.NDArray[np.floating], p: npt.NDArray[np.floating], q: npt.NDArray[np.floating]
) -> npt.NDArray[np.floating]:
    """Light (lamps, ...) of each lamp on slopes p, q (...), a ratio, 1 on level gel; `leans` (lamps, 2, ...)."""
    turned = 1.0 - leans[:, 0] * p - leans[:, 1] * q
    facing = 0.5 * (turned + np.sqrt(turned**2 + SOFT**2))
    return np.asarray(facing / np.sqrt(1.0 + p * p + q * q), facing.dtype)


def light_shares(colours: Floats, upright: Floats) -> Floats:
    """Shares m (channels, lamps, ...) of colours (channels, lamps) and light (lamps, ...) on level gel."""
    light = colours.reshape(*colours.shape, *([1] * (upright.ndim - 1))) * upright[None]
    return np.asarray(light / light.sum(axis=1, keepdims=True))


def _directions(azimuth_rad: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Unit vectors towards a lamp and along its strip."""
    out = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad)])
    return out, np.array([-out[1], out[0]])
