"""Views of height maps: a window, a film of a press, and a page with a surface."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from tactilevision.batch.folder import peak_mm
from tactilevision.errors import InputError
from tactilevision.files.documents import html_text as escape
from tactilevision.files.writing import remove, replacing, write_text
from tactilevision.plots import style
from tactilevision.plots.height import (
    FLAT_MM,
    RELIEF,
    VIEW,
    change_mm,
    colour_limits,
    deepest_place,
    extent_mm,
    known_mm,
    relief,
    scale_bar,
    titled,
)
from tactilevision.plots.style import LOOK
from tactilevision.records.constants import KILO, MILLI
from tactilevision.records.maps import MEANING, HeightMap
from tactilevision.records.measured import Bytes, Floats, Pair

if TYPE_CHECKING:
    from matplotlib.backend_bases import Event
    from matplotlib.figure import Figure


# A window with frames along a slider, a profile by mouse, a difference, and a surface to turn.

KEPT = 32  # maps in memory
COARSE = 72  # points along a side of the turned surface: more make it lag behind the mouse
PROFILE_POINTS = 400  # of a profile: closer than any map's pixels
SIZE_IN = (12, 7.2)  # inches: with SCREEN_DPI it fits a screen of 1280 x 800
SCREEN_DPI = 100  # points an inch of the layout: a page's 150 makes letters that cover each other
SHORTEST_PX = 2  # of a drag that is a profile, and not a click
DEPTH, CHANGE = "depth into the gel (mm)", "change of depth (mm)"
HELP = (
    "Drag on the map: profile.   n, b: next frame, back.   m: mark this frame.   d: difference to the marked one."
)

Line = tuple[Pair, Pair]


class Window:
    """A window that shows a frame's height map, a profile along a line, and a difference to a marked frame.

    `read` returns the map (H, W), in mm, of the frame of a number; `marked` is a map to take the difference to.
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
        """Return the map of the frame that is shown."""
        return self._read(self.number)

    @property
    def shown_mm(self) -> Floats:
        """Return the depth (H, W), in mm, or its change since the marked frame; NaN where it is not known."""
        if self.differs and self.marked is not None:
            return change_mm(self.marked, self.height)
        return known_mm(self.height)

    def go(self, number: int) -> None:
        """Show another frame; the line and the marked frame stay."""
        self.number = int(np.clip(number, 0, len(self.names) - 1))
        if self.slider is not None and round(self.slider.val) != self.number:
            self.slider.set_val(self.number)  # which comes back here
            return
        self.draw()

    def mark(self) -> None:
        """Mark the frame that is shown, to take differences to."""
        self.marked = self.height
        self.draw()

    def toggle(self) -> None:
        """Switch between depth and its change since the marked frame, or since the first where none is marked."""
        if self.marked is None:
            self.marked = self._read(0)
        self.differs = not self.differs
        self.draw()

    @style.house_look
    def draw(self) -> None:
        """Redraw everything."""
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

        def place(left: int, bottom: int, width: int, height: int) -> tuple[float, float, float, float]:
            """Return a place from percent of the window."""
            return left / 100, bottom / 100, width / 100, height / 100

        at = self.figure.add_axes
        self.map, self.bar = at(place(6, 20, 42, 70)), at(place(49, 30, 1, 50))
        self.profile = at(place(65, 62, 32, 29))
        self.surface: Any = self.figure.add_subplot(position=place(56, 12, 44, 42), projection="3d")
        self.surface.view_init(**VIEW)
        self.help = self.figure.text(*place(6, 2, 0, 0)[:2], HELP, color=style.GREY)
        self.slider: Slider | None = None
        if len(self.names) > 1:
            where = at(place(12, 7, 72, 3))
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
        self.map.clear()
        extent = extent_mm(height)
        image = style.show_map(self.map, shown, extent, **self._colours(shown))
        self.bar.clear()
        self.figure.colorbar(image, cax=self.bar, label=self._label)
        (x0, y0), (x1, y1) = self.line
        self.map.plot([x0, x1], [y0, y1], color=style.ORANGE, marker="o", label="profile")
        if np.isnan(shown).any():
            style.unknown_entry(self.map)
        self.map.legend(loc="upper left", bbox_to_anchor=(0, -LOOK.room), ncols=2)
        self.map.set(xlim=extent[:2], ylim=extent[2:])
        style.as_map(self.map, title=titled(height, self._title(), between=" · "))
        if self.slider is not None:
            self.slider.valtext.set_text(f"{self.names[self.number]} ({self.number + 1} of {len(self.names)})")

    @property
    def _label(self) -> str:
        return CHANGE if self.differs else DEPTH

    def _colours(self, shown: Floats) -> dict[str, Any]:
        limits = colour_limits(shown, differs=self.differs)
        return {"limits": limits, "cmap": "PuOr" if self.differs else style.DEPTH_MAP}

    def _title(self) -> str:
        if self.differs and self.marked is not None:
            return f"depth minus that of {self.marked.name}"
        return "depth of the gel's surface"

    def _draw_profile(self, shown: Floats) -> None:
        place, value = along(shown, self.line, mm_per_px=self.height.mm_per_px)
        self.profile.clear()
        self.profile.plot(place, value, color=style.ORANGE)
        std = self.height.std_mm
        if std is not None and not self.differs:
            _, width = along(np.asarray(std, np.float64), self.line, mm_per_px=self.height.mm_per_px)
            low, high = value - width, value + width
            self.profile.fill_between(place, low, high, color=style.ORANGE, alpha=LOOK.band, lw=0, label="std")
            self.profile.legend(loc="lower right", bbox_to_anchor=(1, 1))
        self.profile.grid(color=style.GRID)
        style.zero_line(self.profile)
        self.profile.invert_yaxis()
        self.profile.set(xlabel="place along the line (mm)", ylabel=self._label, title="Profile along the line")

    def _draw_surface(self, shown: Floats) -> None:
        self.surface.clear()
        scale = relief(self.surface, shown, self.height.mm_per_px, most=COARSE, **self._colours(shown))
        self.surface.set_title(f"Surface, vertical scale × {scale:.0f}", y=1.0)

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
        """Redraw the line and its profile alone, while the mouse moves."""
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
    """Return places in mm from the line's start, and the field (H, W) there, interpolated bilinearly.

    `line` is two places (x, y) in mm from the middle of the first pixel. Unknown (NaN) pixels give NaN.
    """
    from scipy.ndimage import map_coordinates

    (x0, y0), (x1, y1) = line
    part = np.linspace(0, 1, PROFILE_POINTS)
    at_px = np.stack([(y0 + part * (y1 - y0)) / mm_per_px[1], (x0 + part * (x1 - x0)) / mm_per_px[0]])
    value = map_coordinates(np.asarray(field, np.float64), at_px, order=1, mode="nearest")
    return part * float(np.hypot(x1 - x0, y1 - y0)), np.asarray(value)


