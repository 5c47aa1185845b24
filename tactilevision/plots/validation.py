"""Pictures of a validation: finite elements against the measured depths and forces, and the error of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.plots import style
from tactilevision.records import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = ("o", "s", "^", "D", "v", "P", "X")


@dataclass(frozen=True, slots=True)
class Series:
    """One friction: what finite elements have beside each measurement, and its relative error, (N,) each."""

    name: str
    computed: Floats
    error: Floats


@dataclass(frozen=True, slots=True)
class Panel:
    """One law: the measured quantity (N,) along the measured depth (N,), and the series beside it."""

    title: str
    depth_mm: Floats
    measured: Floats
    series: Sequence[Series]


@style.house_look
def draw_validation(panels: Sequence[Panel], quantity: str, *, title: str = "") -> Figure:
    """One column a law: above, computed against measured; below, the error along depth.

    Depths that no series reaches are shaded.
    """
    figure, axes = style.new_figure(style.WIDTH_IN, 6.4, rows=2, columns=len(panels))
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    above, below = axes[: len(panels)], axes[len(panels) :]
    for panel, upper, lower in zip(panels, above, below, strict=True):
        _against(upper, panel)
        _errors(lower, panel)
        upper.set(xlabel=f"measured {quantity}", ylabel=f"finite elements, {quantity}", title=panel.title)
        lower.set(xlabel="measured depth (mm)", ylabel="error (%)")
    for row in (above, below):
        _share_limits(row)
    for panel, lower in zip(panels, below, strict=True):
        _shade(lower, panel)
    style.legend_below(figure)
    return figure


def _against(axes: Axes, panel: Panel) -> None:
    every = np.concatenate([panel.measured, *(one.computed for one in panel.series)])
    top = float(every[np.isfinite(every)].max())
    axes.axline((0, 0), slope=1, color=style.GREY, lw=0.9, zorder=1)
    axes.annotate(
        "equal",
        (0.82 * top, 0.82 * top),
        xytext=(6, -10),
        textcoords="offset points",
        color=style.GREY,
    )
    order = np.argsort(panel.measured)
    for one, colour, marker in zip(panel.series, style.CYCLE, MARKERS, strict=False):
        axes.plot(panel.measured[order], one.computed[order], marker, ms=4.5, color=colour, mfc="none", mew=1.2,
                  label=one.name)  # fmt: skip
    axes.set(xlim=(0, 1.05 * top), ylim=(0, None))


def _errors(axes: Axes, panel: Panel) -> None:
    order = np.argsort(panel.depth_mm)
    axes.axhline(0, color=style.GREY, lw=0.9)
    for one, colour, marker in zip(panel.series, style.CYCLE, MARKERS, strict=False):
        line = "-" if np.unique(panel.depth_mm).size == panel.depth_mm.size else ""
        axes.plot(panel.depth_mm[order], 100 * one.error[order], marker + line, ms=4.5, mfc="white", mew=1.2, lw=1,
                  color=colour, label=one.name)  # fmt: skip
    axes.set_xlim(0, 1.05 * float(panel.depth_mm.max()))


def _shade(axes: Axes, panel: Panel) -> None:
    """Depths that no series reaches."""
    reached = np.any([np.isfinite(one.error) for one in panel.series], axis=0)
    if reached.all():
        return
    deepest = float(panel.depth_mm[reached].max(initial=0.0))
    left, right = axes.get_xlim()
    axes.axvspan(deepest, right, color=style.INVALID, alpha=0.5, lw=0, label="no finite elements so deep")
    axes.set_xlim(left, right)


def _share_limits(row: Sequence[Axes]) -> None:
    low, high = min(axes.get_ylim()[0] for axes in row), max(axes.get_ylim()[1] for axes in row)
    right = max(axes.get_xlim()[1] for axes in row)
    for axes in row:
        axes.set(xlim=(0, right), ylim=(low, high))
