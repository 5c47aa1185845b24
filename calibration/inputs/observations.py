"""Depth and force of many presses as flat arrays, with the conditions recorded with them.

A sample is one reading of depth and force, a press one contact of one indenter. Points have one sample a press,
curves many. One Observations holds several recordings of one sensor, ordered in time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.measured import Bools, Curve, Floats
from tactilevision.records.rig import Gel, Indenter

if TYPE_CHECKING:
    from tactilevision.recording.model import Recording

Ints = npt.NDArray[np.int64]
DepthSource = Literal["vision", "stage", "gauge"]
DAY_S = 86400  # s in a day
OF_SAMPLES = ("time_s", "depth_mm", "force_N", "phase", "temperature_C", "depth_std_mm", "force_std_N")
SAME_TIME = 0.25  # share of the steps between samples that may take no time
TYPICAL_GAIN = 0.005  # relative force from press to press; centre of a weak prior
TYPICAL_ZERO_MM = 0.004  # mm, std of a press's zero of depth; centre of a weak prior
TYPICAL_FORCE_N = 0.005  # N, noise of one force reading where none is stated


@dataclass(frozen=True, slots=True)
class Presses:
    """Conditions of each press, (M,); NaN where not recorded.

    `recording` and `indenter` are indices; `x_mm`, `y_mm` the place on the pad; `rest_s` the time without contact
    before; `day` in days since the first press of all recordings; `order` counts the presses in time; `lubricated`
    is 0 or 1.
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
        """Return the presses of these indices, in this order."""
        arrays = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name != "label"}
        return Presses(label=tuple(self.label[k] for k in keep), **arrays)


@dataclass(frozen=True, slots=True)
class Shared:
    """Errors that all certified depths share, as std: an offset `touch_mm` and a relative error `rise`.

    The offset is in the detection of a touch, the relative error in the gel's rise at the bevel and in the scale
    of the ruler on which the touches lie. `heights`: each machined height has an error of its own; on a ruler it
    is part of that scale.
    """

    touch_mm: float = 0.0
    rise: float = 0.0
    heights: bool = True


