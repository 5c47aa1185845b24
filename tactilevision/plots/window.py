"""A window on height maps: frames along a slider, a profile by mouse, a difference, a surface to turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.plots import style
from tactilevision.plots.height import change_mm, deepest_place, extent_mm, titled
from tactilevision.records import Floats, HeightMap, Pair

if TYPE_CHECKING:
    from matplotlib.backend_bases import Event
    from matplotlib.figure import Figure

KEPT = 32  # maps in memory, so that going back and forth costs nothing
COARSE = 72  # points along a side of the turned surface: more make it lag behind the mouse
PROFILE_POINTS = 400  # of a profile: closer than any map's pixels
SIZE_IN = (12.0, 7.2)  # inches: with SCREEN_DPI it fits a screen of 1280 x 800
SCREEN_DPI = 100.0  # points an inch of the layout: a page's 150 makes letters that cover each other
PALE = "#e6e6e6"  # of the profile's grid lines
SHORTEST_PX = 2.0  # of a drag that is a profile, and not a click
HELP = (
    "Drag on the map: profile.   n, b: next frame, back.   m: mark this frame.   d: difference to the marked one."
)

Line = tuple[Pair, Pair]


class Window:
    """What the window shows: a frame's number, a line, and a frame marked for the difference.

    `read` makes the map (H, W), in mm, of the frame of a number; `marked` is a map to take the difference to.
    """

    def __init__(
        self,
        names: Sequence[str],
        read: Callable[[int], HeightMap],
        *,
        number: int = 0,
        marked: HeightMap | None = None,
    ) -> None:
        self.names, self.number = list(names), number
        self._read = lru_cache(maxsize=KEPT)(read)
        self.marked, self.differs = marked, marked is not None
        self.line = _through_the_deepest(self.height)
        self._dragged_from: Pair | None = None
        self._lay_out()
        self._connect()
        self.draw()

    @property
    def height(self) -> HeightMap:
        """The map of the frame that is shown."""
        return self._read(self.number)

    @property
    def shown_mm(self) -> Floats:
        """What the map shows (H, W), in mm: the depth, or its change since the marked frame; NaN if not known."""
        if self.differs and self.marked is not None:
            return change_mm(self.marked, self.height)
        return np.where(self.height.valid, self.height.depth_mm, np.nan)

    def go(self, number: int) -> None:
        """Show another frame; the line and the marked frame stay."""
        self.number = int(np.clip(number, 0, len(self.names) - 1))
        if self.slider is not None and round(self.slider.val) != self.number:
            self.slider.set_val(self.number)  # which comes back here
            return
        self.draw()

    def mark(self) -> None:
        """Keep the frame that is shown, to take differences to."""
        self.marked = self.height
        self.draw()

    def toggle(self) -> None:
        """Depth, or its change since the marked frame; the first such frame where none is marked."""
        if self.marked is None:
            self.marked = self._read(0)
        self.differs = not self.differs
        self.draw()

    @style.house_look
    def draw(self) -> None:
        """Draw all of it anew."""
        from tactilevision.errors import InputError

        try:
            shown = self.shown_mm
        except InputError as fault:
            self.differs, self.marked = False, None
            self.draw()
            self.help.set_text(str(fault))
            return
        self.help.set_text(HELP)
        self._draw_map(shown)
        self._draw_profile(shown)
        self._draw_surface(shown)
        self.figure.canvas.draw_idle()

    @style.house_look
    def _lay_out(self) -> None:
        from matplotlib.figure import Figure
        from matplotlib.widgets import Slider

        self.figure: Figure = Figure(figsize=SIZE_IN, dpi=SCREEN_DPI)
        at = self.figure.add_axes
        self.map, self.bar = at((0.06, 0.2, 0.42, 0.7)), at((0.49, 0.3, 0.012, 0.5))
        self.profile = at((0.65, 0.62, 0.32, 0.29))
        self.surface: Any = self.figure.add_subplot(position=(0.56, 0.12, 0.44, 0.42), projection="3d")
        self.surface.view_init(elev=48, azim=-62)
        self.help = self.figure.text(0.06, 0.02, HELP, color=style.GREY)
        self.slider: Slider | None = None
        if len(self.names) > 1:
            where = at((0.12, 0.075, 0.72, 0.03))
            self.slider = Slider(
                where, "frame", 0, len(self.names) - 1, valinit=self.number, valstep=1, initcolor="none"
            )

    def _connect(self) -> None:
        canvas = self.figure.canvas
        canvas.mpl_connect("button_press_event", self._pressed)
        canvas.mpl_connect("motion_notify_event", self._dragged)
        canvas.mpl_connect("button_release_event", self._released)
        canvas.mpl_connect("key_press_event", self._typed)
        if self.slider is not None:
            self.slider.on_changed(lambda value: self.go(round(value)))

    def _draw_map(self, shown: Floats) -> None:
        height = self.height
        low, high, colours, label = _scale(shown, differs=self.differs)
        self.map.clear()
        self.map.set_facecolor(style.INVALID)
        extent = extent_mm(height)
        image = self.map.imshow(
            shown, cmap=colours, vmin=low, vmax=high, extent=extent, interpolation="none", aspect="equal"
        )
        self.bar.clear()
        self.figure.colorbar(image, cax=self.bar, label=label)
        (x0, y0), (x1, y1) = self.line
        self.map.plot([x0, x1], [y0, y1], color=style.ORANGE, lw=1.6, marker="o", ms=4, label="profile")
        if np.isnan(shown).any():
            self.map.plot([], [], "s", color=style.INVALID, mec=style.GREY, label="depth not known")
        self.map.legend(loc="upper left", bbox_to_anchor=(0, -0.11), ncols=2)
        self.map.set(xlabel="x (mm)", ylabel="y (mm)", xlim=extent[:2], ylim=extent[2:])
        self.map.set_title(titled(height, self._title()))
        self.map.grid(False)
        if self.slider is not None:
            self.slider.valtext.set_text(f"{self.names[self.number]} ({self.number + 1} of {len(self.names)})")

    def _title(self) -> str:
        name = self.height.name or "Depth"
        if self.differs and self.marked is not None:
            return f"{name} minus {self.marked.name}"
        return f"{name}: depth of the gel's surface"

    def _draw_profile(self, shown: Floats) -> None:
        place, value = along(shown, self.line, mm_per_px=self.height.mm_per_px)
        self.profile.clear()
        self.profile.plot(place, value, color=style.ORANGE)
        std = self.height.std_mm
        if std is not None and not self.differs:
            _, width = along(np.asarray(std, np.float64), self.line, mm_per_px=self.height.mm_per_px)
            self.profile.fill_between(
                place, value - width, value + width, color=style.ORANGE, alpha=0.2, lw=0, label="std"
            )
            self.profile.legend(loc="best")
        self.profile.grid(color=PALE)
        self.profile.axhline(0, color=style.GREY, lw=0.8)
        self.profile.invert_yaxis()
        label = "change of depth (mm)" if self.differs else "depth into the gel (mm)"
        self.profile.set(xlabel="place along the line (mm)", ylabel=label, title="Profile along the line")

    def _draw_surface(self, shown: Floats) -> None:
        step = max(1, -(-max(shown.shape) // COARSE))
        coarse = shown[::step, ::step]
        x, y = np.meshgrid(
            *(np.arange(n) * step * s for n, s in zip(coarse.shape[::-1], self.height.mm_per_px, strict=True))
        )
        low, high, colours, _ = _scale(shown, differs=self.differs)
        self.surface.clear()
        self.surface.plot_surface(
            x, y, coarse, cmap=colours, vmin=low, vmax=high, rstride=1, cstride=1, lw=0, antialiased=False
        )
        wide = max(float(np.ptp(x)), 1e-6)
        self.surface.set_box_aspect((wide, max(float(np.ptp(y)), 1e-6), 0.3 * wide))
        self.surface.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="mm", zlim=(high, low))
        self.surface.invert_yaxis()
        self.surface.locator_params(axis="z", nbins=3)
        self.surface.set_title(f"Surface, vertical scale × {0.3 * wide / (high - low):.0f}", y=1.0)

    def _place(self, event: Any) -> Pair | None:
        if event.inaxes is not self.map or event.xdata is None:
            return None
        toolbar = getattr(self.figure.canvas, "toolbar", None)
        if toolbar is not None and toolbar.mode:  # zooming and moving have the mouse
            return None
        return float(event.xdata), float(event.ydata)

    def _pressed(self, event: Event) -> None:
        self._dragged_from = self._place(event)

    def _dragged(self, event: Event) -> None:
        place = self._place(event)
        if self._dragged_from is None or place is None:
            return
        if np.hypot(*np.subtract(place, self._dragged_from)) < SHORTEST_PX * min(self.height.mm_per_px):
            return
        self.line = (self._dragged_from, place)
        self._quick()

    def _released(self, event: Event) -> None:
        self._dragged(event)
        self._dragged_from = None

    @style.house_look
    def _quick(self) -> None:
        """While the mouse moves: the line and its profile alone."""
        shown = self.shown_mm
        self.map.lines[0].set_data(*zip(*self.line, strict=True))
        self._draw_profile(shown)
        self.figure.canvas.draw_idle()

    def _typed(self, event: Any) -> None:
        acts: dict[str, Callable[[], None]] = {
            "b": lambda: self.go(self.number - 1),
            "n": lambda: self.go(self.number + 1),
            "m": self.mark,
            "d": self.toggle,
        }
        if event.key in acts:
            acts[event.key]()


def along(field: Floats, line: Line, *, mm_per_px: Pair) -> tuple[Floats, Floats]:
    """Place in mm from the line's start, and the field (H, W) there, between pixels; NaN where it is not known.

    `line` is two places (x, y) in mm from the middle of the first pixel.
    """
    (x0, y0), (x1, y1) = line
    part = np.linspace(0, 1, PROFILE_POINTS)
    column, row = (x0 + part * (x1 - x0)) / mm_per_px[0], (y0 + part * (y1 - y0)) / mm_per_px[1]
    rows, columns = field.shape
    left, top = (
        np.clip(np.floor(place).astype(int), 0, max(count - 2, 0))
        for place, count in ((column, columns), (row, rows))
    )
    right, low = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
    u, v = np.clip(column - left, 0, 1), np.clip(row - top, 0, 1)
    above = (1 - u) * field[top, left] + u * field[top, right]
    below = (1 - u) * field[low, left] + u * field[low, right]
    return part * float(np.hypot(x1 - x0, y1 - y0)), np.asarray((1 - v) * above + v * below)


def _scale(shown: Floats, *, differs: bool) -> tuple[float, float, str, str]:
    """Bottom and top of the colours, in mm, their name, and what the bar says."""
    known = shown[np.isfinite(shown)]
    if differs:
        limit = max(float(np.percentile(np.abs(known), 99.5)), 1e-6) if known.size else 1e-6
        return -limit, limit, "PuOr", "change of depth (mm)"
    top = max(float(known.max()), 1e-3) if known.size else 1e-3
    bottom = min(float(np.percentile(known, 0.5)), 0.0) if known.size else 0.0
    return bottom, top, style.DEPTH_MAP, "depth into the gel (mm)"


def _through_the_deepest(height: HeightMap) -> Line:
    row, _ = deepest_place(height)
    y = row * height.mm_per_px[1]
    return (0.0, y), ((height.depth_mm.shape[1] - 1) * height.mm_per_px[0], y)
