"""One press at a glance: the frame at the event, the depth, the signal of the bevel, and the force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactilevision.certificate.certificate import Evidence
from tactilevision.plots import style
from tactilevision.plots.height import depth_image, extent_mm, overlay
from tactilevision.records import Bytes, CertifiedPoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@style.house_look
def draw_press(evidence: Evidence, point: CertifiedPoint, *, rgb: Bytes | None) -> Figure:
    """Four panels; `rgb` is the rectified frame at the event, None where there is none."""
    figure, (frame, depth, bevel, force) = style.new_quad(style.WIDTH_IN, 6.0, legend_in=0.9)
    verdict = "accepted" if point.accepted else f"rejected: {point.reason.replace('_', ' ')}"
    height = evidence.height_map
    if height is None:
        for axes in (frame, depth):
            axes.text(
                0.5,
                0.5,
                "no picture at the contact event",
                ha="center",
                transform=axes.transAxes,
                color=style.GREY,
            )
            axes.set_axis_off()
    else:
        if rgb is not None:
            overlay(frame, rgb, height=height, footprint=evidence.footprint)
        image = depth_image(depth, height)
        figure.colorbar(image, ax=depth, label="depth (mm)", shrink=0.75, pad=0.02)
        for axes in (frame, depth):
            _bevel_window(axes, evidence)
            # the scale bar says it, and ticks take their time
            axes.set(xticks=[], yticks=[], xlabel="", ylabel="")
        frame.set_title("Frame of the press" if evidence.touch is None else "Frame at the contact event")
        depth.set_title("Height map of that frame")
    press, punch = style.as_label(point.press), style.as_label(point.indenter)
    figure.suptitle(f"Press {press} ({punch}): {verdict}", x=0.02, ha="left", fontsize=11)
    _bevel_signal(bevel, evidence)
    _force(force, evidence, point)
    style.legend_below(figure)
    return figure


def _bevel_window(axes: Axes, evidence: Evidence) -> None:
    if evidence.bevel_window_mm is None or evidence.height_map is None:
        return
    (x0, y0), (x1, y1) = evidence.bevel_window_mm
    left, right, bottom, top = extent_mm(evidence.height_map)
    middle_x, middle_y = (left + right) / 2, (top + bottom) / 2
    x, y = np.array([x0, x1, x1, x0, x0]) + middle_x, np.array([y0, y0, y1, y1, y0]) + middle_y
    axes.plot(x, y, color=style.SKY, lw=1.6, label="window on the bevel")


def _bevel_signal(axes: Axes, evidence: Evidence) -> None:
    axes.set(
        xlabel="depth read by the camera (mm)",
        ylabel="bevel − other side (µm)",
        title="Signal of the bevel",
    )
    if evidence.signal_mm is None:
        axes.text(0.5, 0.5, "not looked for", ha="center", transform=axes.transAxes, color=style.GREY)
        return
    axes.plot(
        evidence.depth_mm, 1e3 * evidence.signal_mm, ".", ms=4, color=style.BLUE, label="one frame's bevel signal"
    )
    if evidence.touch is not None:
        axes.axvline(evidence.touch.depth_seen_mm, color=style.ORANGE, lw=1.4, label="contact event")


def _force(axes: Axes, evidence: Evidence, point: CertifiedPoint) -> None:
    labels = (
        ("fx, sideways", style.GREEN, 0),
        ("fy, sideways", style.PURPLE, 1),
        ("fz, into the gel", style.BLUE, 2),
    )
    for name, colour, column in labels:
        axes.plot(evidence.force_time_s, evidence.force_N[:, column], color=colour, lw=1.2, label=name)
    if evidence.touch is not None:
        axes.axvline(evidence.touch.time_s, color=style.ORANGE, lw=1.4, label="contact event")
        axes.plot([evidence.touch.time_s], [point.fz_N], "o", color=style.ORANGE, ms=6, label="certified force")
    axes.set(xlabel="camera's clock (s)", ylabel="force (N)", title="Force, less that of the free gel")
