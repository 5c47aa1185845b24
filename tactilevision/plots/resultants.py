"""Pictures of many frames' forces: their course in time, and what is left beside the force/torque sensor."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactilevision.force.compare import Residuals
from tactilevision.force.frame import FrameForce
from tactilevision.plots import style
from tactilevision.records import Floats, Press

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMES = ("x", "y", "z")
COLOURS = (style.GREEN, style.YELLOW, style.BLUE)
PAUSE_S = 0.5  # a longer one is drawn this long


@style.house_look
def draw_resultants(rows: Sequence[FrameForce], presses: Sequence[Press] = ()) -> Figure:
    """fz, and fx, fy where they are known, against time with the 95 % interval, beside the F/T reading.

    Pauses between frames are shortened, and presses named along the top. Frames without time go by number.
    """
    time_s = np.array([row.time_s for row in rows])
    force, std, read = (
        np.array([getattr(row, name) for row in rows], dtype=float).reshape(-1, 3)
        for name in ("resultant_N", "resultant_std_N", "measured_N")
    )
    timed = bool(np.isfinite(time_s).all())
    place = _without_pauses(time_s) if timed else np.arange(len(rows), dtype=float)
    shown = [k for k in (2, 0, 1) if k == 2 or np.nan_to_num(force[:, k]).any()]
    figure, axes = style.new_figure(style.WIDTH_IN, 1.2 + 2.4 * max(1, len(shown)), rows=max(1, len(shown)))
    parts = _parts(place, time_s if timed else place)
    for axis, k in zip(axes, shown, strict=False):
        _course(axis, place, force[:, k], std[:, k], parts=parts, name=f"f{NAMES[k]}", colour=COLOURS[k])
        if np.isfinite(read[:, k]).any():
            for part in parts:
                axis.plot(
                    place[part],
                    read[part, k],
                    color="black",
                    lw=1,
                    ls="--",
                    label="F/T sensor" if part is parts[0] else None,
                )
        axis.set(ylabel=f"f{NAMES[k]} (N)")
        axis.margins(x=0.01)
    axes[0].set_title("Force on the gel, with its 95 % interval", pad=16 if presses and timed else 6)
    axes[-1].set(xlabel="time (s), pauses shortened" if timed else "frame")
    if timed:
        _name_presses(axes[0], place, time_s, presses)
    style.legend_below(figure)
    return figure


@style.house_look
def draw_residuals(found: Residuals) -> Figure:
    """Force from the picture less the reading, against force, depth, place, direction and press.

    Blue: frames that can be trusted; hollow grey: flagged. The band is the 95 % interval of both together.
    """
    figure, axes = style.new_figure(style.WIDTH_IN, 8.0, rows=3, columns=2)
    left, std = found.residual_N[:, 2], found.std_N[:, 2]
    labels = list(dict.fromkeys(found.press.tolist()))
    press = np.array([labels.index(name) for name in found.press], dtype=float)
    against = (
        (found.measured_N[:, 2], "force sensor's fz (N)"),
        (found.depth_mm, "depth of the contact (mm)"),
        (found.place_mm[:, 0], "x on the pad (mm)"),
        (found.place_mm[:, 1], "y on the pad (mm)"),
        (found.direction_deg, "direction of tangential force (° from x)"),
    )
    for axis, (values, label) in zip(axes, against, strict=False):
        _cloud(axis, values, left, std, found.usable)
        axis.set(xlabel=label, ylabel="fz: picture − sensor (N)")
    if not np.isfinite(found.direction_deg).any():
        axes[4].text(0.5, 0.5, "no tangential force", ha="center", transform=axes[4].transAxes, color=style.GREY)
    _cloud(axes[5], press, left, std, found.usable)
    if len(labels) <= 40:
        axes[5].set_xticks(
            range(len(labels)), [style.as_label(name) or "-" for name in labels], rotation=90, fontsize=8
        )
    axes[5].set(xlabel="press", ylabel="fz: picture − sensor (N)")
    inside = float(np.mean(np.abs(left[found.usable]) < 1.96 * std[found.usable])) if found.usable.any() else 0.0
    style.legend_below(figure)
    axes[0].set_title(f"{int(found.usable.sum())} frames; {100 * inside:.0f} % within the 95 % interval of both")
    return figure


def _cloud(axes: Axes, x: Floats, left: Floats, std: Floats, usable: npt.NDArray[np.bool_]) -> None:
    axes.axhline(0, color="black", lw=0.8)
    axes.errorbar(
        x[usable], left[usable], yerr=1.96 * std[usable], fmt="none", ecolor=style.SKY, elinewidth=0.7, alpha=0.6
    )
    axes.plot(x[~usable], left[~usable], "o", ms=3, mfc="none", mec=style.GREY, label="flagged: not counted")
    axes.plot(x[usable], left[usable], "o", ms=3, color=style.BLUE, label="a frame, and the 95 % interval of both")


def _course(
    axes: Axes, place: Floats, force: Floats, std: Floats, *, parts: Sequence[slice], name: str, colour: str
) -> None:
    for part in parts:
        label = f"{name} from the picture" if part == parts[0] else None
        axes.plot(place[part], force[part], color=colour, marker=".", ms=2.5, label=label)
        low, high = (force[part] + s * 1.96 * std[part] for s in (-1, 1))
        axes.fill_between(place[part], low, high, color=colour, alpha=0.2, lw=0)


def _without_pauses(time_s: Floats) -> Floats:
    step = np.diff(time_s, prepend=time_s[:1])
    return np.cumsum(np.clip(step, 0, PAUSE_S))


def _parts(place: Floats, time_s: Floats) -> list[slice]:
    """Stretches without a pause; a line across a pause would say what nobody saw."""
    step = np.diff(time_s, prepend=time_s[:1])
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    cuts = [0, *np.flatnonzero(step > max(2.0, 12 * usual)).tolist(), len(place)]
    return [slice(a, b) for a, b in pairwise(cuts) if b > a]


def _name_presses(axes: Axes, place: Floats, time_s: Floats, presses: Sequence[Press]) -> None:
    for press in presses:
        inside = (time_s >= press.start_s) & (time_s <= press.end_s)
        if inside.any():
            middle = float(place[inside].mean())
            axes.text(middle, 1.01, style.as_label(press.press), transform=axes.get_xaxis_transform(),
                      fontsize=7, ha="center", va="bottom", color=style.GREY)  # fmt: skip
