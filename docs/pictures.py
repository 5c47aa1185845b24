"""Draw the two pictures of the README: what is read from a frame, and the falling error (`make walks`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

from calibration.report.misfit import error_fall_of_comparison, force_curves
from tactilevision import (
    ForceField,
    build_reconstructor,
    compare_recordings,
    read_frame,
    read_material,
    read_recording,
)
from tactilevision.plots import style
from tactilevision.plots.height import colour_limits, deepest_place, known_mm, relief

IMAGES = Path(__file__).parent / "images"
SAMPLES = Path(__file__).parents[1] / "sample_frames"
FRAME = 96  # of the sample: a press at its deepest
HELD, MOVED = 18, 20  # pictures of the fall that stand, and that move
REACH_MM = 5.5  # of the relief about its deepest place
MILLI = 1000  # mN in a newton, kPa in a MPa


def plain(axes: Axes, title: str, under: str) -> None:
    """Show a picture alone, with words above and below."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    axes.set_title(title, fontsize=13, loc="center", pad=8)
    axes.set_xlabel(under, fontsize=11, color="#444444", labelpad=8)


@style.house_look
def draw_hero(calibration: Path) -> Figure:
    """A frame, the relief read from it, and the force on the gel."""
    recording = read_recording(SAMPLES / "gelslim3")
    frame = read_frame(recording, FRAME)
    height = build_reconstructor(recording).height_map(frame)
    material = read_material(calibration)
    found = ForceField(recording.sensor.gel, material, height.mm_per_px)(height)
    figure = Figure(figsize=(11, 3.6), dpi=100)
    seen, shape, force = (figure.add_axes((left, 0.19, 0.27, 0.62)) for left in (0.02, 0.365, 0.71))
    seen.imshow(frame.rgb)
    plain(seen, "The camera sees the gel", "colour: slope of the surface")
    row, column = deepest_place(height)
    reach = round(REACH_MM / height.mm_per_px[0])
    near = np.s_[max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach]
    surface = Axes3D(figure, rect=(0.335, 0.10, 0.33, 0.80))
    figure.add_axes(surface)
    depth = known_mm(height)[near]
    relief(surface, depth, height.mm_per_px, most=200, limits=colour_limits(depth))
    surface.view_init(elev=42, azim=-70)
    surface.set_box_aspect(surface._box_aspect, zoom=1.22)
    surface.set_axis_off()
    plain(shape, "Its shape", f"{height.depth_mm.max():.2f} mm deep")
    shape.set_zorder(surface.get_zorder() + 1)
    shape.patch.set_visible(False)
    kPa = MILLI * np.nan_to_num(found.t_z)
    force.imshow(kPa, cmap="OrRd", vmin=0, interpolation="bicubic")
    plain(force, "The force on it", f"{found.resultant_N[2]:.2f} N, up to {kPa.max():.0f} kPa")
    for left in (0.30, 0.645):
        figure.text(left + 0.025, 0.5, "→", fontsize=26, color=style.ORANGE, ha="center", va="center")
    return figure


@style.house_look
def draw_fall() -> tuple[Figure, FuncAnimation]:
    """One press, measured and modelled, and the error on held-out presses, as an effect is added."""
    found = compare_recordings(SAMPLES / "hidden_material", ["viscoelasticity"])
    fall = error_fall_of_comparison(found)
    curves = force_curves({one.name: one.fitted for one in found.models})
    press = max(curves.presses, key=lambda one: float(one.rms_N[0]))
    before, after = press.modelled_N
    first, last = (MILLI * error for error in fall.error)
    figure = Figure(figsize=(8, 3.4), dpi=100, layout="constrained")
    chart, bars = figure.subplots(1, 2, width_ratios=(3, 2))
    chart.plot(press.time_s, press.measured_N, ".", color="black", ms=3, label="measured")
    (line,) = chart.plot(press.time_s, before, color=style.ORANGE, lw=2, label="model")
    chart.set(xlabel="time (s)", ylabel="force (N)")
    key = chart.legend(loc="lower center", frameon=False).get_lines()[-1]
    if fall.band is not None:
        bars.axhspan(*(MILLI * end for end in fall.band), color=style.INVALID, label="repeated presses")
    (bar,) = bars.bar([0], [first], width=0.5, color=style.ORANGE)
    said = bars.text(0, first, "", ha="center", va="bottom", fontsize=15)
    bars.set(xlim=(-1, 1), ylim=(0, 1.35 * first), xticks=[], ylabel="error on held-out presses (mN)")
    bars.legend(loc="upper right", frameon=False)
    added = f"+ {found.models[-1].effects[-1]}"

    def show(picture: int) -> None:
        share = min(max((picture - HELD) / MOVED, 0.0), 1.0)
        share = share * share * (3 - 2 * share)
        colour = style.ORANGE if picture < HELD else style.BLUE
        line.set_ydata((1 - share) * before + share * after)
        error = (1 - share) * first + share * last
        bar.set_height(error)
        for artist in (line, key, bar):
            artist.set_color(colour)
        said.set_text(f"{error:.1f}")
        said.set_y(error)
        title = "Base model" if picture < HELD else f"Base model {added}"
        chart.set_title(title, color=colour, fontsize=13)

    return figure, FuncAnimation(figure, show, 2 * HELD + MOVED, blit=False)


def write_pictures(calibration: Path) -> None:
    """Write `hero.png` and `fall.gif`; `calibration` is that of the sample."""
    draw_hero(calibration).savefig(IMAGES / "hero.png")
    _, moving = draw_fall()
    moving.save(IMAGES / "fall.gif", writer=PillowWriter(fps=12))
