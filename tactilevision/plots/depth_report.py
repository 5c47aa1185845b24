"""How deep contacts of known depth come out, by depth and by contact size, the stated error beside.

Balls that the calibration never saw, and flat steps that certified presses make.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.plots import style
from tactilevision.uncertainty.ball_validation import Band, Known, bands

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEAR = 0.15  # of the axis: two shares side by side would run into each other
ALIKE = 0.2  # of a value: contacts that differ by less have one size
AXES = (("true_mm", "depth (mm)"), ("radius_px", "contact radius (px)"))


@style.house_look
def draw_depth_report(card: Mapping[str, Any]) -> Figure:
    """Each contact, as found less true, over its depth and its contact radius; `card` is a method's.

    Broad bars are the rms over a band of contacts, with the share of them within one stated deviation.
    """
    from matplotlib.textpath import TextPath

    steps = card.get("flat_steps", "no flat steps in this recording")
    rows = [("balls held out", card["held_out_balls"])]
    if not isinstance(steps, str):
        rows.append(("flat steps, certified by their bevel", steps))
    figure, panels = style.new_figure(style.WIDTH_IN, 0.7 + 2.9 * len(rows), rows=len(rows), columns=2)
    for number, (name, contacts) in enumerate(rows):
        _draw_row(panels[2 * number : 2 * number + 2], name, [Known(**one) for one in contacts])
    if isinstance(steps, str):
        panels[1].set_title(steps)
    percent = TextPath((-0.47, -0.36), "%", size=1)  # about its middle
    panels[0].plot([], [], " ", marker=percent, color=style.GREY, label="share of a band within its deviation")
    style.legend_below(figure, columns=2)
    return figure


def _widen(axes: Axes, values: Sequence[float]) -> None:
    """Room about values that are all but the same, so that the axis counts no hundredths."""
    middle = 0.5 * (min(values) + max(values))
    if max(values) - min(values) < ALIKE * middle:
        axes.set_xlim((1 - ALIKE) * middle, (1 + ALIKE) * middle)


def _write_shares(axes: Axes, found: Sequence[Band]) -> None:
    """The share of each band within its deviation, at its foot; a line higher beside a near one."""
    left, high = -np.inf, False
    for band in found:
        middle = 0.5 * (band.low + band.high)
        high, left = middle - left < NEAR * np.ptp(axes.get_xlim()) and not high, middle
        axes.annotate(
            f"{100 * band.within:.0f} %",
            (middle, 0.09 if high else 0.02),
            xycoords=("data", "axes fraction"),
            ha="center",
            color=style.GREY,
        )


def _draw_row(panels: Sequence[Axes], name: str, contacts: Sequence[Known]) -> None:
    off_um = [1e3 * (one.found_mm - one.true_mm) for one in contacts]
    stated_um = [1e3 * one.stated_mm for one in contacts]
    for axes, (key, label) in zip(panels, AXES, strict=True):
        for number, band in enumerate(bands(contacts, key)):
            middle, width = 0.5 * (band.low + band.high), max(band.high - band.low, 0.04 * band.high)
            axes.bar(middle, 2e3 * band.rms_mm, width, bottom=-1e3 * band.rms_mm, alpha=0.25,
                     color=style.YELLOW, label="rms error of a band" if number == 0 else None)  # fmt: skip
        axes.errorbar([getattr(one, key) for one in contacts], off_um, yerr=stated_um, fmt="o", ms=4, lw=1.0,
                      color=style.BLUE, label="one contact, and its stated deviation (std)")  # fmt: skip
        axes.axhline(0.0, color=style.GREY, lw=0.8)
        axes.margins(x=0.1)  # room for the shares, which stand in the middle of bands as narrow as a point
        axes.set_xlabel(label)
        _widen(axes, [getattr(one, key) for one in contacts])
        _write_shares(axes, bands(contacts, key))
    panels[0].set_ylabel("depth found − true (µm)")
    panels[0].set_title(f"{len(contacts)} {name}")
    low, high = panels[0].get_ylim()
    for axes in panels:
        axes.set_ylim(1.15 * min(low, -high), 1.15 * max(high, -low))
