"""Depth and force of many presses as flat arrays, with the conditions recorded with them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import accumulate
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Bools, Curve, Floats
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

# Depth and force of many presses as flat arrays, with everything that was recorded beside them.
#
# A sample is one reading of depth and force; a press is one touch of one indenter. Points have one sample a press,
# curves have many. Several recordings of one sensor stand in one Observations, ordered in time.

Ints = npt.NDArray[np.int64]
DepthSource = Literal["vision", "stage", "gauge"]
DAY_S = 86400.0  # s in a day


class RecordingLike(Protocol):
    """What is used of a recording; tactilevision.recording.Recording has it all."""

    @property
    def name(self) -> str: ...
    @property
    def date(self) -> object: ...
    @property
    def sensor(self) -> Sensor: ...
    @property
    def force_std_N(self) -> tuple[float, float, float] | None: ...
    @property
    def depth_source(self) -> str | None: ...
    @property
    def depth_std_mm(self) -> float | None: ...
    @property
    def indenters(self) -> Mapping[str, Indenter]: ...
    @property
    def presses(self) -> tuple[Press, ...]: ...


@dataclass(frozen=True, slots=True)
class Presses:
    """One entry a press, (M,) each; NaN where it was not recorded.

    `recording` and `indenter` are indices; `x_mm`, `y_mm` the place on the pad; `rest_s` how long the gel was free
    before; `day` days since the first press, over all recordings; `order` counts the presses in time;
    `lubricated` 0 or 1.
    """

    label: tuple[str, ...]
    recording: Ints
    indenter: Ints
    radius_mm: Floats
    x_mm: Floats
    y_mm: Floats
    rest_s: Floats
    speed_mm_s: Floats
    hold_s: Floats
    temperature_C: Floats
    lubricated: Floats
    day: Floats
    order: Floats

    def take(self, keep: Ints) -> Presses:
        """The presses of these indices, in this order."""
        arrays = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name != "label"}
        return Presses(label=tuple(self.label[k] for k in keep), **arrays)


@dataclass(frozen=True, slots=True)
class Shared:
    """What all certified depths have wrong together, as std: an offset `touch_mm` (when a touch is seen, over the
    shape of the dent that it makes) and a relative error `rise` (how far the gel rises to meet the bevel; the
    scale of the ruler that the touches lie on). `heights`: whether each machined height has an error of its own,
    which on a ruler is part of that scale.
    """

    touch_mm: float = 0.0
    rise: float = 0.0
    heights: bool = True


@dataclass(frozen=True, slots=True)
class EdgeDrop:
    """How far the gel falls away beside the face of one press as the picture reads it, at the certified depth.

    `press` is its label in the recording of this number; `fall_mm` from `from_mm` to `to_mm` beside the edge, in
    the quarter about `azimuth_deg` (0 right, 90 down); `gain_std` the relative std of a quarter's slopes,
    `ball_slope` the steepest slope that the light was made from.
    """

    recording: int
    press: str
    azimuth_deg: float
    from_mm: float
    to_mm: float
    fall_mm: float
    gain_std: float
    ball_slope: float


@dataclass(frozen=True, slots=True)
class Slopes:
    """Of samples of a picture, (N,) each: the expected slope of one beside a face, the certified depth that it is
    of (no zero of the map moves a slope), its azimuth, where it begins beside the edge, the relative std of a
    quarter's slopes, the steepest slope that the light was made from, and the relative changes of what is expected
    for a std of nu and without friction; NaN for a face itself, which stands behind walls.
    """

    slope: Floats
    depth_mm: Floats
    azimuth_deg: Floats
    from_mm: Floats
    gain_std: Floats
    ball_slope: Floats
    nu_change: Floats
    friction_change: Floats

    def take(self, rows: Ints) -> Slopes:
        """Those of some samples."""
        return Slopes(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """All samples of all presses: `press` (N,) the press's index, the other arrays (N,), `force_N` (N, 3).

    `time_s` is the recordings' common clock (seconds since the first recording's day); samples of one press stand
    together and grow in time. `phase`: "free", "load", "hold", "unload" or "". `depth_std_mm`, `force_std_N` (N,):
    one sample's own noise, NaN where nobody stated it; errors shared by all presses of an indenter are not in it
    but in `indenters`. `reconstructed_mm` (N,): the depth that the picture gives, beside a certified one, and the
    height map's own std of it. `falls`: what it reads of the gel beside. `slopes`: where the samples are such.
    `depth_over_force_noise`: a depth's std over a force's, mm/N, where neither was stated and it was estimated.
    `off_mm` (N,) or 0: the depth that the law is taken at, less the one read, by which effects remember.
    One is equal to itself alone, so that what follows from it can be kept.
    """

    gel: Gel
    indenters: tuple[Indenter, ...]
    presses: Presses
    press: Ints
    time_s: Floats
    depth_mm: Floats
    force_N: Floats
    phase: npt.NDArray[np.str_]
    temperature_C: Floats
    depth_std_mm: Floats
    force_std_N: Floats
    depth_source: DepthSource = "vision"
    reconstructed_mm: Floats | None = None
    reconstructed_std_mm: Floats | None = None
    falls: tuple[EdgeDrop, ...] = ()
    slopes: Slopes | None = None
    depth_over_force_noise: float = 0.0
    off_mm: Floats | float = 0.0
    recordings: tuple[str, ...] = ("",)
    shared: Shared = field(default=Shared())
    warnings: tuple[str, ...] = field(default=())

    @property
    def size(self) -> int:
        """The number of samples."""
        return int(self.press.size)

    @property
    def count(self) -> int:
        """The number of presses."""
        return len(self.presses.label)

    @property
    def normal_N(self) -> Floats:
        """The normal force (N,)."""
        return self.force_N[:, 2]

    @property
    def radius_mm(self) -> Floats:
        """The indenter's radius at each sample (N,)."""
        return np.asarray(self.presses.radius_mm[self.press])

    @property
    def edge_mm(self) -> Floats:
        """By how much the indenter's edge is rounded at each sample (N,), as stated; 0 where nothing is."""
        stated = np.array([indenter.edge_radius_mm or 0.0 for indenter in self.indenters])
        return np.asarray(stated[self.presses.indenter[self.press]])

    @property
    def lubricated(self) -> bool:
        """Whether all presses were."""
        return bool(np.all(self.presses.lubricated == 1))

    @property
    def is_curves(self) -> bool:
        """True where presses hold more than one sample."""
        return self.size > self.count

    @property
    def first(self) -> Ints:
        """Index (M,) of the first sample of each press."""
        return np.searchsorted(self.press, np.arange(self.count))

    def take(self, presses: Bools | Ints | Sequence[int]) -> Observations:
        """Only these presses (a mask or indices); the indenters and the gel stay."""
        chosen = np.asarray(presses)
        keep = np.flatnonzero(chosen) if chosen.dtype == bool else chosen.astype(np.int64)
        number = np.full(self.count, -1)
        number[keep] = np.arange(keep.size)
        rows = np.flatnonzero(number[self.press] >= 0)
        rows = rows[np.argsort(number[self.press[rows]], kind="stable")]
        return self._rows(rows, press=number[self.press[rows]], presses=self.presses.take(keep))

    def at(self, press: Ints) -> Observations:
        """Of points: a sample for each of these presses (N,), which may come again and grow."""
        return self._rows(press, press=press, presses=self.presses)

    def samples(self, keep: Bools) -> Observations:
        """Only these samples; presses that lose all of theirs leave too."""
        rows = np.flatnonzero(keep)
        left, press = np.unique(self.press[rows], return_inverse=True)
        return self._rows(rows, press=press.astype(np.int64), presses=self.presses.take(left))

    def shifted(self, depth_mm: Floats | float) -> Observations:
        """The same with the depth moved: for derivatives with respect to the depth."""
        return replace(self, depth_mm=self.depth_mm + depth_mm)

    def with_force(self, normal_N: Floats) -> Observations:
        """The same with another normal force: for simulated measurements."""
        return replace(self, force_N=np.column_stack([self.force_N[:, :2], normal_N]))

    def _rows(self, rows: Ints, *, press: Ints, presses: Presses) -> Observations:
        names = ("time_s", "depth_mm", "force_N", "phase", "temperature_C", "depth_std_mm", "force_std_N")
        arrays = {name: getattr(self, name)[rows] for name in names}
        for name in ("reconstructed_mm", "reconstructed_std_mm", "off_mm"):
            if isinstance(getattr(self, name), np.ndarray):
                arrays[name] = getattr(self, name)[rows]
        if self.slopes is not None:
            arrays["slopes"] = self.slopes.take(rows)
        return replace(self, press=press, presses=presses, **arrays)


