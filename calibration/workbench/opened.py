"""What a workbench was opened on: measurements, what was rejected of them, and the effects that can be added."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from calibration.effects import EFFECTS, PLAIN, get_effect
from calibration.inputs.observations import Measured, Observations
from calibration.laws.flat_punch import SILICONE_NU
from calibration.model.stages import Effect
from calibration.workbench.frames import Frames
from tactilevision.records import Estimate, Pair

Marks = tuple[tuple[str, int, int], ...]


@dataclass(frozen=True, slots=True)
class Opened:
    """Recordings as `compare` reads them.

    `paths` of the recordings; `data` all accepted presses; `bulge` and `bound` what is known of nu; `private`
    effects of the user's own and the `files` that they stand in, by key; `frames` where a recording has pictures;
    `marks` what the files were when they were read; `read_anew` all presses by the treatment that an effect of the
    picture asks for, none where frames show nothing of it; `listed` the effects that are looked for beside one's
    own.
    """

    paths: tuple[Path, ...]
    measured: tuple[Measured, ...]
    data: Observations
    bulge: Estimate | None = None
    bound: Pair | None = SILICONE_NU
    private: tuple[Effect, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    frames: tuple[Frames | None, ...] = ()
    warnings: tuple[str, ...] = ()
    marks: Marks = ()
    read_anew: Callable[[Effect], Mapping[str, Observations]] = lambda _: {}
    listed: tuple[Effect, ...] = tuple(EFFECTS.values())

    @property
    def title(self) -> str:
        """The recordings' names."""
        return ", ".join(one.recording.name for one in self.measured)

    @property
    def catalogue(self) -> list[Effect]:
        """The effects that are looked for: the listed ones and the user's own."""
        return [*self.listed, *self.private]

    def effect(self, key: str) -> Effect:
        """An effect by its key. Raises InputError for an unknown one."""
        own = next((one for one in self.private if one.key == key), None)
        return get_effect(key) if own is None else own

    def kind(self, key: str) -> str:
        """Where an effect comes from, in words."""
        if any(one.key == key for one in self.private):
            return "your own"
        return "plain error of an instrument" if key in PLAIN else "effect"


def file_marks(paths: Sequence[Path]) -> Marks:
    """Name, size and time of change of each file at the top of the recordings: other marks, other content."""
    found = []
    for path in paths:
        with suppress(OSError):  # one that goes meanwhile is as good as gone
            for file in sorted(path.iterdir()) if path.is_dir() else [path]:
                about = file.stat()
                found.append(
                    (str(file), about.st_size, about.st_mtime_ns) if file.is_file() else (str(file), 0, 0)
                )
    return tuple(found)


def what_changed(opened: Opened) -> str:
    """What has become of the files since they were read, in one sentence; empty where all is as it was."""
    found = file_marks(opened.paths) if opened.marks else ()
    now = tuple(mark for mark in found if mark[1:] != (0, 0) or mark in opened.marks)  # a new folder is none of it
    if now == opened.marks:
        return ""
    here, before = {mark[0] for mark in now}, {mark[0] for mark in opened.marks}
    gone, other = (
        sorted(before - here),
        sorted({mark[0] for mark in set(now) ^ set(opened.marks)} - (before - here)),
    )
    said = [f"{_few(names)} {words}" for names, words in ((gone, "gone"), (other, "changed or new")) if names]
    return (
        f"{' and '.join(said)} since the recording was read: the page goes on with what it read; "
        "start the workbench anew with --state to read again"
    )


def _few(names: Sequence[str]) -> str:
    """The files by name, the first few of many."""
    shown = ", ".join(Path(name).name for name in names[:3])
    return f"{shown}{f' and {len(names) - 3} more' if len(names) > 3 else ''} {'is' if len(names) == 1 else 'are'}"
