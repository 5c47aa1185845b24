"""Figures of deformation, tractions and resultant forces, and of their difference from a force sensor."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.force.calibrated import Sensitivity
from tactilevision.force.comparison import Residuals
from tactilevision.force.frame import FrameForce
from tactilevision.plots import style
from tactilevision.plots.height import FLAT_MM, centre_mm, deepest_place, depth_image, known_mm
from tactilevision.plots.style import LOOK
from tactilevision.records.constants import KILO, MICRO, TINY, Z95
from tactilevision.records.maps import HeightMap, ShearMap, TractionMap
from tactilevision.records.measured import Floats
from tactilevision.records.rig import Press

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Force of one frame.

PAD_AXES = ("x on the pad (mm)", "y on the pad (mm)")
NAMES = ("x", "y", "z")
SAID = {"youngs_modulus": "Young's modulus", "poisson_ratio": "Poisson's ratio", "both together": "both together"}
WORDS = {"x": "shear traction t_x (kPa)", "y": "shear traction t_y (kPa)", "z": "pressure t_z (kPa)"}
LINE = 100  # letters of a line of small print across a figure


@style.house_look
def draw_force(found: TractionMap, height: HeightMap, *, shear: ShearMap | None = None) -> Figure:
    """Draw depth (H, W) in mm with the surface's motion and tangential traction, a cut, and t_x, t_y, t_z.

    Where the shear is not known t_x and t_y are omitted, and the title says so.
    """
    whole = bool(np.isfinite(found.t_x).all())
    figure, (above, cut, *maps) = style.new_figure(rows=3 if whole else 2, columns=2)
    style.colour_bar(above, depth_image(above, height), "depth into the gel (mm)")
    if shear is not None and whole:
        _motion_arrows(above, shear)
        _force_arrows(above, found, height)
    above.set_title(found.name)
    _cut(cut, found, height)
    fields = {"z": found.t_z} | ({"x": found.t_x, "y": found.t_y} if whole else {})
    tangential = max((float(np.abs(fields[n]).max()) for n in ("x", "y") if n in fields), default=0.0)
    places = [maps[0], *maps[2:]] if whole else maps[:1]
    for axis, (name, field) in zip(places, fields.items(), strict=True):
        limit = max(float(np.nanmax(np.abs(field), initial=0.0)) if name == "z" else tangential, MICRO)
        _traction_image(axis, found, KILO * field, KILO * limit, name)
    if whole:
        _deviation(maps[1], found)
    style.legend_below(figure, columns=2, corner=None if whole else maps[1])
    if found.flags:
        said = textwrap.fill("; ".join(found.flags), LINE)
        figure.supxlabel(said, fontsize=8, color=style.GREY)
    return figure


@style.house_look
def draw_sensitivity(found: TractionMap, ranges: Sequence[Sensitivity]) -> Figure:
    """Draw the change of fz over the 95 % interval of each parameter, and its whole uncertainty."""
    figure, (axes,) = style.new_figure(height_in=1 + 0.5 * (len(ranges) + 2))
    labels = [SAID[entry.parameter] for entry in ranges]
    half = 100 * Z95 * found.resultant_std_N[2] / max(found.resultant_N[2], TINY)
    widest = half
    for row, entry in enumerate(ranges):
        low, high = sorted(entry.change_percent(found))
        widest = max(widest, -low, high)
        axes.barh(row, high - low, left=low, color=style.CYCLE[row], height=0.5)
        words = f"{low:+.1f} to {high:+.1f} %"
        if np.isfinite(entry.values).all():
            unit = "" if entry.unit == "1" else f" {entry.unit}"
            words += f"   ({entry.values[0]:.4g} to {entry.values[1]:.4g}{unit})"
        place = (max(high, 0.0), row)
        axes.annotate(words, place, xytext=(6, 0), textcoords="offset points", va="center")
    axes.barh(len(ranges), 2 * half, left=-half, color=style.GREY, height=0.5)
    axes.annotate(f"± {half:.1f} %", (half, len(ranges)), xytext=(6, 0), textcoords="offset points", va="center")
    axes.axvline(0, color="black", lw=LOOK.line)
    axes.set_yticks(range(len(ranges) + 1), [*labels, "with depth and all else"])
    axes.set_xlim(-(1 + LOOK.room) * widest, 3 * widest)
    axes.invert_yaxis()
    title = f"Change of fz = {found.resultant_N[2]:.3f} N over the calibration's 95 % intervals"
    axes.set(xlabel="change of fz (%)", title=title)
    return figure


def _cut(axes: Axes, found: TractionMap, height: HeightMap) -> None:
    """Draw depth along x through the deepest place, and the traction in that row as arrows onto the surface."""
    row, _ = deepest_place(height)
    middle = centre_mm(height)
    x = np.arange(height.depth_mm.shape[1]) * height.mm_per_px[0]
    depth = known_mm(height)[row]
    axes.plot(x, depth, color=style.BLUE, label="the gel's surface")
    low, high = float(np.nanmin(depth, initial=0)), float(np.nanmax(depth, initial=FLAT_MM))
    floor = (1 + LOOK.room) * high
    axes.fill_between(x, depth, floor, color=style.SKY, alpha=LOOK.band, lw=0)
    y_mm = row * height.mm_per_px[1] - middle[1]
    cell = int(np.clip(round((y_mm - found.first_mm[1]) / found.mm_per_px[1]), 0, found.t_z.shape[0] - 1))
    touching = np.flatnonzero(np.nan_to_num(found.t_z[cell]) > 0)
    places = found.first_mm[0] + found.mm_per_px[0] * touching + middle[0]
    if touching.size:
        down, along = found.t_z[cell, touching], np.nan_to_num(found.t_x[cell, touching])
        top = float(np.hypot(down, along).max())
        tips = np.interp(places, x, height.depth_mm[row])
        axes.quiver(places, tips, along, -down, color=style.ORANGE, pivot="tip", scale=3 * top,
                    scale_units="height", width=2 * style.ARROW)  # fmt: skip
        axes.plot([], [], color=style.ORANGE, label=f"traction on it, longest {KILO * top:.0f} kPa")
    axes.set_ylim(floor, low - 0.5 * (high - low))
    axes.set(xlabel="x (mm)", ylabel="depth into the gel (mm)", title="Cut along x, deepest place")


def _deviation(axes: Axes, found: TractionMap) -> None:
    """Draw the standard deviation of each cell's pressure."""
    if found.std_MPa is None or not np.isfinite(found.std_MPa[2]).any():
        axes.set_axis_off()
        return
    std = KILO * found.std_MPa[2]
    image = style.show_map(axes, std, _extent(found), limits=(0, float(np.nanmax(std))))
    style.colour_bar(axes, image, "deviation of t_z (kPa)")
    style.as_map(axes, *PAD_AXES, "Standard deviation of each cell")


