"""A film of a press: the frame, the depth on one scale throughout, and the course of depth and force.

MP4 by OpenCV's own writer; GIF by Pillow, for readers without a player and where no codec is found.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.files import replacing
from tactilevision.plots import style
from tactilevision.plots.height import extent_mm, scale_bar, titled
from tactilevision.records import Bytes, Floats, HeightMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CODEC = "mp4v"
GIF = ".gif"


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture of the film: rectified `rgb` (H, W, 3), its `height`, and fz as measured (NaN: it was not)."""

    rgb: Bytes
    height: HeightMap
    force_N: float = float("nan")


@style.house_look
def draw_film(shots: Sequence[Shot], *, title: str = "") -> Iterable[Bytes]:
    """Pictures (H, W, 3) of the film, one a shot. Raises InputError where there is no shot."""
    if not shots:
        raise InputError("there are no frames to film", where="draw_film")
    return _pictures(_Stage(shots, title), shots)


def write_film(path: Path | str, pictures: Iterable[Bytes], *, frames_per_s: float = 12.0) -> Path:
    """Write MP4, or GIF where the name says so or no codec is found; returns the file that was written."""
    path = Path(path)
    stack = [np.ascontiguousarray(picture) for picture in pictures]
    if path.suffix.lower() != GIF and _write_video(path, stack, frames_per_s):
        return path
    _write_gif(path.with_suffix(GIF), stack, frames_per_s)
    return path.with_suffix(GIF)


class _Stage:
    """The figure, made once; each shot moves what changes."""

    def __init__(self, shots: Sequence[Shot], title: str) -> None:
        first = shots[0].height
        self.figure, (self.frame, self.above, *courses) = style.new_quad(style.WIDTH_IN, 5.4, legend_in=0.35)
        self.picture = self.frame.imshow(shots[0].rgb, extent=extent_mm(first))
        self.peak = np.array([_peak(shot.height) for shot in shots])
        top = max(float(np.nanmax(self.peak, initial=0.0)), 0.02)
        self.above.set_facecolor(style.INVALID)
        self.depth = self.above.imshow(
            _known(first),
            cmap=style.DEPTH_MAP,
            vmin=-0.15 * top,
            vmax=top,
            extent=extent_mm(first),
            interpolation="none",
        )
        self.figure.colorbar(self.depth, ax=self.above, label="depth into the gel (mm)")
        scale_bar(self.above, first)
        self.above.plot([], [], "s", color=style.INVALID, mec=style.GREY, label="depth not known")
        for axes in (self.frame, self.above):
            axes.grid(False)
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
            self.now.append(axes.axvline(self.time_s[0], color=style.ORANGE, lw=1.2, label="the frame shown"))
            axes.set(xlabel="time (s)" if np.isfinite(first.time_s) else "frame", ylabel=label)
        style.legend_below(self.figure)

    def show(self, number: int, shot: Shot) -> Bytes:
        """Draw one shot."""
        self.picture.set_data(shot.rgb)
        self.depth.set_data(_known(shot.height))
        for line in self.now:
            line.set_xdata([self.time_s[number]] * 2)
        words = titled(shot.height, f"{shot.height.name}: {self.peak[number]:.3f} mm")
        self.above.set_title(words, loc="left", fontsize=10)
        return _rendered(self.figure)


def _pictures(stage: _Stage, shots: Sequence[Shot]) -> Iterable[Bytes]:
    for number, shot in enumerate(shots):
        yield stage.show(number, shot)


def _rendered(figure: Figure) -> Bytes:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    picture = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]
    rows, columns = picture.shape[0] // 2 * 2, picture.shape[1] // 2 * 2  # codecs want even sizes
    return np.asarray(picture[:rows, :columns], dtype=np.uint8).copy()


def _write_video(path: Path, stack: Sequence[Bytes], frames_per_s: float) -> bool:
    """Whether a codec was found and the film could be read again."""
    with replacing(path) as temporary:
        size = (stack[0].shape[1], stack[0].shape[0])
        writer = cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*CODEC), frames_per_s, size)
        if writer.isOpened():
            for picture in stack:
                writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
            writer.release()
            if temporary.stat().st_size > 0:
                return True
    path.unlink(missing_ok=True)
    return False


def _write_gif(path: Path, stack: Sequence[Bytes], frames_per_s: float) -> None:
    from PIL import Image

    images = [Image.fromarray(picture).quantize(colors=255) for picture in stack]
    with replacing(path) as temporary:
        images[0].save(temporary, save_all=True, append_images=images[1:], duration=1000 / frames_per_s, loop=0)


def _times(shots: Sequence[Shot]) -> Floats:
    times = np.array([shot.height.time_s for shot in shots])
    return times - times[0] if np.isfinite(times).all() else np.arange(len(shots), dtype=float)


def _known(height: HeightMap) -> Floats:
    return np.where(height.valid, height.depth_mm, np.nan).astype(np.float64)


def _peak(height: HeightMap) -> float:
    return float(np.percentile(height.depth_mm[height.valid], 99.9)) if height.valid.any() else float("nan")
