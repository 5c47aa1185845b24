"""Fill numbers and pictures of the pages with what their commands give: `make walks`.

A page of `walks/` is run as printed: its blocks that begin with `tactilevision` are commands, and an indented
block ends the effect that the command before it wrote. Pictures `walk_NAME_FIGURE.png` are figures of the walks.

`numbers.txt` states the numbers of each page, in the order in which they stand there:

    57.2 = hidden_material/diagnosis/diagnosis held_out_N.0 *1000 .1f

that is: the text, the JSON file and the key in it, a factor, the format.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
WALKS = sorted(page for page in (DOCS / "walks").glob("hidden_*.md"))
STATED = DOCS / "numbers.txt"
LINE = re.compile(r"^(?P<text>\S+) = (?P<file>\S+) (?P<key>\S+)(?: \*(?P<factor>\S+))? (?P<form>\.\d[fg])$")


@dataclass(frozen=True)
class Number:
    """One number of a page: its text, and where it comes from."""

    text: str
    file: str
    key: str
    factor: float
    form: str

    def filled(self, values: Callable[[str, str], Any]) -> Number:
        """The number as the commands give it now."""
        text = format(float(values(self.file, self.key)) * self.factor, self.form)
        return replace(self, text=text.replace("-", "−"))

    def line(self) -> str:
        """Its line in `numbers.txt`."""
        factor = "" if self.factor == 1 else f" *{self.factor:g}"
        return f"{self.text} = {self.file} {self.key}{factor} {self.form}"


def stated() -> dict[str, list[Number]]:
    """The numbers of each page; a ValueError names a line that cannot be read."""
    pages: dict[str, list[Number]] = {}
    for line in STATED.read_text(encoding="utf-8").splitlines():
        if line.startswith("["):
            numbers = pages.setdefault(line.strip("[]"), [])
        elif line and not line.startswith("#"):
            parts = LINE.match(line)
            if parts is None:
                raise ValueError(f"not a number's line: {line}")
            words = (parts["text"], parts["file"], parts["key"], float(parts["factor"] or 1), parts["form"])
            numbers.append(Number(*words))
    return pages


def places(page: str, numbers: list[Number]) -> Iterator[tuple[int, int]]:
    """Where each number stands in the text, one after the other; a ValueError names one that does not."""
    at = 0
    for number in numbers:
        found = re.compile(rf"(?<![\d.]){re.escape(number.text)}(?!\d|\.\d)").search(page, at)
        if found is None:
            raise ValueError(f"{number.text} does not stand in its page where numbers.txt has it: {number.line()}")
        yield found.span()
        at = found.end()


def fill(values: Callable[[str, str], Any]) -> None:
    """Write every stated number into its page and into `numbers.txt`, as `values(file, key)` has it."""
    lines = [line for line in STATED.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    for name, numbers in stated().items():
        page = (DOCS / name).read_text(encoding="utf-8")
        now = [number.filled(values) for number in numbers]
        for (start, end), number in reversed(list(zip(places(page, numbers), now, strict=True))):
            page = page[:start] + number.text + page[end:]
        (DOCS / name).write_text(page, encoding="utf-8")
        lines += ["", f"[{name}]", *(number.line() for number in now)]
    STATED.write_text("\n".join(lines) + "\n", encoding="utf-8")


def key_of(content: Any, key: str) -> Any:
    """The value at `a.0.b`, where a name may hold a dot."""
    if not key:
        return content
    names = [str(at) for at in range(len(content))] if isinstance(content, list) else list(content)
    name = max((name for name in names if f"{key}.".startswith(f"{name}.")), key=len, default=None)
    if name is None:
        raise KeyError(key)
    return key_of(content[int(name) if isinstance(content, list) else name], key[len(name) + 1 :])


def run(page: Path, into: Path) -> None:
    """Run a walk's commands in an own folder."""
    into.mkdir()
    (into / "sample_frames").symlink_to(DOCS.parent / "sample_frames")
    written = ""
    for block in re.findall(r"^```\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE):
        if block.startswith("    "):
            effect = into / written
            effect.write_text(
                re.sub(r"    # the first parameter.*", "", effect.read_text(), flags=re.DOTALL) + block
            )
            continue
        for line in block.splitlines():
            _, *words = shlex.split(line)
            written = words[1] if words[0] == "new-effect" else written
            print("$", line, flush=True)
            subprocess.run((sys.executable, "-m", "tactilevision", *words, "--quiet"), cwd=into, check=True)


def main() -> None:
    """Run every walk; fill its numbers, those of other pages, and the pictures."""
    from pictures import write_pictures

    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        for page in WALKS:
            run(page, folder / page.stem)
        sample = ("calibrate", str(DOCS.parent / "sample_frames" / "gelslim3"), "--out", str(folder / "sample"))
        subprocess.run((sys.executable, "-m", "tactilevision", *sample, "--quiet"), check=True)

        def values(file: str, key: str) -> Any:
            return key_of(json.loads((folder / f"{file}.json").read_text()), key)

        fill(values)
        for picture in (DOCS / "images").glob("walk_*_*.png"):
            _, name, figure = picture.stem.split("_", 2)
            made = sorted((folder / f"hidden_{name}").glob(f"*/{figure}.png"))
            shutil.copy(made[0], picture)  # of `comparison_out` before `diagnosis`
        write_pictures(folder / "sample" / "calibration.json")


if __name__ == "__main__":
    main()
