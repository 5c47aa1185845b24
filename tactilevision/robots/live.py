"""Streams: one frame at a time for a control loop, and the loop that counts and reports them."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.contact.footprint import find_footprint
from tactilevision.contact.region import (
    contact_flags,
    in_question,
    map_noise_mm,
    strong_evidence,
    untouched_std,
)
from tactilevision.errors import InputError
from tactilevision.files.documents import csv_text
from tactilevision.force.patches import PatchTracker
from tactilevision.heightmap.ball_validation import check_fit
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.records.constants import KILO, TINY
from tactilevision.records.contact_thresholds import CONTACT, live_limit_mm
from tactilevision.records.maps import LIGHT, Footprint, Frame, HeightMap, TractionMap, add
from tactilevision.records.measured import Bytes, Floats
from tactilevision.records.rig import Indenter
from tactilevision.records.wrench import COMPONENTS, PATCH_COLUMNS, STDS, Patch, Wrench
from tactilevision.robots.camera import Shot
from tactilevision.robust import median

if TYPE_CHECKING:
    from tactilevision.profile.sensor import CalibratedSensor

# A stream keeps only a running mean of the reference, so that it may run for days.

SAMPLE_PX = 2  # every second pixel along each side is used
RENEW = 0.002  # a frame, of the running mean: 5 s at 90 frames a second; lamps warm in minutes, presses take less


@dataclass(frozen=True, slots=True)
class Moment:
    """Result of one frame: its map, whether there is `contact`, and the greatest depth `peak_mm` there, else 0.

    `least_mm` is the depth from which a contact is detected in half of the picture. `footprint` is None without
    contact or without an indenter; `latency_ms` from frame to result. `tractions` and `wrench` are None where E
    and nu are not known, and where the force could not be solved.
    """

    height: HeightMap
    contact: bool
    peak_mm: float
    footprint: Footprint | None
    latency_ms: float
    least_mm: float
    tractions: TractionMap | None = None

    @property
    def wrench(self) -> Wrench | None:
        """Return force and moment."""
        return None if self.tractions is None else self.tractions.wrench

    @property
    def patches(self) -> tuple[Patch, ...]:
        """Return the contact patches, whose numbers the stream keeps over frames; none where no force is known."""
        return () if self.tractions is None else self.tractions.patches


class Stream:
    """Read frames one after another, each into a `Moment`. Not thread-safe.

    `source` is a reconstructor, or a calibrated sensor (`load_sensor`), which also gives the force. `indenter`:
    its face is sought in contacts; None: contact alone. `renew` is the share by which each frame without contact
    renews the reference, so that slow changes of light and temperature are followed; 0 keeps it. A press that
    moves by v mm a frame is detected late, or never, where v / renew is below the noise of depth (some 10 um).

    Raises InputError for a calibration that fails on held-out balls, unless `even_so`.
    """

    def __init__(
        self,
        source: Reconstructor | CalibratedSensor,
        indenter: Indenter | None = None,
        renew: float = RENEW,
        *,
        even_so: bool = False,
    ) -> None:
        if not 0.0 <= renew <= 1.0:
            raise InputError("must be from 0 to 1", where="Stream renew", value=renew)
        self.sensor = None if isinstance(source, Reconstructor) else source
        reader = source if isinstance(source, Reconstructor) else source.reconstructor
        self.reconstructor = reader.independent() if renew > 0 else reader  # a stream's reference is its own
        method = self.reconstructor.referenced
        if method is not None and not even_so:
            check_fit(method.card, remedy="Stream(..., even_so=True) or --even-so")
        self.indenter = indenter or (self.sensor.indenter if self.sensor else None)
        self.renew, self.frames = renew, 0
        self._last: Footprint | None = None
        self._numbered = PatchTracker()

    def take(self, frame: Frame) -> Moment:
        """Read the next frame. Raises InputError for one that cannot be read, after which the stream goes on."""
        if not isinstance(frame, Frame):
            raise InputError(
                "a stream takes frames, not arrays: Frame(rgb)", where="Stream.take", value=type(frame)
            )
        began = time.perf_counter()
        rgb = self.reconstructor.rectified(frame)
        if self.frames == 0:  # for all that come: it takes longer than a frame
            self.reconstructor = self.reconstructor.look([rgb])
        height = self.reconstructor.rectified_map(rgb, time_s=frame.time_s, name=frame.name)
        contact, peak_mm, least_mm, doubts = self._contact(height)
        if doubts:
            height = replace(height, flags=add(height.flags, doubts))
        self._last = find_footprint(height, self.indenter, prior=self._last) if contact and self.indenter else None
        tractions = None
        if self.sensor is not None:
            held = self.sensor.held(height, self._last)
            if held is not height:
                height, peak_mm = held, float(held.depth_mm[held.valid].max())
            tractions = self.sensor.tractions(height, rgb)
            tractions = None if tractions is None else self._numbered(tractions)
        known = LIGHT not in height.flags and least_mm < CONTACT.live_blind_mm
        if not contact and known and self.renew > 0:
            self.reconstructor.follow(rgb, self.renew)
        latency_ms = KILO * (time.perf_counter() - began)
        self.frames += 1
        return Moment(height, contact, peak_mm, self._last, latency_ms, least_mm, tractions)

    def look(self, pictures: Sequence[Bytes]) -> tuple[str, ...]:
        """As the sensor's `look`, by rectified `pictures` (H, W, 3); nothing where it has none."""
        if self.sensor is None:
            return ()
        said, seen = self.sensor.look(pictures), self.sensor.reconstructor.match
        if seen is not None and self.reconstructor.match is not None:
            seen = replace(seen, method=self.reconstructor.match.method)
        self.reconstructor = self.reconstructor.varied(match=seen).warned(*said)
        return said

    def _contact(self, height: HeightMap) -> tuple[bool, float, float, tuple[str, ...]]:
        """Return whether there is a contact, its depth, the depth detected in half of the picture, and flags."""
        sampled = _sampled(height)
        spread = untouched_std(sampled, self.reconstructor.error, noise_mm=map_noise_mm(height))
        if spread is None:
            spread = np.full(sampled.depth_mm.shape, CONTACT.live_unknown_std_mm)
        least_mm = CONTACT.live_sigma * float(median(np.where(sampled.valid, spread, np.inf)[::4, ::4].ravel()))
        pressed = (sampled.depth_mm > live_limit_mm(spread)) & sampled.valid
        if SAMPLE_PX**2 * np.count_nonzero(pressed) < CONTACT.live_min_px:
            pressed = in_question(sampled)
            pressed = pressed & strong_evidence(sampled) if pressed.any() else pressed
        if SAMPLE_PX**2 * np.count_nonzero(pressed) < CONTACT.live_min_px:
            return False, 0.0, least_mm, ()
        peak_mm = float(sampled.depth_mm[pressed].max())
        return True, peak_mm, least_mm, contact_flags(pressed, self.reconstructor.error)


