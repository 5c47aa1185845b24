"""Numbers with their derivatives: forward-mode differentiation of laws and effects.

A `Dual` is a value x of shape S with its slopes dx/dp_k of shape (k, S) with respect to k parameters. Arithmetic,
the functions of `SLOPES`, maximum, minimum, where and clip apply the chain rule, comparisons see the value alone.
Anything else raises TypeError, so that no slope is lost: a law or an effect states its own function by `chained`.
Source: Griewank, Walther, Evaluating Derivatives (2008), ch. 3.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from tactilevision.records.measured import Floats

# Derivative of a function of one number, of x and y = f(x).
SLOPES: Mapping[str, Callable[[Any, Any], Any]] = {
    "negative": lambda x, y: -1.0,
    "exp": lambda x, y: y,
    "expm1": lambda x, y: y + 1,
    "log": lambda x, y: 1 / x,
    "log1p": lambda x, y: 1 / (1 + x),
    "sqrt": lambda x, y: 0.5 / y,
    "sin": lambda x, y: np.cos(x),
    "cos": lambda x, y: -np.sin(x),
    "tanh": lambda x, y: 1 - y**2,
    "arctan": lambda x, y: 1 / (1 + x**2),
    "arctanh": lambda x, y: 1 / (1 - x**2),
    "absolute": lambda x, y: np.sign(x),
    "expit": lambda x, y: y * (1 - y),
    "erf": lambda x, y: 2 / np.sqrt(np.pi) * np.exp(-(x**2)),
}
PLAIN = frozenset({"less", "less_equal", "greater", "greater_equal", "equal", "not_equal", "isfinite", "sign"})


class Dual(NDArrayOperatorsMixin):
    """A `value` of shape S with `slopes` (k, ...) that broadcast to (k, *S)."""

    __slots__ = ("slopes", "value")

    def __init__(self, value: Any, slopes: Floats) -> None:
        self.value, self.slopes = value, slopes

    def __array__(self, *_: Any, **__: Any) -> Floats:
        raise TypeError("this function of a Dual has no derivative")

    def __getitem__(self, place: Any) -> Any:
        if (
            isinstance(place, int | np.integer) and self.value.ndim == 1
        ):  # one number, plain where nothing moves it
            slopes = self.slopes[:, place, None]
            return Dual(self.value[place], slopes) if slopes.any() else self.value[place]
        inner = place if isinstance(place, tuple) else (place,)
        return Dual(self.value[place], self.whole[(slice(None), *inner)])

    def __len__(self) -> int:
        return len(self.value)

    @property
    def whole(self) -> Floats:
        """All slopes (k, *S)."""
        return np.broadcast_to(self.slopes, (len(self.slopes), *np.shape(self.value)))

    def __array_ufunc__(self, ufunc: Any, method: str, *given: Any, **options: Any) -> Any:
        values = [value_of(one) for one in given]
        if method != "__call__" or options:
            return NotImplemented
        y = ufunc(*values)
        if ufunc.__name__ in PLAIN:
            return y
        if ufunc.__name__ in SLOPES:
            return chained(y, [(SLOPES[ufunc.__name__](values[0], y), given[0])])
        parts = _of_two(ufunc.__name__, *values) if len(values) == 2 else None
        if parts is None or (ufunc is np.power and moves(given[1])):
            return NotImplemented
        return chained(y, zip(parts, given, strict=True))

    def __array_function__(self, function: Any, _: Any, given: Any, options: Any) -> Any:
        if function is np.where:
            where, one, other = given
            value = np.where(where, value_of(one), value_of(other))
            both = (where, one), (np.logical_not(where), other)  # a slope that is not chosen may be NaN
            return Dual(value, sum(np.where(keep, x.slopes, 0.0) for keep, x in both if isinstance(x, Dual)))
        if function is np.clip:
            return np.minimum(np.maximum(given[0], given[1]), given[2])
        if function is np.column_stack:
            tables = [_slopes(one, len(self.slopes)) for one in given[0]]
            slopes = [one.reshape(*one.shape[:2], -1) for one in tables]
            return Dual(np.column_stack([value_of(one) for one in given[0]]), np.concatenate(slopes, axis=2))
        return NotImplemented


def _slopes(one: Any, count: int) -> Floats:
    return one.whole if isinstance(one, Dual) else np.zeros((count, *np.shape(one)))


def _of_two(name: str, x: Any, y: Any) -> tuple[Any, Any] | None:
    """Return the derivatives of a function of two numbers; None where it is not known."""
    if name == "add":
        return 1.0, 1.0
    if name == "subtract":
        return 1.0, -1.0
    if name == "multiply":
        return y, x
    if name == "divide":
        return 1 / y, -x / y**2
    if name in ("maximum", "minimum"):
        first = x >= y if name == "maximum" else x <= y
        return first, np.logical_not(first)
    return (y * x ** (y - 1), 0.0) if name == "power" else None  # of a plain exponent


def value_of(one: Any) -> Any:
    """Return the value of a Dual, and anything else as it is."""
    return one.value if isinstance(one, Dual) else one


def moves(*given: Any) -> bool:
    """Return whether any of these is a Dual."""
    return any(isinstance(one, Dual) for one in given)


def chained(value: Any, parts: Iterable[tuple[Any, Any]]) -> Any:
    """Return a function's value with slopes sum_i df/dx_i dx_i, for pairs of df/dx_i and x_i, a Dual or plain."""
    total: Any = 0.0
    for partial, one in parts:
        if isinstance(one, Dual):
            unit = isinstance(partial, float) and partial == 1
            term = one.slopes if unit else np.asarray(partial) * one.slopes
            total = term if isinstance(total, float) else total + term
    return Dual(value, total)
