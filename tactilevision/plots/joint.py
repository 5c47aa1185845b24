"""Young's modulus and Poisson's ratio together: the curve that one punch fixes, and what picks the part of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.plots import style
from tactilevision.records import Floats, Pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORDS = {
    "bulge": "rise beside the punch",
    "radii": "several radii",
    "prior": "stated beforehand",
    "beta": "law of β (not used)",
}
ROW = 0.055  # of the height of the picture, for each route's bar
MIN_MARGIN = 0.002  # of nu, beside what is drawn: where nu is stated without doubt, all of it is one line


@style.house_look
def draw_joint(
    curve: Floats, region: Floats, *, best: Pair | None, routes: Sequence[tuple[str, Pair, bool]]
) -> Figure:
    """`curve` (n, 2) of (nu, E in MPa); `region` (k, 2) the outline of 95 %.

    `routes` (name, 95 % interval, used).
    """
    figure, (axes,) = style.new_figure(style.WIDTH_IN, 5.2)
    axes.plot(*curve.T, color=style.BLUE, label="E(ν) at the fitted c")
    axes.fill(*region.T, color=style.YELLOW, alpha=0.35, lw=0, label="95 % of E and ν together")
    if best is not None:
        axes.plot(*best, "o", color=style.ORANGE, ms=6, label="best E and ν")
    left, right, bottom, top = _frame(curve, region, routes)
    height = (top - bottom) / (0.9 - ROW * len(routes))
    floor = top + 0.05 * height - height
    colours = dict(zip(WORDS, (style.GREEN, style.PURPLE, style.GREY, style.SKY), strict=True))
    for place, (name, (low, high), used) in enumerate(routes):
        y, colour = floor + (place + 0.6) * ROW * height, colours.get(name, style.GREY)
        bar, words = np.clip([low, high], left, right), WORDS.get(name, name)
        if used:
            axes.axvspan(low, high, color=colour, alpha=0.12, lw=0, label=f"95 % of ν, {words}")
        if high < left or low > right:  # an arrow at the edge says where it lies
            words += f": {low:.3f} to {high:.3f}, off the picture"
            inwards = 0.012 * (right - left) * (1 if high < left else -1)
            axes.plot(bar[0] + inwards, y, "<" if high < left else ">", color=colour, label=words)
            continue
        axes.plot(bar, [y, y], "|-", ms=9, mew=1.5, color=colour, lw=4 if used else 1.5, label=words)
    axes.set(xlim=(left, right), ylim=(floor, floor + height), xlabel="Poisson's ratio ν")
    axes.set(ylabel="Young's modulus E (MPa)", title="E and ν together, and what each route says of ν")
    style.legend_below(figure, columns=2)  # inside it would cover the region
    return figure


def _frame(
    curve: Floats, region: Floats, routes: Sequence[tuple[str, Pair, bool]]
) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of what is to be seen, the bars of the routes aside."""
    used = [interval for _, interval, is_used in routes if is_used]
    low = min([float(region[:, 0].min()), *(interval[0] for interval in used)])
    high = max([float(region[:, 0].max()), *(interval[1] for interval in used)])
    margin = max(0.2 * (high - low), MIN_MARGIN)
    left, right = max(low - margin, float(curve[0, 0])), min(high + margin, 0.505)
    inside = curve[(curve[:, 0] >= left) & (curve[:, 0] <= right), 1]
    shown = np.append(inside, np.interp([left, right], *curve.T))
    bottom = min(float(region[:, 1].min()), float(shown.min()))
    return left, right, bottom, max(float(region[:, 1].max()), float(shown.max()))
