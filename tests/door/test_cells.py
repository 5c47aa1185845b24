"""Text of the user's that a spreadsheet would run is written as text, and read back as it was."""

from __future__ import annotations

import csv
from pathlib import Path

from each import each

from tactilevision.batch.folder import FrameResult, table
from tactilevision.files.documents import cell_text, csv_text
from tactilevision.recording.layout import POINT_COLUMNS
from tactilevision.recording.tables import read_table
from tactilevision.recording.write import write_points
from tactilevision.records.certified import CertifiedPoint

FORMULAS = ["=1+1", "@SUM(A1)", "+cmd|' /C calc'!A0", "-2+3", '=HYPERLINK("x")', "＝1+1"]
HARMLESS = ["-1.5", "+2", "1e-3", "a=b", "p-1", "'quoted'", "nan", "-inf"]


@each("cell", [*FORMULAS, "'=1+1", "''-x"])
def test_a_formula_is_written_as_text(cell: str) -> None:
    written = csv_text([[cell]])
    (read,) = next(csv.reader([written]))
    assert read == "'" + cell
    assert cell_text(read) == cell


@each("cell", HARMLESS)
def test_numbers_and_other_text_are_left_alone(cell: str) -> None:
    (read,) = next(csv.reader([csv_text([[cell]])]))
    assert read == cell == cell_text(read)


def test_points_of_such_presses_are_read_as_they_were(tmp_path: Path) -> None:
    points = [CertifiedPoint(name, "=A1", depth_mm=0.1, fz_N=-1.0, extra={"=note": name}) for name in FORMULAS]
    write_points(tmp_path, points)
    with (tmp_path / "points.csv").open(newline="", encoding="utf-8") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert not [cell for cell in cells if cell in FORMULAS or cell in ("=A1", "=note")]
    assert cells.count("-1") == len(FORMULAS)
    found = read_table(tmp_path / "points.csv", POINT_COLUMNS)
    assert found.words["press"] == FORMULAS
    assert set(found.words["indenter"]) == {"=A1"}
    assert list(found.extra["=note"]) == FORMULAS


def test_a_frame_is_no_formula_in_the_table_of_depths() -> None:
    row = FrameResult("=x.png", "ok")
    assert "\n'=x.png," in table([row])
