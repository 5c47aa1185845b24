"""Every difference between two sets of named values that is larger than the stated tolerance."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.digest.values import Scalar, Value, Values


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far the values whose names match `pattern` may lie apart, and why; `absolute` in their own unit."""

    pattern: str
    relative: float
    absolute: float
    reason: str

    def allows(self, before: Scalar, after: Scalar, times: float = 1.0) -> bool:
        """Whether two values are the same within `times` the tolerance; words, flags and None must be equal."""
        if not _is_number(before) or not _is_number(after):
            return type(before) is type(after) and before == after
        if before == after:
            return True
        one, two = float(before), float(after)  # type: ignore[arg-type]
        return abs(two - one) <= times * (self.absolute + self.relative * abs(one))


_PICTURES = (
    r"(calibrate (gelslim3|hidden_rig)|simulated pictures.*|diagnose hidden_rig|train .*|depth .*|force .*)"
)
_LAW = r"(youngs_modulus_MPa|poisson_ratio|c_N_per_mm)\.(value|interval95)"
TOLERANCES = (
    Tolerance(r".*\.(height|height_std)\..*\.(min|max|mean|grid)", 0.0, 1e-6,
              "float32 maps of some tenths of a mm differ by up to 1e-7 mm from run to run"),
    Tolerance(r".*\.(peak_mm|peak_std_mm)", 0.0, 1e-4,
              "written with four decimals: a map that differs by 1e-7 mm may be rounded the other way"),
    Tolerance(r".*\.contact_area_mm2", 0.0, 0.01,
              "counts pixels of .004 or .0093 mm2: one that lies on the threshold may turn"),
    Tolerance(rf"calibrate gelslim3: .*\.{_LAW}", 1e-8, 1e-12,
              "1e-9 in a process of its own; 6e-9 beside other tests, where libraries have other threads"),
    Tolerance(rf".*\.{_LAW}", 1e-9, 1e-12, "E, nu and c are the same from run to run to 1e-9"),
    Tolerance(r".*\.tilt_[xy]", 1e-6, 1e-8,
              "the error of a tilt is that of the slopes under the face, however small the tilt is"),
    Tolerance(rf"{_PICTURES}: .*", 1e-6, 1e-9,
              "what follows from pictures (deviations, covariances, touches, tractions) differs by up to "
              "1e-7 of itself from run to run"),
    Tolerance(r".*", 1e-9, 1e-12, "everything else is the same from run to run to the last digits"),
)  # fmt: skip


def tolerance_of(name: str) -> Tolerance:
    """The first tolerance whose pattern matches the whole of "CASE: NAME"."""
    return next(one for one in TOLERANCES if re.fullmatch(one.pattern, name))


def differences(before: Values, after: Values, case: str = "", *, times: float = 1.0) -> Iterator[str]:
    """A line for each name: before, after, and by how much; of a list, its element that is furthest off.

    `times` widens every tolerance. The record's tolerances are those of one machine; on another processor,
    which sums in another order, what follows from pictures was seen to differ 50 times as much.
    """
    for name in dict.fromkeys([*before, *after]):
        if name not in after:
            yield f"{name}: {_short(before[name])} before, missing now"
        elif name not in before:
            yield f"{name}: not recorded before, {_short(after[name])} now"
        else:
            yield from _compared(name, before[name], after[name], tolerance_of(f"{case}: {name}"), times)


def _compared(name: str, before: Value, after: Value, tolerance: Tolerance, times: float) -> Iterator[str]:
    ones, twos = _as_list(before), _as_list(after)
    if isinstance(before, list) is not isinstance(after, list) or len(ones) != len(twos):
        yield f"{name}: {_short(before)} before, {_short(after)} now"
        return
    off = [k for k, pair in enumerate(zip(ones, twos, strict=True)) if not tolerance.allows(*pair, times)]
    if off:
        worst = max(off, key=lambda k: abs(_relative(ones[k], twos[k])))
        place = f"[{worst}]" if isinstance(before, list) else ""
        more = f" ({len(off)} of {len(ones)} differ)" if len(ones) > 1 else ""
        change = (
            f", relative {_relative(ones[worst], twos[worst]):+.2e}" if _both(ones[worst], twos[worst]) else ""
        )
        yield f"{name}{place}: {ones[worst]!r} before, {twos[worst]!r} now{change}{more}"


def _relative(before: Scalar, after: Scalar) -> float:
    if not _both(before, after):
        return float("inf")
    one, two = float(before), float(after)  # type: ignore[arg-type]
    return (two - one) / abs(one) if one else float("inf")


def _both(before: Scalar, after: Scalar) -> bool:
    return _is_number(before) and _is_number(after)


def _is_number(value: Scalar) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _as_list(value: Value) -> list[Scalar]:
    return value if isinstance(value, list) else [value]


def _short(value: Value) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