@dataclass(frozen=True, slots=True)
class Measured:
    """One recording with the points or the curves to be taken from it."""

    recording: RecordingLike
    points: tuple[CertifiedPoint, ...] = ()
    curves: tuple[Curve, ...] = ()


def as_sets(measured: Measured | Sequence[Measured]) -> list[Measured]:
    """One or several, as a list. Raises InputError for anything else, as a bare recording or arrays."""
    given: Any = measured
    several = list(given) if isinstance(given, Iterable) and not isinstance(given, Measured) else [given]
    for one in several:
        if not isinstance(one, Measured):
            raise InputError(
                "this takes Measured(recording, points, curves), one or several",
                value=type(one).__name__,
                remedy="Of a recording: Measured(recording, recording.points, recording.curves).",
            )
    return several


# Presses by name, and measurements without some of them: what a person judges to be an accident.


def press_names(data: Observations) -> tuple[str, ...]:
    """One name a press: its label, with the recording's name before it where the label comes twice.

    Of recordings of one name the later ones have their number behind it.
    """
    labels, numbers = data.presses.label, data.presses.recording
    twice = {label for label, count in Counter(labels).items() if count > 1}
    folders = [
        name if name not in data.recordings[:k] else f"{name} {k + 1}" for k, name in enumerate(data.recordings)
    ]
    return tuple(
        f"{folders[int(k)]}/{label}" if label in twice else label for label, k in zip(labels, numbers, strict=True)
    )


