"""Live frames of a camera or a played recording, and the audit of a camera."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, Protocol, Self

import cv2
import numpy as np

from tactilevision.errors import InputError
from tactilevision.heightmap.scene_faults import blocks_grey
from tactilevision.recording.images import rgb_of
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import iter_frames
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes

# Sources of live frames: a camera of OpenCV, or a recording's pictures played at a rate.

GONE_S = 2.0  # s without a frame after which a camera counts as gone; slow ones take a tenth of it
PAUSE_S = 0.005  # s before a camera that gave no frame is read again
AUTOMATIC = 3  # value of CAP_PROP_AUTO_EXPOSURE for automatic exposure under Video4Linux
FORMATS = {"mjpeg": "MJPG", "raw": "YUYV"}  # values of --format, and their FourCC
DEFAULT_RATE_HZ = 30  # of pictures played that state none


@dataclass(frozen=True, slots=True)
class Shot:
    """One raw picture (H, W, 3) uint8, red first, its arrival on the monotonic clock, and its number."""

    rgb: Bytes
    time_s: float
    number: int
    name: str = ""


class Source(Protocol):
    """A source of shots; a camera never ends. Raises InputError where it is gone."""

    @property
    def name(self) -> str: ...

    @property
    def waits(self) -> bool:
        """Return whether it can wait for its reader; a camera cannot."""

    def shots(self) -> Iterator[Shot]: ...

    def close(self) -> None: ...


@dataclass
class Camera:
    """An open camera, by the name that the user gave."""

    capture: Any  # cv2.VideoCapture
    name: str
    waits: bool = False
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep

    def shots(self) -> Iterator[Shot]:
        """Yield its pictures. Raises InputError where none has come for GONE_S."""
        number, last_s = 0, self.clock()
        while True:
            there, bgr = self.capture.read()
            now_s = self.clock()
            if there:
                rgb = rgb_of(bgr, self.name, source="the camera", remedy="Try --format mjpeg, or raw.")
                yield Shot(rgb, now_s, number, f"{number:06d}")
                number, last_s = number + 1, now_s
            elif now_s - last_s > GONE_S:
                raise InputError(
                    "the camera has gone" if number else "the camera gives no pictures",
                    where=self.name,
                    value=f"{number} frames came",
                    remedy="Check its cable, and whether another program uses it. Earlier results are kept.",
                )
            else:
                self.sleep(PAUSE_S)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Return the warnings about the driver's settings."""
        if self.capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) == AUTOMATIC:
            return ("the camera's exposure is automatic and follows contacts: set it by hand (v4l2-ctl)",)
        return ()

    def close(self) -> None:
        """Release the camera."""
        self.capture.release()


def open_camera(number: int, *, form: str | None = None) -> Camera:
    """Open the camera of a number; `form` is "mjpeg", "raw", or None for the driver's default.

    Raises InputError where there is none, or where it does not send that form.
    """
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # the error below replaces its warnings
    try:
        capture = cv2.VideoCapture(number)
    finally:
        cv2.utils.logging.setLogLevel(level)
    name = f"camera {number}"
    if not capture.isOpened():
        remedy = "`v4l2-ctl --list-devices` lists them; a video or a folder of pictures can be played instead."
        raise InputError("no camera of that number can be opened", where="--camera", value=number, remedy=remedy)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    if form is not None:
        code = cv2.VideoWriter.fourcc(*FORMATS[form])
        capture.set(cv2.CAP_PROP_FOURCC, code)
        if int(capture.get(cv2.CAP_PROP_FOURCC)) != code:
            capture.release()
            raise InputError("the camera does not send this", where="--format", value=form, remedy="Omit it.")
    return Camera(capture, name)


@dataclass
class Played:
    """A recording played at `rate_Hz`, or, with None, as fast as it is read; unreadable frames are skipped."""

    recording: Recording
    rate_Hz: float | None = DEFAULT_RATE_HZ
    waits: bool = True
    unreadable: int = field(default=0, init=False)

    @property
    def name(self) -> str:
        """Return the recording's name."""
        return self.recording.name

    def shots(self) -> Iterator[Shot]:
        """Yield its pictures in order."""
        began = time.monotonic()
        for number, frame in enumerate(iter_frames(self.recording)):
            if self.rate_Hz is not None:
                time.sleep(max(0.0, began + number / self.rate_Hz - time.monotonic()))
            if isinstance(frame, Frame):
                yield Shot(frame.rgb, time.monotonic(), number, frame.name)
            else:
                self.unreadable += 1

    def close(self) -> None:
        """Do nothing: no file stays open."""


LAST_S = 15  # s that a source may take for its last frame; drivers give up after ten


