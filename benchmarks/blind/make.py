"""Makes one recording of the blind test: python -m benchmarks.blind.make FOLDER --seed N [--hidden KEY] ..."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.blind.cases import LEVELS, Case, make
from benchmarks.blind.design import DESIGNS
from benchmarks.blind.world import HIDDEN


def main(arguments: Sequence[str] = ()) -> None:
    """Draw the world from the seed, hide what is asked for, and write the recording."""
    options = _options().parse_args(list(arguments))
    case = Case(options.seed, tuple(options.hidden), options.design, options.level, options.noise, options.gel,
                options.source)  # fmt: skip
    options.folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.folder.parent) as folder:
        make(case, Path(folder), rivals=False).folder.rename(options.folder)


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.make", description=__doc__)
    parser.add_argument("folder", type=Path, help="of the recording; made")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--hidden", action="append", default=[], choices=sorted(HIDDEN), help="an effect to hide")
    parser.add_argument("--design", default="rich", choices=sorted(DESIGNS))
    parser.add_argument("--level", default="one", choices=sorted(LEVELS))
    parser.add_argument("--noise", default="white", choices=("white", "ar1", "heavy"))
    parser.add_argument("--gel", default="law", choices=("law", "fem"))
    parser.add_argument("--source", default="", choices=("", "vision", "stage", "gauge"))
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