def _extent(found: TractionMap) -> style.Extent:
    rows, columns = found.t_z.shape
    sx, sy = found.mm_per_px
    left, top = found.first_mm[0] - sx / 2, found.first_mm[1] - sy / 2
    return (left, left + columns * sx, top + rows * sy, top)


def _traction_image(axes: Axes, found: TractionMap, field_kPa: Floats, limit: float, name: str) -> None:
    low, colours = (0.0, style.DEPTH_MAP) if name == "z" else (-limit, "PuOr")
    image = style.show_map(axes, field_kPa, _extent(found), limits=(low, limit), cmap=colours)
    style.colour_bar(axes, image, WORDS[name])
    force, std = found.resultant_N[NAMES.index(name)], found.resultant_std_N[NAMES.index(name)]
    unknown = "" if np.isfinite(found.t_x).all() else "\nfx, fy not measured"
    style.as_map(axes, *PAD_AXES, f"f{name} = {force:.3f} ± {Z95 * std:.3f} N (95 %){unknown}")


def _motion_arrows(axes: Axes, shear: ShearMap) -> None:
    rows, columns = shear.u_x_mm.shape
    step = max(1, max(rows, columns) // 24)
    y, x = np.mgrid[step // 2 : rows : step, step // 2 : columns : step]
    known = shear.valid[y, x]
    u, v = shear.u_x_mm[y, x][known], shear.u_y_mm[y, x][known]
    sx, sy = shear.mm_per_px
    largest = float(np.hypot(u, v).max(initial=0.0))
    if largest > 0:
        scale = 2 * largest / (3 * step * min(sx, sy))
        style.arrows(axes, x[known] * sx, y[known] * sy, u, v, colour="white", scale=scale)
        style.outlined_entry(axes, f"motion of the gel, longest {KILO * largest:.0f} µm")


def _force_arrows(axes: Axes, found: TractionMap, height: HeightMap) -> None:
    """Draw the tangential traction on the cells in contact, on the height map's own axes."""
    rows, columns = np.nonzero(np.nan_to_num(found.t_z) > 0)
    t = np.stack([found.t_x[rows, columns], found.t_y[rows, columns]])
    largest = float(np.hypot(*t).max(initial=0.0))
    if largest == 0:
        return
    middle = centre_mm(height)
    x = found.first_mm[0] + columns * found.mm_per_px[0] + middle[0]
    y = found.first_mm[1] + rows * found.mm_per_px[1] + middle[1]
    style.arrows(axes, x, y, *t, colour=style.ORANGE, scale=largest / (3 * found.mm_per_px[0]))
    words = f"shear traction, longest {KILO * largest:.1f} kPa"
    style.outlined_entry(axes, words, colour=style.ORANGE)


# Forces of many frames.

COLOURS = (style.GREEN, style.YELLOW, style.BLUE)
PAUSE_S = 0.5  # a longer one is drawn this long


@style.house_look
def draw_resultants(rows: Sequence[FrameForce], presses: Sequence[Press] = ()) -> Figure:
    """Draw fz, and fx, fy where they are known, against time with the 95 % interval and the F/T reading.

    Pauses between frames are shortened, and presses named along the top. Frames without time go by number.
    """
    time_s = np.array([row.time_s for row in rows])
    force, std, read = (
        np.array([getattr(row, name) for row in rows], dtype=float).reshape(-1, 3)
        for name in ("resultant_N", "resultant_std_N", "measured_N")
    )
    timed = bool(np.isfinite(time_s).all())
    steps_s = np.clip(np.diff(time_s, prepend=time_s[:1]), 0, PAUSE_S)
    place = np.cumsum(steps_s) if timed else np.arange(len(rows), dtype=float)
    shown = [k for k in (2, 0, 1) if k == 2 or np.nan_to_num(force[:, k]).any()]
    figure, axes = style.new_figure(rows=len(shown))
    parts = _parts(place, time_s if timed else place)
    for axis, k in zip(axes, shown, strict=False):
        _course(axis, place, force[:, k], std[:, k], parts=parts, name=f"f{NAMES[k]}", colour=COLOURS[k])
        if np.isfinite(read[:, k]).any():
            for part in parts:
                label = "F/T sensor" if part is parts[0] else None
                axis.plot(place[part], read[part, k], color="black", lw=LOOK.line, ls="--", label=label)
        axis.set(ylabel=f"f{NAMES[k]} (N)")
        axis.margins(x=0)
    axes[0].set_title("Force on the gel, with its 95 % interval", pad=16 if presses and timed else 6)
    axes[-1].set(xlabel="time (s), pauses shortened" if timed else "frame")
    if timed:
        _name_presses(axes[0], place, time_s, presses)
    return style.legend_below(figure)


@style.house_look
def draw_residuals(found: Residuals) -> Figure:
    """Draw force from the picture less the reading, against force, depth, place, direction and press.

    Blue: frames without flags; hollow grey: flagged. The bars are 95 % intervals of the difference.
    """
    figure, axes = style.new_figure(rows=3, columns=2)
    left, std = found.residual_N[:, 2], found.std_N[:, 2]
    labels = list(dict.fromkeys(found.press.tolist()))
    press = np.array([labels.index(name) for name in found.press], dtype=float)
    against = (
        (found.measured_N[:, 2], "force sensor's fz (N)"),
        (found.depth_mm, "depth of the contact (mm)"),
        (found.place_mm[:, 0], PAD_AXES[0]),
        (found.place_mm[:, 1], PAD_AXES[1]),
        (found.direction_deg, "direction of tangential force (° from x)"),
    )
    for axis, (values, label) in zip(axes, against, strict=False):
        _cloud(axis, values, left, std, found.usable)
        axis.set(xlabel=label, ylabel="fz: picture − sensor (N)")
    if not np.isfinite(found.direction_deg).any():
        style.note(axes[4], "no tangential force")
    _cloud(axes[5], press, left, std, found.usable)
    if len(labels) <= 40:
        axes[5].set_xticks(range(len(labels)), [style.as_label(name) or "-" for name in labels], rotation=90)
    axes[5].set(xlabel="press", ylabel="fz: picture − sensor (N)")
    inside = float(np.mean(np.abs(left[found.usable]) < Z95 * std[found.usable])) if found.usable.any() else 0.0
    style.legend_below(figure)
    axes[0].set_title(f"{int(found.usable.sum())} frames; {100 * inside:.0f} % within the 95 % interval of both")
    return figure


def _cloud(axes: Axes, x: Floats, left: Floats, std: Floats, usable: npt.NDArray[np.bool_]) -> None:
    style.zero_line(axes)
    bars: dict[str, Any] = {"fmt": "none", "ecolor": style.SKY, "elinewidth": LOOK.line, "alpha": LOOK.faint}
    axes.errorbar(x[usable], left[usable], yerr=Z95 * std[usable], **bars)
    axes.plot(x[~usable], left[~usable], "o", ms=3, mfc="none", mec=style.GREY, label="flagged: not counted")
    axes.plot(x[usable], left[usable], "o", ms=3, color=style.BLUE, label="a frame, and the 95 % interval of both")


def _course(
    axes: Axes, place: Floats, force: Floats, std: Floats, *, parts: Sequence[slice], name: str, colour: str
) -> None:
    for part in parts:
        label = f"{name} from the picture" if part == parts[0] else None
        axes.plot(place[part], force[part], color=colour, marker=".", ms=LOOK.dot, label=label)
        low, high = (force[part] + s * Z95 * std[part] for s in (-1, 1))
        axes.fill_between(place[part], low, high, color=colour, alpha=LOOK.band, lw=0)


def _parts(place: Floats, time_s: Floats) -> list[slice]:
    """Return the stretches without a pause, across which lines are interrupted."""
    step = np.diff(time_s, prepend=time_s[:1])
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    cuts = [0, *np.flatnonzero(step > max(2, 12 * usual)).tolist(), len(place)]
    return [slice(a, b) for a, b in pairwise(cuts) if b > a]


def _name_presses(axes: Axes, place: Floats, time_s: Floats, presses: Sequence[Press]) -> None:
    for press in presses:
        inside = (time_s >= press.start_s) & (time_s <= press.end_s)
        if inside.any():
            middle = float(place[inside].mean())
            axes.text(middle, 1, style.as_label(press.press), transform=axes.get_xaxis_transform(),
                      fontsize=7, ha="center", va="bottom", color=style.GREY)  # fmt: skip
