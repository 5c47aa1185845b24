"""What a workbench was opened on: measurements, what was rejected of them, and the effects that can be added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
    `marks` what the files were when they were read; `listed` the effects that are looked for beside one's own.
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
        for file in sorted(path.iterdir()) if path.is_dir() else []:
            if file.is_file():
                about = file.stat()
                found.append((str(file), about.st_size, about.st_mtime_ns))
    return tuple(found)
