"""Pictures of force on the gel: tractions, deformation with arrows, resultant against time, and what E and nu
do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.force.calibrated import Sensitivity
from tactilevision.plots import style
from tactilevision.plots.height import depth_image
from tactilevision.records import Floats, HeightMap, ShearMap, TractionMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMES = ("x", "y", "z")


@style.house_look
def draw_force(found: TractionMap, height: HeightMap, shear: ShearMap | None = None, *, title: str = "") -> Figure:
    """Four maps: depth with the motion of the surface and the force's arrows, then t_x, t_y and t_z."""
    figure, axes = style.new_figure(11, 8, rows=2, columns=2)
    image = depth_image(axes[0], height)
    figure.colorbar(image, ax=axes[0], label="depth into the gel (mm)", shrink=0.8)
    if shear is not None:
        _motion_arrows(axes[0], shear)
    _force_arrows(axes[0], found, height)
    axes[0].set_title(title or found.name or "Depth, surface motion (white), force (orange)")
    fields = (found.t_x, found.t_y, found.t_z)
    tangential = max(
        (float(np.nanmax(np.abs(t), initial=0.0)) for t in fields[:2] if np.isfinite(t).any()), default=0
    )
    for axis, field, name in zip(axes[1:], fields, NAMES, strict=True):
        limit = max(float(np.nanmax(np.abs(field), initial=0.0)) if name == "z" else tangential, 1e-6)
        _traction_image(figure, axis, found, 1e3 * field, 1e3 * limit, name)
    return figure


@style.house_look
def draw_resultants(time_s: Floats, force_N: Floats, std_N: Floats, measured_N: Floats | None = None) -> Figure:
    """Resultant (T, 3) against time with two standard deviations, and the F/T reading where there is one."""
    figure, axes = style.new_figure(8, 6.5, rows=3)
    for axis, name, colour, k in zip(axes, NAMES, (style.BLUE, style.GREEN, style.ORANGE), range(3), strict=True):
        axis.plot(time_s, force_N[:, k], color=colour, label="from the picture")
        low, high = (force_N[:, k] + s * 2 * std_N[:, k] for s in (-1, 1))
        axis.fill_between(time_s, low, high, color=colour, alpha=0.2, lw=0)
        if measured_N is not None and np.isfinite(measured_N[:, k]).any():
            axis.plot(time_s, measured_N[:, k], color=style.GREY, lw=1, ls="--", label="F/T sensor")
        axis.set(ylabel=f"f{name} (N)")
    axes[0].legend(loc="upper left", ncols=2)
    axes[0].set_title("Force on the gel, with two standard deviations")
    axes[-1].set(xlabel="time (s)")
    return figure


@style.house_look
def draw_sensitivity(found: TractionMap, ranges: Sequence[Sensitivity]) -> Figure:
    """How far the resultant's size moves over the 95 % interval of each parameter: why calibration matters."""
    figure, (axes,) = style.new_figure(6.5, 2.6)
    now = float(np.sqrt(np.nansum(np.square(found.resultant_N))))
    for row, entry in enumerate(ranges):
        sizes = np.sqrt(np.nansum(np.square(entry.force_N), axis=1))
        change = 100 * (sizes / now - 1) if now > 0 else np.zeros(2)
        axes.barh(row, change[1] - change[0], left=change[0], color=style.CYCLE[row], height=0.5)
        span = f"{entry.values[0]:.4g} to {entry.values[1]:.4g} {entry.unit}".strip()
        axes.annotate(span, (float(change.max()), row), xytext=(5, 0), textcoords="offset points", va="center")
    axes.axvline(0, color=style.GREY, lw=0.8)
    axes.set_yticks(range(len(ranges)), [entry.parameter.replace("_", " ") for entry in ranges])
    axes.margins(x=0.35)
    axes.set(
        xlabel="change of the resultant (%)", title="What the calibration's own 95 % interval does to the force"
    )
    return figure


def _traction_image(
    figure: Figure, axes: Axes, found: TractionMap, field_kPa: Floats, limit: float, name: str
) -> None:
    rows, columns = field_kPa.shape
    sx, sy = found.mm_per_px
    left, top = found.first_mm[0] - sx / 2, found.first_mm[1] - sy / 2
    extent = (left, left + columns * sx, top + rows * sy, top)
    low, colours = (0.0, style.DEPTH_MAP) if name == "z" else (-limit, "PuOr")
    axes.set_facecolor(style.INVALID)
    image = axes.imshow(field_kPa, cmap=colours, vmin=low, vmax=limit, extent=extent, interpolation="none")
    figure.colorbar(image, ax=axes, label=f"t_{name} (kPa)", shrink=0.8)
    force, std = found.resultant_N[NAMES.index(name)], found.resultant_std_N[NAMES.index(name)]
    said = f"{force:.3f} ± {std:.3f} N" if np.isfinite(force) else "not measured"
    axes.set_title(f"traction along {name}: {said}")
    axes.grid(False)
    axes.set(xlabel="x on the pad (mm)", ylabel="y on the pad (mm)")


def _motion_arrows(axes: Axes, shear: ShearMap) -> None:
    rows, columns = shear.u_x_mm.shape
    step = max(1, max(rows, columns) // 24)
    y, x = np.mgrid[step // 2 : rows : step, step // 2 : columns : step]
    known = shear.valid[y, x]
    u, v = shear.u_x_mm[y, x][known], shear.u_y_mm[y, x][known]
    sx, sy = shear.mm_per_px
    largest = float(np.hypot(u, v).max(initial=0.0))
    if largest > 0:
        axes.quiver(x[known] * sx, y[known] * sy, u, v, color="white", angles="xy", scale_units="xy",
                    scale=largest / (1.5 * step * min(sx, sy)), width=0.002)  # fmt: skip
        axes.text(0.99, 0.01, f"longest arrow {1e3 * largest:.0f} µm", color="white", transform=axes.transAxes,
                  ha="right", va="bottom", fontsize=8)  # fmt: skip


def _force_arrows(axes: Axes, found: TractionMap, height: HeightMap) -> None:
    """Tangential traction on the cells that touch, on the height map's own axes."""
    if not np.isfinite(found.t_x).all():
        return
    rows, columns = np.nonzero(np.nan_to_num(found.t_z) > 0)
    t = np.stack([found.t_x[rows, columns], found.t_y[rows, columns]])
    largest = float(np.hypot(*t).max(initial=0.0))
    if largest == 0:
        return
    middle = [(n - 1) / 2 * s for n, s in zip(height.depth_mm.shape[::-1], height.mm_per_px, strict=True)]
    x = found.first_mm[0] + columns * found.mm_per_px[0] + middle[0]
    y = found.first_mm[1] + rows * found.mm_per_px[1] + middle[1]
    axes.quiver(x, y, *t, color=style.ORANGE, angles="xy", scale_units="xy",
                scale=largest / (3 * found.mm_per_px[0]), width=0.003)  # fmt: skip
