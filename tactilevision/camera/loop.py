"""Frame after frame through a stream, as they come; what each says is handed on, and counted."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tactilevision.camera.sources import Shot
from tactilevision.door.cells import csv_text
from tactilevision.errors import InputError
from tactilevision.live import EDGES_MS, Moment, Stream
from tactilevision.records import Frame

AXES = ("x", "y", "z")
COLUMNS = (
    *("frame", "time_s", "contact", "peak_mm"),
    *(f"f{axis}_N" for axis in AXES),
    *(f"f{axis}_std_N" for axis in AXES),
    *(f"m{axis}_Nmm" for axis in AXES),
    *("age_ms", "flags"),
)
KEPT = 2000  # ages of the last frames, from which the 95th percentile is taken


@dataclass(frozen=True, slots=True)
class Told:
    """One frame: its shot, its moment, and `age_ms` from when it came until all was known."""

    shot: Shot
    moment: Moment
    age_ms: float

    def as_row(self) -> str:
        """A line of live.csv; what is not known is left empty."""
        moment, wrench = self.moment, self.moment.wrench
        force = (*wrench.force_N, *wrench.force_std_N, *wrench.moment_Nmm) if wrench else (math.nan,) * 9
        numbers = (moment.peak_mm, *force, self.age_ms)
        cells = [f"{number:.6g}" if math.isfinite(number) else "" for number in numbers]
        row = [
            self.shot.name,
            f"{self.shot.time_s:.6f}",
            int(moment.contact),
            *cells,
            " ".join(moment.height.flags),
        ]
        return csv_text([row])


@dataclass
class Counts:
    """What a loop has done: frames read, how many have each flag, `refused` with the last reason, ages in ms."""

    read: int = 0
    refused: int = 0
    why: str = ""
    flags: Counter[str] = field(default_factory=Counter)
    histogram: np.ndarray[tuple[int], np.dtype[np.float64]] = field(
        default_factory=lambda: np.zeros(len(EDGES_MS))
    )
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
        """Frames read a second, since the beginning."""
        return self.read / max(time.monotonic() - self.began_s, 1e-9)

    @property
    def age95_ms(self) -> float:
        """The age that 95 of 100 of the last frames stay under; NaN before the first."""
        return float(np.percentile(self.ages_ms, 95)) if self.ages_ms else math.nan

    def lines(self) -> Sequence[str]:
        """The histogram of ages, a line for each step that holds frames."""
        top = max(self.histogram.max(), 1)
        rows = []
        for k, count in enumerate(self.histogram):
            if count:
                low, high = (EDGES_MS[k - 1] if k else 0.0), EDGES_MS[k]
                step = f"{low:5.4g} to {high:4.4g} ms" if math.isfinite(high) else f"{'over':>5} {low:7.4g} ms"
                rows.append(f"  {step} {int(count):7d} {'#' * max(1, round(40 * count / top))}")
        return rows


def run(shots: Iterable[Shot], stream: Stream, *, counts: Counts, tell: Callable[[Told], bool]) -> None:
    """Read shots until they end, or `tell` says False. A frame that cannot be read is counted, and passed over."""
    counts.began_s = time.monotonic()
    for shot in shots:
        try:
            moment = stream.take(Frame(shot.rgb, shot.time_s, shot.name))
        except InputError as fault:
            counts.refused, counts.why = counts.refused + 1, fault.what
            continue
        age_ms = 1e3 * (time.monotonic() - shot.time_s)
        counts.add(age_ms, moment.height.flags)
        if not tell(Told(shot, moment, age_ms)):
            break
