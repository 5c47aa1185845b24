"""Opens the truth and compares: one Result a case and analyst, the confusion matrix, the table of targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.blind.analyst import Finding
from benchmarks.blind.cases import SEEN, Case
from benchmarks.blind.world import HIDDEN


@dataclass(frozen=True, slots=True)
class Result:
    """What was true and what was said. `strength` of each hidden effect; `rivals` within 3 sigma of it."""

    case: Case
    strength: dict[str, float]
    rivals: tuple[str, ...]
    modulus_MPa: float
    finding: Finding

    @property
    def hidden(self) -> tuple[str, ...]:
        """Keys of what was hidden."""
        return self.case.hidden

    @property
    def clear(self) -> bool:
        """Everything hidden shows by more than the targets ask."""
        return all(size > SEEN for size in self.strength.values())

    @property
    def outside(self) -> bool:
        """Something was hidden that no catalogue has."""
        return any(not HIDDEN[key].catalogued for key in self.hidden)

    @property
    def clean(self) -> bool:
        """Nothing was hidden."""
        return not self.hidden

    @property
    def single(self) -> bool:
        """One effect of the catalogue was hidden, strongly enough."""
        return len(self.hidden) == 1 and not self.outside and self.clear

    @property
    def first(self) -> str:
        """The answer as one word: the first effect named, or the verdict where none is."""
        return self.finding.named[0] if self.finding.named else self.finding.verdict

    @property
    def modulus_error(self) -> float:
        """Relative error of E; NaN where none is given."""
        value = self.finding.modulus_MPa
        return float("nan") if value is None else value / self.modulus_MPa - 1

    @property
    def covered(self) -> bool:
        """The interval of E holds the truth."""
        low, high = self.finding.interval_MPa or (np.nan, np.nan)
        return bool(low <= self.modulus_MPa <= high)

    @property
    def within(self) -> bool:
        """The truth lies within 1.96 std of E: the statistical part of the interval alone."""
        value, std = self.finding.modulus_MPa, self.finding.std_MPa
        return value is not None and abs(value - self.modulus_MPa) <= 1.96 * std

    @property
    def found(self) -> bool:
        """All that was hidden was named."""
        return set(self.hidden) <= set(self.finding.named)


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the targets' table: what, what is asked, what came out, of how many."""

    what: str
    target: str
    value: float
    size: int

    def text(self) -> str:
        """The figure in per cent, or as it is where the target is no share."""
        if not self.size:
            return "-"
        shown = f"{100 * self.value:.0f} %" if "%" in self.target else f"{self.value:.3g}"
        return f"{shown} of {self.size}"


def targets(results: Sequence[Result]) -> list[Line]:
    """The targets of the diagnosis; rich design, nominal white noise, the straight gel, signal over noise
    above 8.
    """
    rich = [r for r in results if r.case.name.startswith("rich-one-white-law")]
    clean, single = [r for r in rich if r.clean], [r for r in rich if r.single]
    pairs = [r for r in rich if len(r.hidden) == 2 and r.clear]
    outside = [r for r in rich if r.outside and r.clear]
    rivals = [r for r in single if r.rivals]
    known, right = [*clean, *single, *pairs], [r for r in (*clean, *single, *pairs) if r.found]
    return [
        _line("named though nothing is hidden", "3-7 %", clean, lambda r: bool(r.finding.named)),
        _line("truth in the returned set", ">= 95 %", single, lambda r: r.hidden[0] in r.finding.candidates),
        _line("size of the set, mean", "<= 1.5", single, lambda r: len(r.finding.candidates)),
        _line("truth in first place", ">= 90 %", single, lambda r: r.first == r.hidden[0]),
        _line("AMBIGUOUS where d < 3", ">= 90 %", rivals, lambda r: r.finding.verdict == "AMBIGUOUS"),
        _line("confidently wrong", "<= 2 %", single, _confidently_wrong),
        _line("two hidden: both found", ">= 75 %", pairs, lambda r: set(r.hidden) <= set(r.finding.candidates)),
        _line("two hidden: at least one", ">= 97 %", pairs,
              lambda r: bool(set(r.hidden) & set(r.finding.candidates))),
        _line("outside the catalogue: UNKNOWN", ">= 90 %", outside, lambda r: r.finding.verdict == "UNKNOWN"),
        _line("outside the catalogue: wrongly named", "<= 5 %", outside, _named_and_sure),
        _line("false UNKNOWN", "<= 5 %", known, lambda r: r.finding.verdict == "UNKNOWN"),
        _line("95 % interval of E holds the truth", "90-98 %", right, lambda r: r.covered),
        _line("E +- 1.96 std holds the truth", "90-98 %", [r for r in right if np.isfinite(r.finding.std_MPa)],
              lambda r: r.within),
        _line("E off after adding, median", "< 1 %", right, lambda r: abs(r.modulus_error), middle=True),
        _line("held-out error over the floor, median", "<= 1.1", right,
              lambda r: r.finding.held_out_N / r.finding.floor_N, middle=True),
        _line("seconds a diagnosis, longest", "< 30", rich, lambda r: r.finding.seconds, middle=None),
        _line("raised instead of answering", "0 %", rich, lambda r: bool(r.finding.failed)),
    ]  # fmt: skip


def confusion(results: Sequence[Result]) -> dict[str, Counter[str]]:
    """What was hidden (alone or not at all, in the rich design) -> how often each answer came first."""
    table: dict[str, Counter[str]] = {}
    for result in results:
        if len(result.hidden) <= 1 and result.case.design == "rich":
            table.setdefault(result.hidden[0] if result.hidden else "nothing", Counter())[result.first] += 1
    return table


def by_setting(results: Sequence[Result]) -> list[tuple[str, list[Line]]]:
    """The few figures that other designs, noise levels, wrong noise and the finite elements' gel are judged by."""
    groups: dict[str, list[Result]] = {}
    for r in results:
        groups.setdefault(r.case.name.rsplit("-", 1)[0], []).append(r)
    return [(name, _few(group)) for name, group in groups.items()]


def _few(group: Sequence[Result]) -> list[Line]:
    clean, single = [r for r in group if r.clean], [r for r in group if r.single]
    return [
        _line("named, none hidden", "3-7 %", clean, lambda r: bool(r.finding.named)),
        _line("false UNKNOWN", "<= 5 %", [*clean, *single], lambda r: r.finding.verdict == "UNKNOWN"),
        _line("truth in set", ">= 95 %", single, lambda r: r.hidden[0] in r.finding.candidates),
        _line("confidently wrong", "<= 2 %", single, _confidently_wrong),
    ]


def _confidently_wrong(result: Result) -> bool:
    return result.finding.verdict == "IDENTIFIED" and result.first not in result.hidden


def _named_and_sure(result: Result) -> bool:
    return result.finding.verdict != "UNKNOWN" and bool(result.finding.named)


def _line(
    what: str,
    target: str,
    results: Sequence[Result],
    of: Callable[[Result], float],
    *,
    middle: bool | None = False,
) -> Line:
    """The mean of a figure over results; `middle` the median, None the largest."""
    values = np.array([float(of(r)) for r in results if not r.finding.failed or "raised" in what])
    values = values[np.isfinite(values)]
    if not values.size:
        return Line(what, target, float("nan"), 0)
    value = np.max(values) if middle is None else np.median(values) if middle else np.mean(values)
    return Line(what, target, float(value), int(values.size))