def _sampled(height: HeightMap) -> HeightMap:
    """Return the map of every SAMPLE_PXth pixel."""
    x, y = height.mm_per_px
    return replace(
        height,
        depth_mm=height.depth_mm[::SAMPLE_PX, ::SAMPLE_PX],
        valid=height.valid[::SAMPLE_PX, ::SAMPLE_PX],
        mm_per_px=(SAMPLE_PX * x, SAMPLE_PX * y),
        std_mm=None if height.std_mm is None else height.std_mm[::SAMPLE_PX, ::SAMPLE_PX],
    )


# The loop over the frames of a stream.

# columns of live.csv, a line for each frame
COLUMNS = (
    *("frame", "time_s", "contact", "peak_mm"),
    *(*COMPONENTS[:3], *STDS[:3], *COMPONENTS[3:]),
    *("age_ms", "flags", *STDS[3:], "could_hide_N", "patches"),
)
OF_PATCHES = ("frame", "time_s", *PATCH_COLUMNS)
# ms: upper edges of the histogram of ages
EDGES_MS = np.array([0.5, 1, 1.5, 2, 3, 4, 6, 8, 11, 16, 32, 64, 125, 250, 500, 1000, np.inf])
KEPT = 2000  # ages of the last frames, from which the 95th percentile is taken


