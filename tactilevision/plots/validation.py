"""Figures of validations: depths of known contacts, and finite elements against measured forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.heightmap.ball_validation import Band, Known, bands
from tactilevision.plots import style
from tactilevision.plots.style import LOOK
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Depth errors of held-out balls and certified flat steps, by depth and by contact size.

AXES = (("true_mm", "depth (mm)"), ("radius_px", "contact radius (px)"))


@style.house_look
def draw_depth_report(card: Mapping[str, Any]) -> Figure:
    """Draw the depth error of each contact over its depth and its contact radius; `card` is a method's.

    Broad bars are the rms over a band of contacts, with the share of them within one stated deviation.
    """
    from matplotlib.textpath import TextPath

    steps = card.get("flat_steps", "no flat steps in this recording")
    rows = [("balls held out", card["held_out_balls"])]
    if not isinstance(steps, str):
        rows.append(("flat steps, certified by their bevel", steps))
    figure, panels = style.new_figure(rows=len(rows), columns=2)
    for number, (name, contacts) in enumerate(rows):
        _draw_row(panels[2 * number : 2 * number + 2], name, [Known(**one) for one in contacts])
    if isinstance(steps, str):
        panels[1].set_title(steps)
    percent = TextPath((-0.5, -0.5), "%", size=1)
    panels[0].plot([], [], " ", marker=percent, color=style.GREY, label="share of a band within its deviation")
    return style.legend_below(figure, columns=2)


def _widen(axes: Axes, values: Sequence[float]) -> None:
    """Widen an axis of nearly equal values, which else would show their last digits."""
    middle = 0.5 * (min(values) + max(values))
    if max(values) - min(values) < LOOK.band * middle:
        axes.set_xlim((1 - LOOK.band) * middle, (1 + LOOK.band) * middle)


def _write_shares(axes: Axes, found: Sequence[Band]) -> None:
    """Write the share of each band within its deviation at its foot, or one line higher next to a near one."""
    left, high = -np.inf, False
    for band in found:
        middle = 0.5 * (band.low + band.high)
        high, left = middle - left < LOOK.room * np.ptp(axes.get_xlim()) and not high, middle
        place, share = (middle, (1 + 3 * high) / 50), f"{100 * band.within:.0f} %"
        axes.annotate(share, place, xycoords=("data", "axes fraction"), ha="center", color=style.GREY)


def _draw_row(panels: Sequence[Axes], name: str, contacts: Sequence[Known]) -> None:
    off_um = [KILO * (one.found_mm - one.true_mm) for one in contacts]
    stated_um = [KILO * one.stated_mm for one in contacts]
    for axes, (key, label) in zip(panels, AXES, strict=True):
        for number, band in enumerate(bands(contacts, key)):
            middle, width, rms_um = 0.5 * (band.low + band.high), band.high - band.low, KILO * band.rms_mm
            axes.bar(middle, 2 * rms_um, max(width, band.high / 25), bottom=-rms_um, alpha=LOOK.band,
                     color=style.YELLOW, label="rms error of a band" if number == 0 else None)  # fmt: skip
        axes.errorbar([getattr(one, key) for one in contacts], off_um, yerr=stated_um, fmt="o", lw=LOOK.line,
                      color=style.BLUE, label="one contact, and its stated deviation (std)")  # fmt: skip
        style.zero_line(axes)
        axes.margins(x=LOOK.room)
        axes.set_xlabel(label)
        _widen(axes, [getattr(one, key) for one in contacts])
        _write_shares(axes, bands(contacts, key))
    panels[0].set_ylabel("depth found − true (µm)")
    panels[0].set_title(f"{len(contacts)} {name}")
    reach = (1 + LOOK.room) * max(np.abs(panels[0].get_ylim()))
    for axes in panels:
        axes.set_ylim(-reach, reach)


# Finite elements against measured depths and forces.

MARKERS = ("o", "s", "^", "D", "v", "P", "X")


@dataclass(frozen=True, slots=True)
class Series:
    """One friction: the finite elements' value for each measurement, and its relative error, (N,) each."""

    name: str
    computed: Floats
    error: Floats


@dataclass(frozen=True, slots=True)
class Panel:
    """One law: the measured quantity (N,) along the measured depth (N,), and the computed series."""

    title: str
    depth_mm: Floats
    measured: Floats
    series: Sequence[Series]


@style.house_look
def draw_validation(panels: Sequence[Panel], quantity: str, *, title: str = "") -> Figure:
    """Draw one column a law: above, computed against measured; below, the error along depth.

    Depths that no series reaches are shaded.
    """
    figure, axes = style.new_figure(rows=2, columns=len(panels))
    figure.suptitle(title, x=1 / 50, ha="left", fontsize=11)
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
    return style.legend_below(figure)


def _against(axes: Axes, panel: Panel) -> None:
    every = np.concatenate([panel.measured, *(one.computed for one in panel.series)])
    top = float(every[np.isfinite(every)].max())
    axes.axline((0, 0), slope=1, color=style.GREY, lw=LOOK.line, zorder=1)
    place = (LOOK.bar * top, LOOK.bar * top)
    axes.annotate("equal", place, xytext=(6, -10), textcoords="offset points", color=style.GREY)
    order = np.argsort(panel.measured)
    for one, colour, marker in zip(panel.series, style.CYCLE, MARKERS, strict=False):
        axes.plot(panel.measured[order], one.computed[order], marker, color=colour, mfc="none", mew=LOOK.line,
                  label=one.name)  # fmt: skip
    axes.set(xlim=(0, None), ylim=(0, None))


def _errors(axes: Axes, panel: Panel) -> None:
    order = np.argsort(panel.depth_mm)
    style.zero_line(axes)
    for one, colour, marker in zip(panel.series, style.CYCLE, MARKERS, strict=False):
        line = "-" if np.unique(panel.depth_mm).size == panel.depth_mm.size else ""
        axes.plot(panel.depth_mm[order], 100 * one.error[order], marker + line, mfc="white", mew=LOOK.line,
                  lw=LOOK.line, color=colour, label=one.name)  # fmt: skip
    axes.set_xlim(0, (1 + LOOK.room / 3) * float(panel.depth_mm.max()))


def _shade(axes: Axes, panel: Panel) -> None:
    """Shade the depths that no series reaches."""
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
