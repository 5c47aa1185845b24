"""How deep balls come out that a calibration never saw: by depth and by contact size, the stated error beside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.depth_error import gain_std
from tactilevision.held_out_depth import bands
from tactilevision.plots import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXES = (("dent_mm", "depth of the dent (mm)"), ("contact_radius_px", "contact radius (px)"))


@style.house_look
def draw_depth_report(card: Mapping[str, Any]) -> Figure:
    """Each ball held out, as found less true, over its depth and its contact radius; `card` is a method's.

    Broad bars are the rms over a band of as many balls each, with the share of them within one stated deviation.
    """
    figure, panels = style.new_figure(8.4, 3.6, columns=2)
    stated = gain_std(card, float(card["held_out_gain_std"]))
    balls = card["held_out_balls"]
    stated_um = 1e3 * stated * np.array([ball["dent_mm"] for ball in balls])
    off_um = 1e3 * np.array([ball["found_mm"] - ball["dent_mm"] for ball in balls])
    for axes, (key, label) in zip(panels, AXES, strict=True):
        for number, band in enumerate(bands(card, key, stated)):
            width = max(band.high - band.low, 1e-6)
            axes.bar(band.low, 2e3 * band.off_mm, width, bottom=-1e3 * band.off_mm, align="edge", alpha=0.25,
                     color=style.ORANGE, label="rms of the band" if number == 0 else None)  # fmt: skip
            axes.annotate(f"{100 * band.within:.0f} %", (0.5 * (band.low + band.high), 0.02),
                          xycoords=("data", "axes fraction"), ha="center", color=style.GREY)  # fmt: skip
        axes.errorbar([ball[key] for ball in balls], off_um, yerr=stated_um, fmt="o", ms=4, lw=1.0,
                      color=style.BLUE, label="one ball, and one stated deviation")  # fmt: skip
        axes.axhline(0.0, color=style.GREY, lw=0.8)
        axes.set_xlabel(label)
    panels[0].set_ylabel("found less true (µm)")
    panels[0].set_title(f"{len(balls)} balls held out; share within one deviation")
    panels[1].legend(loc="upper left")
    low, high = panels[0].get_ylim()
    for axes in panels:
        axes.set_ylim(1.15 * min(low, -high), 1.5 * max(high, -low))
    return figure
