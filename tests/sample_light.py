"""A recording that holds the sample's light and nothing pressed by the punch."""

from __future__ import annotations

import shutil
from pathlib import Path

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"


def light_of_sample(folder: Path, *, balls: int) -> Path:
    """`folder`/recording: the sample's settings, its untouched gel as the only frame, and its first `balls`."""
    target = folder / "recording"
    shutil.copytree(SAMPLE / "reference", target / "reference")
    for name in SAMPLE.iterdir():
        if name.is_file() and name.suffix in {".toml", ".npz"} and name.name != "truth.toml":
            shutil.copy(name, target)
    (target / "frames").mkdir()
    shutil.copy(next((SAMPLE / "reference" / "flat").iterdir()), target / "frames" / "0.png")
    (target / "frames.csv").write_text("frame,time_s\n0.png,0.0\n")
    table, pictures = target / "reference" / "ball.csv", target / "reference" / "ball"
    rows = table.read_text().splitlines()[: balls + 1]
    table.write_text("\n".join(rows) + "\n")
    names = {row.partition(",")[0] for row in rows[1:]}
    for path in pictures.iterdir():
        if path.name not in names:
            path.unlink()
    if not balls:
        table.unlink()
        pictures.rmdir()
    return target
