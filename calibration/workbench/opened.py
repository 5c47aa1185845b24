"""Measurements, frames and available effects of an open workbench."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from calibration.effects import effects_for, get_effect
from calibration.effects.private import load_effect
from calibration.inputs.observations import Measured, Observations
from calibration.model.stages import Effect
from calibration.workbench.recorded import NO_FILE, Frames, Marks, file_marks, title_of
from tactilevision.errors import InputError
from tactilevision.files.opening import real_path
from tactilevision.files.writing import remove, write_text
from tactilevision.recording.layout import some
from tactilevision.records.constants import NU_SILICONE
from tactilevision.records.measured import Estimate, Pair

OWN = "own_effects"  # folder of the effects that were written in the page
KEY = re.compile(r"""^\s+key = ["'](\w{1,60})["']""", re.MULTILINE)  # of an effect, in its text


@dataclass(frozen=True, slots=True)
class Opened:
    """Recordings as `compare` reads them.

    `observed`: all accepted presses, None until they are certified; `bulge` and `bound`: knowledge of nu;
    `private`: the user's effects, with their `files` by key; `frames` of recordings with pictures; `marks` of the
    files when they were read; `listed`: the effects to test besides the private ones, None: the catalogue's.
    """

    paths: tuple[Path, ...]
    measured: tuple[Measured, ...]
    observed: Observations | None = None
    bulge: Estimate | None = None
    bound: Pair | None = NU_SILICONE
    private: tuple[Effect, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    frames: tuple[Frames | None, ...] = ()
    warnings: tuple[str, ...] = ()
    marks: Marks = field(default_factory=dict)
    listed: tuple[Effect, ...] | None = None

    @property
    def data(self) -> Observations:
        """All accepted presses. Raises InputError before they are certified."""
        if self.observed is None:
            raise InputError("the presses are not certified", where="workbench")
        return self.observed

    @property
    def title(self) -> str:
        """Names of the recordings."""
        return title_of([one.recording for one in self.measured])

    @property
    def catalogue(self) -> list[Effect]:
        """Effects to test: the listed and the private ones."""
        return [*(effects_for(self.data) if self.listed is None else self.listed), *self.private]

    def effect(self, key: str) -> Effect:
        """Return an effect by its key. Raises InputError for an unknown one."""
        own = next((one for one in self.private if one.key == key), None)
        return get_effect(key) if own is None else own

    def kind(self, key: str) -> str:
        """Return the kind of an effect in words."""
        if any(one.key == key for one in self.private):
            return "your own"
        return "effect"


def with_own(opened: Opened, text: str, folder: Path) -> tuple[Opened, str]:
    """Return the recordings with the private effect of this text, which is written into `folder`, and its key.

    It runs as the effect of a named file does. Raises InputError for a text without a key, and as `load_effect`;
    the file is then as it was before.
    """
    found = KEY.search(text)
    if found is None:
        remedy = 'Write a line like key = "my_effect" in its class.'
        raise InputError("the effect has no key", where="your effect", remedy=remedy)
    key, file = found[1], folder / OWN / f"{found[1]}.py"
    before = file.read_text(encoding="utf-8") if file.is_file() else None
    write_text(file, text)
    try:
        effect = load_effect(file)
    except InputError:
        if before is None:
            remove(file)
        else:
            write_text(file, before)
        raise
    kept = tuple(one for one in opened.private if one.key != effect.key)
    files = {**opened.files, effect.key: str(real_path(file))}
    return replace(opened, private=(*kept, effect), files=files), key


def what_changed(opened: Opened) -> str:
    """Return a sentence on changes of the files since they were read; empty where there are none."""
    before, now = opened.marks, file_marks(opened.paths) if opened.marks else {}
    gone = sorted(before.keys() - now.keys())
    other = sorted(name for name, mark in now.items() if mark != before.get(name, NO_FILE))
    said = [f"{_few(names)} {words}" for names, words in ((gone, "gone"), (other, "changed or new")) if names]
    keeps = "the page keeps what it read; restart the workbench with --state to read again"
    return f"{' and '.join(said)} since the recording was read: {keeps}" if said else ""


def _few(names: Sequence[str]) -> str:
    """Return the files by name, the first few of many."""
    return f"{some([Path(name).name for name in names])} {'is' if len(names) == 1 else 'are'}"