@dataclass(frozen=True, slots=True)
class LiveResult:
    """One frame of a loop: its shot, its moment, and `age_ms` from its arrival to the result."""

    shot: Shot
    moment: Moment
    age_ms: float

    def as_row(self) -> str:
        """Return a line of live.csv; unknown values are empty."""
        moment, wrench = self.moment, self.moment.wrench
        force, std, hidden = (math.nan,) * 9, (math.nan,) * 3, math.nan
        if wrench is not None and moment.tractions is not None:
            force, std = (*wrench.force_N, *wrench.force_std_N, *wrench.moment_Nmm), wrench.moment_std_Nmm
            hidden = moment.tractions.could_hide_N
        row = [
            self.shot.name,
            f"{self.shot.time_s:.6f}",
            int(moment.contact),
            *map(_cell, (moment.peak_mm, *force, self.age_ms)),
            " ".join(moment.height.flags),
            *map(_cell, (*std, hidden)),
            len(moment.patches) if wrench is not None else "",
        ]
        return csv_text([row])

    def patch_rows(self) -> str:
        """Return the lines of patches.csv, one for each patch; unknown values are empty."""
        about = (self.shot.name, f"{self.shot.time_s:.6f}")
        return csv_text([[*about, *map(_cell, one.row)] for one in self.moment.patches])


def _cell(number: float) -> str:
    return f"{number:.6g}" if math.isfinite(number) else ""


@dataclass
class Counts:
    """Counts of a loop: frames read, frames of each flag, `refused` with the last reason `why`, ages in ms."""

    read: int = 0
    refused: int = 0
    why: str = ""
    flags: Counter[str] = field(default_factory=Counter)
    histogram: Floats = field(default_factory=lambda: np.zeros(len(EDGES_MS)))
    ages_ms: list[float] = field(default_factory=list)
    began_s: float = field(default_factory=time.monotonic)

    def add(self, age_ms: float, flags: Iterable[str] = ()) -> None:
        """Count a frame that was read."""
        self.read += 1
        self.flags.update(flags)
        self.histogram[np.searchsorted(EDGES_MS, age_ms)] += 1
        self.ages_ms.append(age_ms)
        del self.ages_ms[:-KEPT]

    @property
    def rate_Hz(self) -> float:
        """Return frames read a second since the beginning."""
        return self.read / max(time.monotonic() - self.began_s, TINY)

    @property
    def age95_ms(self) -> float:
        """Return the 95th percentile of the ages of the last frames; NaN before the first."""
        return float(np.percentile(self.ages_ms, 95)) if self.ages_ms else math.nan

    def as_json(self) -> dict[str, object]:
        """Return the counts for a program."""
        return {
            "frames": self.read,
            "refused": self.refused,
            "rate_Hz": self.rate_Hz,
            "age95_ms": self.age95_ms,
            "flags": dict(self.flags),
            "histogram": [[float(edge), int(n)] for edge, n in zip(EDGES_MS, self.histogram, strict=True)],
        }

    def lines(self) -> Sequence[str]:
        """Return the histogram of ages, a line for each bin that holds frames."""
        top = max(self.histogram.max(), 1)
        rows = []
        for k, count in enumerate(self.histogram):
            if count:
                low, high = (EDGES_MS[k - 1] if k else 0.0), EDGES_MS[k]
                step = f"{low:5.4g} to {high:4.4g} ms" if math.isfinite(high) else f"{'over':>5} {low:7.4g} ms"
                rows.append(f"  {step} {int(count):7d} {'#' * max(1, round(40 * count / top))}")
        return rows


def run(shots: Iterable[Shot], stream: Stream, *, counts: Counts, report: Callable[[LiveResult], bool]) -> None:
    """Read shots until they end, or `report` returns False. Frames that cannot be read are counted and skipped."""
    counts.began_s = time.monotonic()
    for shot in shots:
        try:
            moment = stream.take(Frame(shot.rgb, shot.time_s, shot.name))
        except InputError as fault:
            counts.refused, counts.why = counts.refused + 1, fault.what
            continue
        age_ms = KILO * (time.monotonic() - shot.time_s)
        counts.add(age_ms, moment.height.flags)
        if not report(LiveResult(shot, moment, age_ms)):
            break