def leave_out(data: Observations, presses: Sequence[str]) -> Observations:
    """The measurements without these presses. Raises InputError for a press that is not there, and for all."""
    names = press_names(data)
    unknown = [press for press in presses if press not in names]
    if unknown:
        raise InputError(
            "there is no such press to leave out",
            where="--leave-out",
            value=unknown[0],
            remedy=f"There are {', '.join(names[:12])}{' ...' if len(names) > 12 else ''}.",
        )
    kept = np.array([name not in presses for name in names])
    if not kept.any():
        raise InputError("no press is left", where="--leave-out", remedy="Keep some.")
    return data if kept.all() else data.take(kept)


# Several sets of measurements on one gel as one.

OF_SAMPLES = ("time_s", "depth_mm", "force_N", "phase", "temperature_C", "depth_std_mm", "force_std_N")


def join(*sets: Observations) -> Observations:
    """The presses of these sets in turn, indenters and order renumbered; what a picture read is left out."""
    indenters = tuple(indenter for one in sets for indenter in one.indenters)
    first_indenter = accumulate((len(one.indenters) for one in sets), initial=0)
    first_press = accumulate((one.count for one in sets), initial=0)

    def whole(name: str) -> Floats:
        return np.concatenate([getattr(one.presses, name) for one in sets])

    kept: dict[str, Any] = {
        f.name: whole(f.name) for f in fields(Presses) if f.name not in ("label", "indenter", "order")
    }
    presses = Presses(
        label=tuple(label for one in sets for label in one.presses.label),
        indenter=np.concatenate([one.presses.indenter + k for one, k in zip(sets, first_indenter, strict=False)]),
        order=np.arange(float(sum(one.count for one in sets))),
        **kept,
    )
    press = np.concatenate([one.press + k for one, k in zip(sets, first_press, strict=False)])
    samples: dict[str, Any] = {name: np.concatenate([getattr(one, name) for one in sets]) for name in OF_SAMPLES}
    return replace(
        sets[0], indenters=indenters, presses=presses, press=press,
        reconstructed_mm=None, reconstructed_std_mm=None, falls=(), slopes=None, **samples,
    )  # fmt: skip


# What a press adds at random where its data do not tell: the size of gain and zero on a usual rig.

TYPICAL_GAIN = 0.005  # relative force from press to press; centre of the weak prior, which fades with repeats
TYPICAL_ZERO_MM = 0.004  # mm: scatter of a press's zero of depth; centre of the weak prior likewise
TYPICAL_FORCE_N = 0.005  # N: noise of one force reading where none is stated; as the sample recordings state it