@dataclass(frozen=True, slots=True)
class EdgeDrop:
    """Fall of the gel's surface next to the face of one press in the height map, at the certified depth.

    `press` is its label in the recording of this number; `fall_mm` from `from_mm` to `to_mm` from the edge, in the
    quarter about `azimuth_deg` (0 right, 90 down); `gain_std` the relative std of a quarter's slopes, `ball_slope`
    the steepest slope of the light's calibration.
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
    """Slopes next to faces, (N,) each; NaN for samples of a face itself.

    `slope` is the expected one and `depth_mm` its certified depth (which no zero of the map shifts); `azimuth_deg`
    and `from_mm` its place about and from the edge; `gain_std` the relative std of a quarter's slopes,
    `ball_slope` the steepest slope of the light's calibration; `nu_change` and `friction_change` the relative
    changes of the expected slope for a std of nu and without friction.
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
        """Return those of some samples."""
        return Slopes(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


@dataclass(frozen=True, slots=True)
class Resultants:
    """Normal forces that the inverse step computed from pictures, (N,) each.

    `force_N` at the gel's stated E and thickness and at `depth_mm`; `of_depth` and `of_thickness` its logarithmic
    derivatives; `cut` the share of the contact's outline on the picture's border; `std` the relative std of
    the solver alone.
    """

    force_N: Floats
    std: Floats
    depth_mm: Floats
    of_depth: Floats
    of_thickness: Floats
    cut: Floats

    def take(self, rows: Ints) -> Resultants:
        """Return those of some samples."""
        return Resultants(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @classmethod
    def joined(cls, parts: Sequence[Resultants]) -> Resultants:
        """Return those of several presses, one after the other."""
        return cls(**{f.name: np.concatenate([getattr(one, f.name) for one in parts]) for f in fields(cls)})


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """All samples of all presses: `press` (N,) the press's index, the other arrays (N,), `force_N` (N, 3).

    `time_s` is the recordings' common clock (seconds since the first recording's day); samples of one press are
    contiguous and ordered in time. `phase`: "free", "load", "hold", "unload" or "". `depth_std_mm`, `force_std_N`:
    one sample's own noise, NaN where not stated, without the errors shared by an indenter's presses (in
    `indenters`). `reconstructed_mm`: the height map's depth where another is certified, with its std. `falls`: its
    surface outside the contact; `slopes`: where samples are slopes; `resultants`: where the force of each sample
    was computed from its picture as well. `depth_over_force_noise`: a depth's std over a force's, mm/N, estimated
    where neither was stated. `off_mm` (N,) or 0: the depth at which the law is evaluated less the one read, which
    effects of history use. `rounded_mm` (N,): the depths less their course in time where they are read in steps.
    Compared by identity, so that derived tables can be cached.
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
    resultants: Resultants | None = None
    depth_over_force_noise: float = 0.0
    off_mm: Floats | float = 0.0
    rounded_mm: Floats | float = 0.0
    recordings: tuple[str, ...] = ("",)
    shared: Shared = field(default=Shared())
    warnings: tuple[str, ...] = field(default=())

    @property
    def size(self) -> int:
        """Number of samples."""
        return int(self.press.size)

    @property
    def count(self) -> int:
        """Number of presses."""
        return len(self.presses.label)

    @property
    def normal_N(self) -> Floats:
        """Normal force (N,)."""
        return self.force_N[:, 2]

    @property
    def radius_mm(self) -> Floats:
        """Indenter's radius at each sample (N,)."""
        return np.asarray(self.presses.radius_mm[self.press])

    @property
    def edge_mm(self) -> Floats:
        """Stated edge radius of the indenter at each sample (N,); 0 where none is stated."""
        stated = np.array([indenter.edge_radius_mm or 0.0 for indenter in self.indenters])
        return np.asarray(stated[self.presses.indenter[self.press]])

    @property
    def lubricated(self) -> bool:
        """Whether all presses were lubricated."""
        return bool(np.all(self.presses.lubricated == 1))

    @property
    def is_curves(self) -> bool:
        """Whether presses have more than one sample."""
        return self.size > self.count

    @property
    def is_timed(self) -> bool:
        """Whether presses are curves whose samples all have times that grow with them."""
        known = self.is_curves and bool(np.isfinite(self.time_s).all())
        return known and not any(stand_still(self.time_s[one]) for one in self.spans)

    @property
    def first(self) -> Ints:
        """Index (M,) of the first sample of each press."""
        return np.searchsorted(self.press, np.arange(self.count))

    @property
    def spans(self) -> list[slice]:
        """Samples of each press, M slices."""
        first = self.first.tolist()
        return [slice(begin, end) for begin, end in zip(first, [*first[1:], self.size], strict=True)]

    def take(self, presses: Bools | Ints | Sequence[int]) -> Observations:
        """Return these presses (a mask or indices) with all indenters and the gel."""
        chosen = np.asarray(presses)
        keep = np.flatnonzero(chosen) if chosen.dtype == bool else chosen.astype(np.int64)
        number = np.full(self.count, -1)
        number[keep] = np.arange(keep.size)
        rows = np.flatnonzero(number[self.press] >= 0)
        rows = rows[np.argsort(number[self.press[rows]], kind="stable")]
        return self._rows(rows, press=number[self.press[rows]], presses=self.presses.take(keep))

    def at(self, press: Ints) -> Observations:
        """Return a sample (of points) for each of these presses (N,), in rising order, repeats allowed."""
        return self._rows(press, press=press, presses=self.presses)

    def samples(self, keep: Bools) -> Observations:
        """Return these samples and the presses that have any."""
        rows = np.flatnonzero(keep)
        left, press = np.unique(self.press[rows], return_inverse=True)
        return self._rows(rows, press=press.astype(np.int64), presses=self.presses.take(left))

    def shifted(self, depth_mm: Floats | float) -> Observations:
        """Return the data with the depth shifted, for derivatives with respect to it."""
        return replace(self, depth_mm=self.depth_mm + depth_mm)

    def warned(self, *warnings: str) -> Observations:
        """Return the data with more warnings."""
        return replace(self, warnings=(*self.warnings, *warnings))

    def with_force(self, normal_N: Floats) -> Observations:
        """Return the data with another normal force, for simulated measurements."""
        return replace(self, force_N=np.column_stack([self.force_N[:, :2], normal_N]))

    def _rows(self, rows: Ints, *, press: Ints, presses: Presses) -> Observations:
        names = (*OF_SAMPLES, "reconstructed_mm", "reconstructed_std_mm", "off_mm", "rounded_mm")
        given = {name: getattr(self, name) for name in names}
        arrays: dict[str, Any] = {
            name: array[rows] for name, array in given.items() if isinstance(array, np.ndarray)
        }
        for name in ("slopes", "resultants"):
            given_too = getattr(self, name)
            arrays |= {} if given_too is None else {name: given_too.take(rows)}
        return replace(self, press=press, presses=presses, **arrays)


def stand_still(time_s: Floats) -> bool:
    """Return whether more than a quarter of the samples of a press have the time (n,), s, of the one before."""
    return bool(np.mean(np.diff(time_s) <= 0) > SAME_TIME) if time_s.size > 1 else False


@dataclass(frozen=True, slots=True)
class Measured:
    """One recording with the points or the curves to use."""

    recording: Recording
    points: tuple[CertifiedPoint, ...] = ()
    curves: tuple[Curve, ...] = ()


def as_sets(measured: Measured | Sequence[Measured]) -> list[Measured]:
    """Return one or several as a list. Raises InputError for anything else, as a bare recording or arrays."""
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


def press_names(data: Observations) -> tuple[str, ...]:
    """Return one name a press: its label, preceded by the recording's name where the label occurs twice.

    Later recordings of the same name are numbered.
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
    """Return the data without these presses. Raises InputError for an unknown press, and where none remains."""
    names = press_names(data)
    unknown = [press for press in presses if press not in names]
    if unknown:
        raise InputError(
            "there is no such press to exclude",
            where="--leave-out",
            value=unknown[0],
            remedy=f"There are {', '.join(names[:12])}{' ...' if len(names) > 12 else ''}.",
        )
    kept = np.array([name not in presses for name in names])
    if not kept.any():
        raise InputError("every press is excluded", where="--leave-out", remedy="Keep some.")
    return data if kept.all() else data.take(kept)


def join(*sets: Observations) -> Observations:
    """Return the presses of these sets in turn, indenters and order renumbered, without data of pictures."""
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
        reconstructed_mm=None, reconstructed_std_mm=None, falls=(), slopes=None, resultants=None, **samples,
    )  # fmt: skip