class Newest:
    """Read a source in a thread, so that a slow reader drops frames and never lags.

    `for shot in newest` gives the newest shot each time. With `every`, a source that can wait does so for the
    reader. `came` counts the shots, `dropped` those that were not read. Errors of the source reach the reader.
    """

    def __init__(self, source: Source, *, every: bool = False) -> None:
        self.source, self.every = source, every and source.waits
        self.came = self.dropped = 0
        self._shot: Shot | None = None
        self._fault: BaseException | None = None
        self._ended = self._stopped = False
        self._turn = threading.Condition()
        self._thread = threading.Thread(target=self._take, name="camera", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *ended: object) -> None:
        with self._turn:
            self._stopped = True
            self._turn.notify_all()
        self._thread.join(LAST_S)
        self.source.close()

    def __iter__(self) -> Iterator[Shot]:
        while True:
            with self._turn:
                self._turn.wait_for(lambda: self._shot is not None or self._ended)
                shot, self._shot = self._shot, None
                self._turn.notify_all()
            if shot is not None:
                yield shot
            elif self._fault is not None:
                raise self._fault
            else:
                return

    def _take(self) -> None:
        try:
            for shot in self.source.shots():
                if not self._put(shot):
                    break
        except BaseException as fault:  # the reader gets it
            self._fault = fault
        with self._turn:
            self._ended = True
            self._turn.notify_all()

    def _put(self, shot: Shot) -> bool:
        """Hand a shot to the reader; return False where nobody reads any more."""
        with self._turn:
            if self.every:
                self._turn.wait_for(lambda: self._shot is None or self._stopped)
                if self._stopped:
                    return False
            self.came += 1
            self.dropped += self._shot is not None
            self._shot = shot
            self._turn.notify_all()
            return not self._stopped


# Audit of a camera by its first frames: rate, lost and repeated frames, exposure, compression.
#
# Exposure: the median over the picture of a frame's brightness over the first one's, which small contacts keep.
# Compression: by how much neighbours differ more across the borders of 8-pixel blocks than within them.

FRAMES = 60  # frames of an audit: a second or two
MAX_CHANGE = 0.02  # share of lost or repeated frames, and relative change of brightness, that give a warning
MAX_BLOCKS_GREY = 0.2  # grey levels: raw pictures have below .05, JPEG of any quality .3 to .7, video 1.3
STEP = 4  # px between samples of the brightness


@dataclass(frozen=True, slots=True)
class Audit:
    """Audit of consecutive frames; `rate_Hz` is NaN where their times are not a camera's."""

    frames: int
    rate_Hz: float
    lost: int
    repeated: int
    brightness_change: float
    blocks_grey: float

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what is wrong with the camera, a sentence each."""
        said, many = [], MAX_CHANGE * self.frames
        if self.lost > many:
            said.append(f"{self.lost} frames were lost between {self.frames}: the camera or its bus is busy")
        if self.repeated > many:
            said.append(f"{self.repeated} of {self.frames} frames repeat the one before: the camera is slower")
        if self.brightness_change > MAX_CHANGE:
            said.append(
                f"brightness changed by {100 * self.brightness_change:.1f} % over {self.frames} frames: is the "
                "exposure automatic, or are the lamps still warming up?"
            )
        if self.blocks_grey > MAX_BLOCKS_GREY:
            said.append(
                f"pictures are compressed: blocks differ by {self.blocks_grey:.2f} grey levels, which appear as "
                "slopes; use raw frames, or calibrate with frames compressed in the same way"
            )
        return tuple(said)

    def as_json(self) -> dict[str, Any]:
        """Return the audit for a program."""
        return asdict(self) | {"warnings": list(self.warnings)}


def audit(shots: Sequence[Shot], *, timed: bool = True) -> Audit:
    """Audit consecutive shots; unless `timed`, their times are ignored. Raises InputError for fewer than two."""
    if len(shots) < 2:
        raise InputError("an audit needs frames", where="audit", value=len(shots))
    steps = np.diff([shot.time_s for shot in shots])
    usual = float(np.median(steps)) if timed else 0.0
    lost = int(np.sum(np.maximum(np.rint(steps / usual) - 1, 0))) if usual > 0 else 0
    alike = [np.array_equal(a.rgb, b.rgb) for a, b in pairwise(shots)]
    return Audit(
        len(shots),
        1.0 / usual if usual > 0 else float("nan"),
        lost,
        int(np.sum(alike)),
        brightness_change([shot.rgb for shot in shots]),
        blocks_grey(shots[0].rgb),
    )


def brightness_change(frames: Sequence[Bytes]) -> float:
    """Return the range of the brightness of frames (H, W, 3), grey levels, relative to the first's."""
    levels = [rgb[::STEP, ::STEP].sum(axis=2, dtype=np.float64) for rgb in frames]
    lit = levels[0] > 0
    if not lit.any():
        return 0.0
    shares = [float(np.median(level[lit] / levels[0][lit])) for level in levels]
    return max(shares) - min(shares)
