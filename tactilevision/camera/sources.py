"""Where live frames come from: a camera of OpenCV, or a recording's pictures played at a rate.

A camera's frames carry the time at which they came, on this machine's monotonic clock: OpenCV tells no other one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.recording import Recording, iter_frames
from tactilevision.recording.images import check_coloured
from tactilevision.records import Bytes, Frame

GONE_S = 2.0  # s without a frame after which a camera counts as gone; slow ones take a tenth of it
PAUSE_S = 0.005  # s between two looks at a camera that gave no frame
AUTOMATIC = 3  # what CAP_PROP_AUTO_EXPOSURE says of an automatic one under Video4Linux
FORMATS = {"mjpeg": "MJPG", "raw": "YUYV"}  # our words, and the codes of four letters
DEFAULT_RATE_HZ = 30.0  # of pictures played that state none


@dataclass(frozen=True, slots=True)
class Shot:
    """One raw picture (H, W, 3) uint8, red first; `time_s` when it came; `number` counts all that came."""

    rgb: Bytes
    time_s: float
    number: int
    name: str = ""


class Source(Protocol):
    """What gives shots until it ends; a camera never does. Raises InputError where it is gone."""

    @property
    def name(self) -> str: ...

    @property
    def waits(self) -> bool:
        """Whether it can wait for its reader: a camera cannot."""
        ...

    def shots(self) -> Iterator[Shot]: ...

    def close(self) -> None: ...


class Capture(Protocol):
    """What of cv2.VideoCapture is used."""

    def read(self) -> tuple[bool, Any]: ...

    def get(self, prop: int, /) -> float: ...

    def release(self) -> None: ...


@dataclass
class Camera:
    """A camera that is open; `name` is how the user called it."""

    capture: Capture
    name: str
    waits: bool = False
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep

    def shots(self) -> Iterator[Shot]:
        """Its pictures. Raises InputError where none has come for GONE_S."""
        number, last_s = 0, self.clock()
        while True:
            there, bgr = self.capture.read()
            now_s = self.clock()
            if there:
                yield Shot(_as_rgb(bgr, self.name), now_s, number, f"{number:06d}")
                number, last_s = number + 1, now_s
            elif now_s - last_s > GONE_S:
                raise InputError(
                    "the camera has gone" if number else "the camera gives no pictures",
                    where=self.name,
                    value=f"{number} frames came",
                    remedy="Check its cable, and whether another program has it. What was written is kept.",
                )
            else:
                self.sleep(PAUSE_S)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What its driver says against it."""
        if self.capture.get(cv2.CAP_PROP_AUTO_EXPOSURE) == AUTOMATIC:
            return ("the camera's exposure is automatic: it follows contacts; set it by hand (v4l2-ctl)",)
        return ()

    def close(self) -> None:
        """Give it back."""
        self.capture.release()


def open_camera(number: int, *, form: str | None = None) -> Camera:
    """The camera of that number; `form` "mjpeg" or "raw" is what it sends, None as its driver has it.

    Raises InputError where there is none, or where it does not send that.
    """
    told = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # the error below says it in a sentence
    try:
        capture = cv2.VideoCapture(number)
    finally:
        cv2.utils.logging.setLogLevel(told)
    name = f"camera {number}"
    if not capture.isOpened():
        raise InputError(
            "no camera of that number can be opened",
            where="--camera",
            value=number,
            remedy="`v4l2-ctl --list-devices` lists them; a video or a folder of pictures goes, too.",
        )
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # old pictures are of no use
    if form is not None:
        code = cv2.VideoWriter.fourcc(*FORMATS[form])
        capture.set(cv2.CAP_PROP_FOURCC, code)
        if int(capture.get(cv2.CAP_PROP_FOURCC)) != code:
            capture.release()
            raise InputError("the camera does not send this", where="--format", value=form, remedy="Leave it out.")
    return Camera(capture, name)


@dataclass
class Played:
    """The pictures of a recording, a frame every 1 / `rate_Hz` s; those that cannot be read are left out.

    `rate_Hz` None: as fast as they are asked for.
    """

    recording: Recording
    rate_Hz: float | None = DEFAULT_RATE_HZ
    waits: bool = True
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    unreadable: int = field(default=0, init=False)

    @property
    def name(self) -> str:
        """The recording's."""
        return self.recording.name

    def shots(self) -> Iterator[Shot]:
        """Its pictures, in their order, until there are no more."""
        began = self.clock()
        for number, frame in enumerate(iter_frames(self.recording)):
            if self.rate_Hz is not None:
                self.sleep(max(0.0, began + number / self.rate_Hz - self.clock()))
            if isinstance(frame, Frame):
                yield Shot(frame.rgb, self.clock(), number, frame.name)
            else:
                self.unreadable += 1

    def close(self) -> None:
        """Nothing is held open."""


def _as_rgb(bgr: npt.NDArray[Any], name: str) -> Bytes:
    if bgr.ndim != 3 or bgr.shape[2] != 3 or bgr.dtype != np.uint8:
        raise InputError(
            "the camera gives no colours of 8 bits",
            where=name,
            value=f"{bgr.shape} {bgr.dtype}",
            remedy="Try --format mjpeg, or raw.",
        )
    return check_coloured(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8), name)
