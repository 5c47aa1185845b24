"""A sample of a few MB from a whole rendered recording: its good presses, JPEG frames, its truth kept beside.

Frames are JPEG with colours at full resolution; of the forces what lies near the presses stays.
"""

from __future__ import annotations

import csv
import io
import shutil
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w

from tactilevision.files.writing import write_text
from tactilevision.recording.read import read_recording

QUALITY = 88  # of JPEG: its noise in a slope is then a tenth of the path tracer's
NEAR_S = 1.0  # s of forces before and after a press: enough for its zero
FLATS = 2  # pictures of the untouched gel that are kept
Row = Mapping[str, Any]
HIDDEN = {"cast_shadow": {"amount": 1.0, "unit": "share of the light", "catalogued": True}}
README = """# hidden_shadow: presses drawn by a path tracer, and something wrong with the pictures

Five flat cylinders (radius 2.5 mm; .15 to .6 mm over the bevel on their right), ten presses, seen by a camera of
427 x 320 pixels (JPEG, colours at full resolution, about 20 frames a press); `reference/` holds two pictures of
the untouched gel and 24 of balls. Mitsuba 3 drew them, a path tracer by others. Presses and forces are the
simulator's.

No frame, force or number of a real sensor is in it. It is made again, in about an hour, by

    python -m benchmarks.rendered --out FOLDER --kind recording --family bench --seed 1
    python -m benchmarks.rendered --cut FOLDER --out sample_frames/hidden_shadow

Something is hidden in it that the recording does not say; `truth.toml`, which only tests and benchmarks read, says
what. Find it first:

    tactilevision diagnose sample_frames/hidden_shadow --out diagnosis

Licence: as the project (MIT).
"""


def cut(source: Path, out: Path) -> None:
    """Write the good presses of the recording `source`, with what is hidden in it named in truth.toml."""
    recording = read_recording(source)
    truth = tomllib.loads((source / "truth.toml").read_text(encoding="utf-8"))
    good = set(truth["presses_accepted"])
    spans = [(p.start_s, p.end_s) for p in recording.presses if p.press in good]
    shutil.rmtree(out, ignore_errors=True)
    (out / "frames").mkdir(parents=True)
    content = tomllib.loads((source / "recording.toml").read_text(encoding="utf-8"))
    write_text(out / "recording.toml", tomli_w.dumps({**content, "name": out.name.replace("_", "-")}))
    _rows(source, out, "presses.csv", lambda row: row["press"] in good)
    _rows(source, out, "forces.csv", lambda row: _near(float(row["time_s"]), spans, NEAR_S))
    for row in _rows(source, out, "frames.csv", lambda row: _seen(source, row, spans), jpeg=True):
        _as_jpeg(source / "frames" / row["frame"], out / "frames")
    for kind in ("flat", "ball"):
        (out / "reference" / kind).mkdir(parents=True)
        for picture in sorted((source / "reference" / kind).iterdir())[: FLATS if kind == "flat" else None]:
            _as_jpeg(picture, out / "reference" / kind)
    _rows(source / "reference", out / "reference", "ball.csv", lambda row: True, jpeg=True)
    truth["press"] = [one for one in truth["press"] if one["press"] in good]
    truth |= {"presses_rejected": [], "hidden": HIDDEN}
    write_text(out / "truth.toml", tomli_w.dumps(truth))
    write_text(out / "README.md", README)


def _seen(source: Path, row: Row, spans: Sequence[tuple[float, float]]) -> bool:
    """Whether a frame lies in a press and can be read: one of each recording is torn."""
    near = _near(float(row["time_s"]), spans, 0.0)
    return near and cv2.imread(str(source / "frames" / row["frame"])) is not None


def _near(time_s: float, spans: Sequence[tuple[float, float]], by_s: float) -> bool:
    return any(begin - by_s <= time_s <= end + by_s for begin, end in spans)


def _rows(source: Path, out: Path, name: str, keep: Any, *, jpeg: bool = False) -> list[dict[str, str]]:
    """Copy the rows of a table that are kept, frames renamed to JPEG where asked; the rows as they were."""
    with (source / name).open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        rows = [row for row in reader if keep(row)]
    text = io.StringIO()
    writer = csv.DictWriter(text, reader.fieldnames or (), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(row | {"frame": Path(row["frame"]).with_suffix(".jpg").name} if jpeg else row)
    write_text(out / name, text.getvalue())
    return rows


def _as_jpeg(picture: Path, folder: Path) -> None:
    options = [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR]
    colours = cv2.imread(str(picture))
    assert colours is not None
    _, packed = cv2.imencode(".jpg", colours, [*options, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444])
    np.asarray(packed).tofile(folder / f"{picture.stem}.jpg")