def _through_the_deepest(height: HeightMap) -> Line:
    row, _ = deepest_place(height)
    y = row * height.mm_per_px[1]
    return (0.0, y), ((height.depth_mm.shape[1] - 1) * height.mm_per_px[0], y)


# A film of a press: MP4 by OpenCV, or GIF by Pillow.

CODEC = "mp4v"
GIF = ".gif"


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture of a film: rectified `rgb` (H, W, 3), its `height`, and the measured fz (NaN: none)."""

    rgb: Bytes
    height: HeightMap
    force_N: float = float("nan")


@style.house_look
def draw_film(shots: Sequence[Shot], *, title: str = "") -> Iterable[Bytes]:
    """Return the pictures (H, W, 3) of the film, one a shot. Raises InputError for no shots."""
    if not shots:
        raise InputError("there are no frames for a film", where="draw_film")
    stage = _Stage(shots, title)
    return (stage.show(number, shot) for number, shot in enumerate(shots))


def write_film(path: Path | str, pictures: Iterable[Bytes], *, frames_per_s: float = 12) -> Path:
    """Write MP4, or GIF where the name ends in .gif or no codec is found; returns the file written."""
    path = Path(path)
    stack = [np.ascontiguousarray(picture) for picture in pictures]
    if path.suffix.lower() != GIF and _write_video(path, stack, frames_per_s):
        return path
    _write_gif(path.with_suffix(GIF), stack, frames_per_s)
    return path.with_suffix(GIF)


class _Stage:
    """The figure of a film, made once; each shot replaces its data."""

    def __init__(self, shots: Sequence[Shot], title: str) -> None:
        first = shots[0].height
        self.figure, (self.frame, self.above, *courses) = style.new_quad(legend_in=0.5)
        self.picture = self.frame.imshow(shots[0].rgb, extent=extent_mm(first))
        self.peak = np.array([peak_mm(shot.height) for shot in shots])
        top = max(float(np.nanmax(self.peak, initial=0.0)), FLAT_MM)
        limits = (-LOOK.room * top, top)
        self.depth = style.show_map(self.above, known_mm(first), extent_mm(first), limits=limits)
        self.figure.colorbar(self.depth, ax=self.above, label=DEPTH)
        scale_bar(self.above, first)
        style.unknown_entry(self.above)
        for axes in (self.frame, self.above):
            style.as_map(axes, "", "")
            axes.set(xticks=[], yticks=[])
        self.frame.set_title(title or first.name)
        self.time_s = _times(shots)
        force = np.array([shot.force_N for shot in shots])
        self.now = []
        shown = ((self.peak, "greatest depth (mm)", style.BLUE), (force, "F/T sensor's fz (N)", style.YELLOW))
        for axes, (values, label, colour) in zip(courses, shown, strict=True):
            if not np.isfinite(values).any():
                axes.set_axis_off()
                continue
            axes.plot(self.time_s, values, color=colour, label=label.rpartition(" ")[0])
            self.now.append(
                axes.axvline(self.time_s[0], color=style.ORANGE, lw=LOOK.line, label="the frame shown")
            )
            axes.set(xlabel="time (s)" if np.isfinite(first.time_s) else "frame", ylabel=label)
        style.legend_below(self.figure)

    def show(self, number: int, shot: Shot) -> Bytes:
        """Return the picture (H, W, 3) of one shot."""
        self.picture.set_data(shot.rgb)
        self.depth.set_data(known_mm(shot.height))
        for line in self.now:
            line.set_xdata([self.time_s[number]] * 2)
        words = titled(shot.height, f"{self.peak[number]:.3f} mm", between=" · ")
        self.above.set_title(words, loc="left", fontsize=LOOK.text)
        return _rendered(self.figure)


def _rendered(figure: Figure) -> Bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    picture = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
    rows, columns = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2  # codecs want even sizes
    return np.asarray(picture[:rows, :columns], dtype=np.uint8).copy()


def _write_video(path: Path, stack: Sequence[Bytes], frames_per_s: float) -> bool:
    """Write MP4; return False where there is no codec."""
    with replacing(path) as temporary:
        size = (stack[0].shape[1], stack[0].shape[0])
        writer = cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*CODEC), frames_per_s, size)
        if writer.isOpened():
            for picture in stack:
                writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
            writer.release()
            if temporary.stat().st_size > 0:
                return True
    remove(path)
    return False


def _write_gif(path: Path, stack: Sequence[Bytes], frames_per_s: float) -> None:
    from PIL import Image

    images = [Image.fromarray(picture).quantize(colors=255) for picture in stack]
    with replacing(path) as temporary:
        images[0].save(temporary, save_all=True, append_images=images[1:], duration=1000 / frames_per_s, loop=0)


def _times(shots: Sequence[Shot]) -> Floats:
    times = np.array([shot.height.time_s for shot in shots])
    return times - times[0] if np.isfinite(times).all() else np.arange(len(shots), dtype=float)


# One self-contained page: a height map as a surface to turn, its facts, its pictures.

MAX_POINTS = 240  # along a side of the surface: finer than a screen shows, and the page stays below 1 MB
UNKNOWN_UM = -32768  # no depth comes near: 33 mm out of the gel


def write_surface_page(folder: Path | str, height: HeightMap, pictures: Sequence[Path] = ()) -> Path:
    """Write NAME.html with the surface (H, W), in mm, and PNG `pictures` that exist; returns the file."""
    path = Path(folder) / f"{Path(height.name).stem or 'height'}.html"
    write_text(path, surface_page(height, pictures))
    return path


def surface_page(height: HeightMap, pictures: Sequence[Path] = ()) -> str:
    """Return the page of a map (H, W), in mm. Its text is escaped, and its data are numbers."""
    shown = "".join(
        f'<figure><img alt="{escape(path.stem)}" src="{style.data_uri(path, photograph=True)}"></figure>'
        for path in pictures
    )
    parts = {
        "@NAME@": escape(height.name or "Height map"),
        "@DOUBTS@": "".join(f'<p class="doubt">Doubtful: {escape(MEANING[flag])}.</p>' for flag in height.flags),
        "@FACTS@": "".join(f"<dt>{name}</dt><dd>{escape(value)}</dd>" for name, value in _facts(height).items()),
        "@PICTURES@": shown,
        "@DATA@": json.dumps(_data(height)),
    }
    page = files("tactilevision.plots").joinpath("surface_page.html").read_text(encoding="utf-8")
    for mark, text in parts.items():
        page = page.replace(mark, text)
    return page


def _facts(height: HeightMap) -> dict[str, str]:
    rows, columns = height.depth_mm.shape
    wide, tall = columns * height.mm_per_px[0], rows * height.mm_per_px[1]
    facts = {
        "picture": f"{columns} × {rows} px, {wide:.4g} × {tall:.4g} mm",
        "known": f"{100 * float(height.valid.mean()):.1f} % of the picture",
    }
    if height.valid.any():
        row, column = deepest_place(height)
        x, y = column * height.mm_per_px[0], row * height.mm_per_px[1]
        depth = f"{height.depth_mm[row, column]:.3f}"
        std = "" if height.std_mm is None else f" ± {height.std_mm[row, column]:.3f}"
        facts["depth in the middle of the deepest tenth"] = f"{depth}{std} mm, at x {x:.2f}, y {y:.2f} mm"
    return facts


def _data(height: HeightMap) -> dict[str, object]:
    """Return the surface on a coarser grid, as whole micrometres in base64, with scale and colours."""
    import matplotlib as mpl

    step = max(1, -(-max(height.depth_mm.shape) // MAX_POINTS))
    depth_um = np.where(height.valid, np.clip(KILO * height.depth_mm, -32000, 32000), UNKNOWN_UM)[::step, ::step]
    rows, columns = depth_um.shape
    bottom, top = colour_limits(MILLI * depth_um[depth_um > UNKNOWN_UM])
    colours = np.round(255 * mpl.colormaps[style.DEPTH_MAP](np.linspace(0, 1, 64))[:, :3]).astype(int)
    return {
        "rows": rows,
        "columns": columns,
        "step_mm": [step * one for one in height.mm_per_px],
        "bottom_mm": bottom,
        "top_mm": top,
        "unknown": UNKNOWN_UM,
        "relief": RELIEF,
        "colours": colours.tolist(),
        "depth_um": base64.b64encode(np.round(depth_um).astype("<i2").tobytes()).decode(),
    }
