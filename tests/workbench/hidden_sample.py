"""A small recording with a secret: a few presses of sample_frames/hidden_material, every third sample."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "hidden_material"
KEPT = ("p01", "p02", "p03", "p05", "p07", "p08", "p39")  # one radius, three speeds, a long hold


def write_small(folder: Path) -> Path:
    """Copy it into a folder of its own."""
    folder.mkdir(parents=True)
    shutil.copyfile(SAMPLE / "recording.toml", folder / "recording.toml")
    for name, every in (("curves.csv", 3), ("presses.csv", 1)):
        with (SAMPLE / name).open(newline="") as source, (folder / name).open("w", newline="") as target:
            rows = list(csv.DictReader(source))
            table = csv.DictWriter(target, rows[0])
            table.writeheader()
            table.writerows([row for row in rows if row["press"] in KEPT][::every])
    return folder
