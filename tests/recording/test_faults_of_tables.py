"""Each fault of a table has its own message, with the file, the line, and the value."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from each import each
from small_recording import edit, picture, write_small

from tactilevision.errors import InputError, RecordingError
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image

HEAD = "time_s,fx_N,fy_N,fz_N\n"
POINTS = "press,indenter,depth_mm,fz_N"

# file, text to find, text to put there, what the message says
EDITS = [
    ("forces.csv", "0.02,0.1", "0.02,nan", "forces.csv, line 4: column fx_N holds no finite number (got 'nan')"),
    (
        "forces.csv",
        "0.02,0.1",
        "0.02,broken",
        "forces.csv, line 4: column fx_N holds no finite number (got 'broken')",
    ),
    ("forces.csv", "0.02,0.1", "0.02,", "forces.csv, line 4: column fx_N holds no finite number (got '')"),
    ("forces.csv", "0.02,0.1", "0.02,inf", "forces.csv, line 4: column fx_N holds no finite number (got 'inf')"),
    ("forces.csv", "\n0.02,", "\n0.005,", "forces.csv, line 4: time_s goes backwards, from 0.01 to 0.005"),
    (
        "forces.csv",
        "\n0.02,0.1,-0.1,0.04\n",
        "\n0.02,0.1\n",
        "forces.csv, line 4: the row has 2 cells, the header 4",
    ),
    ("forces.csv", "\n0.02,0.1", "\n0,02,0.1", "or has it decimal commas"),
    ("forces.csv", "0.02,0.1", '0.02,"0,1"', "(got '0,1'). Write it with a decimal point"),
    (
        "forces.csv",
        "0.02,0.1",
        '0.02,"1,206.5"',
        "(got '1,206.5'). Write it with a decimal point and without",
    ),
    ("forces.csv", "0.02,0.1", "0.02,1'206", "without thousands separators"),
    ("forces.csv", "0.02,0.1", "0.02,1_206", "fx_N holds no finite number (got '1_206'). Write it with a decimal"),
    ("forces.csv", "fz_N\n", "fz_N\ns,N,N,N\n", "line 2: column time_s holds no finite number (got 's'). Correct"),
    ("forces.csv", "fz_N\n", "fz_N\ns,N,N,N\n", "if the line holds units, remove it"),
    ("forces.csv", "fz_N", "F_z [mN]", "Rename F_z [mN] to fz_mN"),
    ("forces.csv", "fz_N", "fz_dyn", "fz_dyn: dyn is no known unit of force; known are uN, mN, N, kN"),
    ("forces.csv", "fz_N", "fz [um]", "um is no known unit of force"),
    ("forces.csv", "fz_N", "fz_MN", "MN is no known unit of force"),
    ("forces.csv", "fx_N", "fz (mN)", "column fz_N occurs twice in the header, once as fz (mN)"),
    ("presses.csv", "end_s", "end_s,rest (days)", "column rest (days): days is no known unit of time"),
    ("presses.csv", "2,A1", "2,B 7", 'Add a table [indenter."B 7"] there'),
    ("forces.csv", "fz_N", "fz", "column fz_N is missing; there are time_s, fx_N, fy_N, fz"),
    ("forces.csv", "fz_N", "fz", "Rename fz to fz_N"),
    ("forces.csv", "fy_N", "fx_N", "column fx_N occurs twice"),
    ("frames.csv", "f2.png,0.2", "f2.png,0.05", "frames.csv, line 4: time_s goes backwards, from 0.1 to 0.05"),
    ("frames.csv", "f2.png,0.2", "f1.png,0.2", "frames.csv, line 4: the frame is listed twice, first in line 3"),
    ("frames.csv", "f2.png", "f2", "Write its name with its ending: f2.png"),
    ("frames.csv", "f2.png", "", "frames.csv, line 4: column frame is empty"),
    ("presses.csv", "1,A1,0.1,0.4", "1,A1,0.4,0.1", "presses.csv, line 2: the press does not end after it starts"),
    ("presses.csv", "2,A1,0.5", "2,A1,0.3", "press 2 starts at 0.3 s, before press 1 of line 2 ends at 0.4 s"),
    ("presses.csv", "2,A1", "2,B7", "presses.csv, line 3: indenter B7 is not described in recording.toml"),
    ("presses.csv", "2,A1", "2,a1", "Did you mean A1?"),
    ("presses.csv", "2,A1", "1,A1", "presses.csv, line 3: the press is listed twice, first in line 2"),
    (
        "presses.csv",
        "end_s\n1,A1,0.1,0.4\n2,A1,0.5,0.9",
        "end_s,date\n1,A1,0.1,0.4,\n2,A1,0.5,0.9,21.11.2026",
        "presses.csv, line 3: date is written like 2026-11-21 (got '21.11.2026')",
    ),
    (
        "presses.csv",
        "end_s\n1,A1,0.1,0.4\n2,A1,0.5,0.9",
        "end_s,lubricated\n1,A1,0.1,0.4,2\n2,A1,0.5,0.9,",
        "presses.csv, line 2: lubricated is 0 or 1 (got 2.0)",
    ),
    ("presses.csv", "0.5,0.9", "0.5,1.9", "the readings end early: at 0.99 s, but press 2 ends at 1.9 s"),
    ("presses.csv", "0.1,0.4", "-0.5,0.4", "the readings start late: at 0 s, but press 1 starts at -0.5 s"),
    (
        "reference/ball.csv",
        "3.0",
        "-3.0",
        "ball.csv, line 2: ball_radius_mm must lie between 1e-06 and 10000 (got -3.0)",
    ),
    (
        "reference/ball.csv",
        "3.0",
        "1e9",
        "line 2: ball_radius_mm must lie between 1e-06 and 10000 (got 1000000000.0)",
    ),
    ("reference/ball.csv", "b1.png", "b2.png", "1 of 1 pictures listed are missing, the first is b2.png"),
]

# file, its whole content, what the message says
CONTENTS = [
    ("forces.csv", b"", "forces.csv: is empty"),
    ("forces.csv", b"\n", "forces.csv: is empty"),
    ("forces.csv", HEAD.encode(), "forces.csv: has no rows under its header"),
    ("forces.csv", (HEAD + "0,0,0,0\n").encode(), "forces.csv: has 1 row, at least 2 are needed"),
    ("forces.csv", b"time_s;fx_N;fy_N;fz_N\n0;0;0;0\n", "line 1: its columns are separated by semicolons"),
    ("forces.csv", b"# made by X\n" + HEAD.encode() + b"0,0,0,0\n", "names the columns: remove comments"),
    ("forces.csv", b"time_s\tfx_N\tfy_N\tfz_N\n0\t0\t0\t0\n", "line 1: its columns are separated by tabs"),
    ("forces.csv", HEAD.encode() + b"0,0,0,0\n1,0,0,\xff\n", "forces.csv, line 3: is not UTF-8 text"),
    ("forces.csv", HEAD.encode("utf-16-le") + b"0\0", "forces.csv, line 1: is not UTF-8 text"),
    ("forces.csv", HEAD.encode() + b'0,0,0,"0\n', "forces.csv, line 2: is not CSV: unexpected end of data"),
    ("stage.csv", b"time_s,z_mm\n1,0\n0,0\n", "stage.csv, line 3: time_s goes backwards, from 1 to 0"),
    (
        "curves.csv",
        b"press,time_s,depth_mm,fx_N,fy_N,fz_N\na,0,0,0,0,0\nb,0,0,0,0,0\na,-1,0,0,0,0\n",
        "curves.csv, line 4: time_s goes backwards, from 0 to -1",
    ),
    (
        "curves.csv",
        b"press,time_s,depth_mm,fx_N,fy_N,fz_N,phase\na,0,0,0,0,0,load\na,1,0,0,0,0,loading\n",
        "curves.csv, line 3: phase is one of free, load, hold, unload, or empty (got 'loading')",
    ),
    (
        "points.csv",
        b"press,indenter,fz_N\n1,A1,1\n",
        "points.csv, line 1: column depth_mm is missing; there are press, indenter, fz_N",
    ),
    (
        "points.csv",
        b"press,indenter,depth_mm,fz_N,fz_std_N\n1,A1,1,1,-1\n",
        "line 2: fz_std_N must lie between 0 and",
    ),
    ("points.csv", f"{POINTS}\n1,A1,,1\n".encode(), "points.csv, line 2: column depth_mm holds no number"),
    (
        "points.csv",
        f"{POINTS}\n1,B1,0.1,1\n".encode(),
        "points.csv, line 2: indenter B1 is not described in recording.toml",
    ),
    (
        "points.csv",
        f"{POINTS},accepted\n1,A1,0.1,1,perhaps\n".encode(),
        "line 2: accepted is true or false (got 'perhaps')",
    ),
    ("points.csv", f"{POINTS},accepted\n1,A1,,1,true\n".encode(), "line 2: column depth_mm holds no number"),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_small(tmp_path / "small")


def message(root: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recording(root)
    return str(caught.value)


@each("name, old, new, said", EDITS)
def test_a_spoilt_cell_is_named(tmp_path: Path, name: str, old: str, new: str, said: str) -> None:
    folder = write_small(tmp_path / "small")
    edit(folder / name, old, new)
    assert said in message(folder)


@each("name, content, said", CONTENTS)
def test_a_spoilt_file_is_named(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    folder = write_small(tmp_path / "small")
    (folder / name).write_bytes(content)
    assert said in message(folder)


@each("name", ["frames.csv", "forces.csv", "presses.csv", "stage.csv"])
def test_a_table_that_is_a_pipe_is_not_taken_for_absent(tmp_path: Path, name: str) -> None:
    folder = write_small(tmp_path / "small")
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    with pytest.raises(InputError, match=f"{name}: is a pipe, not a file"):
        read_recording(folder)


def test_forces_shorter_than_the_presses_end_early_whatever_the_clocks(folder: Path) -> None:
    settings = (folder / "recording.toml").read_text()
    (folder / "recording.toml").write_text(re.sub(r"offset_s = .*\n", "", settings))
    lines = (folder / "forces.csv").read_text().splitlines(keepends=True)
    (folder / "forces.csv").write_text("".join(lines[:60]))
    assert "forces.csv: the readings end early: they last 0.58 s, the presses 0.8 s" in message(folder)


def _without(*names: str) -> Callable[[Path], None]:
    def spoil(root: Path) -> None:
        for name in names:
            for path in sorted(root.glob(f"{name}/*")):
                path.unlink()
            (root / name).rmdir() if (root / name).is_dir() else (root / name).unlink()

    return spoil


@each(
    "spoil, said",
    [
        (_without("frames"), "frames: frames are listed, but there are no pictures"),
        (
            _without("frames", "frames.csv", "reference/ball", "reference/ball.csv"),
            "holds neither frames nor curves nor points",
        ),
        (
            _without("frames", "frames.csv", "forces.csv", "presses.csv", "reference/ball.csv"),
            "ball.csv: the table is missing, though there are 1 pictures of ball presses",
        ),
        (_without("frames.csv"), "frames.csv: the table is missing. Add the table: columns frame, time_s."),
        (
            _without("reference/ball.csv"),
            "ball.csv: the table is missing, though there are 1 pictures of ball presses",
        ),
        (_without("recording.toml"), "is not a recording: recording.toml is missing"),
    ],
)
def test_a_missing_part_is_named(tmp_path: Path, spoil: Callable[[Path], None], said: str) -> None:
    folder = write_small(tmp_path / "small")
    spoil(folder)
    assert said in message(folder)


def test_a_path_that_is_no_recording_is_named(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert "the folder is empty" in message(tmp_path / "empty")
    assert "there is no such folder" in message(tmp_path / "nowhere")
    assert "a recording is a folder, not a file" in message(folder / "recording.toml")
    assert f"Did you mean {folder}?" in message(tmp_path)


def test_what_is_legal_but_unlikely_is_a_warning(folder: Path) -> None:
    frames = (folder / "frames.csv").read_text()
    (folder / "frames.csv").write_text(frames.replace("f3.png,0.3\n", "").replace("0.5\n", "0.4\n"))
    forces = (folder / "forces.csv").read_text().replace("fz_N", "fz_N,temperature")
    (folder / "forces.csv").write_text(re.sub(r"(\d)\n", r"\1,20\n", forces))
    presses = (folder / "presses.csv").read_text()
    (folder / "presses.csv").write_text(presses + "late,A1,0.95,0.98\n")
    (folder / "recording.toml").write_text((folder / "recording.toml").read_text().replace("100.0", "500.0"))
    warnings = "\n".join(read_recording(folder).warnings)
    assert "1 pictures are not listed in frames.csv" in warnings
    assert "1 frames have the same time as the frame before" in warnings
    assert "column temperature has no meaning here; temperature_C has" in warnings
    assert "no frames were taken during late" in warnings
    assert "readings come at 100 Hz, not at rate_Hz = 500" in warnings


def test_times_in_milliseconds_are_asked_about(folder: Path) -> None:
    for name, begin in (("frames.csv", 1e5), ("forces.csv", 0.0)):
        rows = [line.split(",") for line in (folder / name).read_text().splitlines()]
        column = rows[0].index("time_s")
        for row in rows[1:]:
            row[column] = str(1000 * float(row[column]) + begin)
        (folder / name).write_text("\n".join(map(",".join, rows)))
    warnings = "\n".join(read_recording(folder).warnings)
    assert "no frames were taken during 1, 2. Is frames.csv in ms, or of another clock?" in warnings
    assert "readings come at 0.1 Hz, not at rate_Hz = 100: is time_s in ms?" in warnings


def test_a_clock_of_forces_that_jumps_is_told(folder: Path) -> None:
    rows = [line.split(",") for line in (folder / "forces.csv").read_text().splitlines()]
    for row in rows[51:]:
        row[0] = str(float(row[0]) + 60)
    (folder / "forces.csv").write_text("\n".join(map(",".join, rows)))
    assert any("no readings for 60 s after time_s = 0.49" in said for said in read_recording(folder).warnings)


@pytest.mark.parametrize("clock", ["known", "unknown"])
def test_forces_that_are_logged_by_press_are_no_jumping_clock(clock: str, folder: Path) -> None:
    """Three presses 60 and 90 s apart, frames all the time, forces from before each press to after it."""
    starts = (0.0, 60.0, 150.0)
    (folder / "frames.csv").write_text("frame,time_s\n" + "".join(f"f{k}.png,{17 * k}\n" for k in range(10)))
    (folder / "presses.csv").write_text(
        "press,indenter,start_s,end_s\n" + "".join(f"{s},A1,{s + 0.3},{s + 0.9}\n" for s in starts)
    )
    settings = (folder / "recording.toml").read_text()
    offset = "offset_s = 0.0\n" * (clock == "known")
    (folder / "recording.toml").write_text(re.sub(r"offset_s = .*\n", offset, settings))
    for jump in (0.0, 60.0):
        rows = "".join(
            f"{s + k / 100 + jump * (s > 0) * (clock == 'known')},0.1,-0.1,{k % 50 / 50}\n"
            for s in starts
            for k in range(130)
        )
        (folder / "forces.csv").write_text("time_s,fx_N,fy_N,fz_N\n" + rows)
        told = any("if the clock jumped" in said for said in read_recording(folder).warnings)
        assert told == (jump > 0 and clock == "known")


def test_presses_with_two_rows_are_named(folder: Path) -> None:
    (folder / "points.csv").write_text(f"{POINTS}\n1,A1,0.1,1\n2,A1,0.2,2\n1,A1,0.1,1\n")
    assert "points.csv: more than one row each for press 1" in read_recording(folder).warnings


def test_a_folder_in_place_of_a_table_is_named(folder: Path) -> None:
    (folder / "forces.csv").unlink()
    (folder / "forces.csv").mkdir()
    with pytest.raises(InputError, match=r"forces\.csv: is a folder, not a file\. Put a file in its place"):
        read_recording(folder)


def test_pictures_of_an_unknown_kind_are_named(folder: Path) -> None:
    (folder / "frames.csv").unlink()
    for picture_path in list((folder / "frames").iterdir()):
        picture_path.rename(picture_path.with_suffix(".webp"))
    said = message(folder)
    assert "frames: none of its 10 files is a picture or a video of a supported kind (got 'f0.webp')" in said


CURVES = "press,time_s,depth_mm,fx_N,fy_N,fz_N\n1,0.1,0,0,0,0\n1,0.4,0.1,0,0,1\n2,0.5,0,0,0,0\n2,0.9,0.1,0,0,1\n"
CURVES_MS = re.sub(r"0\.([1459]),(0[.1]*,0,0)", r"\g<1>00,\2", CURVES)


@each(
    "old, new, said",
    [
        ("1,0.4,0.1,0,0,1\n", "1,0.4,0.1,0,0,1\n" * 3, "2 rows repeat the row before them, in press 1: "),
        ("2,0.5,0,0,0,0\n2,0.9,0.1,0,0,1\n", "", "no rows of press 2, which presses.csv lists"),
        ("2,0.9", "2,90", "press 2 lasts 89.5 s, but 0.4 s in presses.csv: did its clock jump?"),
        (CURVES, CURVES_MS, "2 of 2 presses last longer than in presses.csv, press 1 300 s and not 0.3 s"),
    ],
)
def test_curves_that_are_unlikely_are_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    folder = write_small(tmp_path / "small")
    (folder / "curves.csv").write_text(CURVES)
    assert read_recording(folder).warnings == ()
    edit(folder / "curves.csv", old, new)
    (warning,) = read_recording(folder).warnings
    assert said in warning


@pytest.mark.parametrize(("name", "word"), [("presses.csv", "A1"), ("frames.csv", "f3")])
def test_text_with_a_control_character_is_refused(folder: Path, name: str, word: str) -> None:
    edit(folder / name, word, f"{word}\0")
    assert "holds a control character" in message(folder)


def test_forces_of_the_wrong_sign_are_doubted(folder: Path) -> None:
    text = (folder / "forces.csv").read_text()
    negative = re.sub(r",([0-9.]+)\n", lambda found: f",{-max(float(found[1]) - 0.5, 0)}\n", text)
    (folder / "forces.csv").write_text(negative)
    assert any("fz_N mostly falls" in warning for warning in read_recording(folder).warnings)
    (folder / "forces.csv").write_text(negative.replace(",-0.1,-", ",-0.1,"))
    assert read_recording(folder).warnings == ()


def test_forces_that_miss_a_moment_of_free_gel_are_a_warning(folder: Path) -> None:
    edit(folder / "presses.csv", "0.5,0.9", "0.5,1.0")  # readings end at 0.99 s: one step before
    assert read_recording(folder).warnings == ()
    edit(folder / "presses.csv", "0.5,1.0", "0.5,1.025")
    assert any("the readings end early: at 0.99 s" in warning for warning in read_recording(folder).warnings)
    edit(folder / "presses.csv", "0.5,1.025", "0.5,1.06")
    assert "the readings end early: at 0.99 s, but press 2 ends at 1.06 s" in message(folder)


def test_a_reference_of_another_size_is_named(folder: Path) -> None:
    write_image(folder / "reference/flat/untouched.png", picture(1, width=40))
    assert "untouched.png: the picture is 40 x 24, the others 32 x 24" in message(folder)


def test_presses_that_touch_do_not_overlap(folder: Path) -> None:
    edit(folder / "presses.csv", "2,A1,0.5", "2,A1,0.4")
    assert len(read_recording(folder).presses) == 2


def test_a_column_that_contradicts_the_settings_is_a_warning(folder: Path) -> None:
    table = folder / "presses.csv"
    header, *rows = table.read_text(encoding="utf-8").splitlines()
    lines = [f"{header},radius_mm,thickness_mm", *(f"{row},2.5,{3.0 - (k == 0)}" for k, row in enumerate(rows))]
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (said,) = (line for line in read_recording(folder).warnings if "contradicts" in line)
    press = rows[0].split(",")[0]
    assert said.startswith(f"presses.csv: thickness_mm = 2 of press {press} contradicts 3 in recording.toml")


def test_a_depth_beyond_the_gel_is_doubted(folder: Path) -> None:
    (folder / "points.csv").write_text("press,indenter,depth_mm,fz_N,accepted\n1,A1,300,1,true\n2,A1,,1,false\n")
    assert any("depth_mm = 300 exceeds" in warning for warning in read_recording(folder).warnings)


def test_forces_that_never_change_are_doubted(folder: Path) -> None:
    text = (folder / "forces.csv").read_text()
    (folder / "forces.csv").write_text(re.sub(r",[-0-9.]+\n", ",0\n", text))
    assert any("fz_N is 0 N throughout" in warning for warning in read_recording(folder).warnings)
