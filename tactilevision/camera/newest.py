"""Only the newest frame: a thread takes all that come, so that a slow reader drops frames and never lags."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Self

from tactilevision.camera.sources import Shot, Source

LAST_S = 15.0  # s that a source may take over its last frame; drivers give up after ten


class Newest:
    """A source read in a thread of its own: `for shot in newest` gives the newest one each time.

    `every` waits for the reader instead, so that no frame is lost; only for a source that waits. `came` counts
    the shots, `dropped` those that no reader saw. What goes wrong with the source is raised to the reader.
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

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
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
        """Leave it for the reader; False where nobody reads any more."""
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
