"""What is written is read back: exactly, to the digits printed."""

from __future__ import annotations

import dataclasses
import datetime
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from small_recording import picture, write_small

from tactilevision.errors import OutputError
from tactilevision.files.opening import is_plain
from tactilevision.recording.model import BallPress, Recording, StageSeries
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import (
    write_curves,
    write_image,
    write_points,
    write_recording,
    write_table,
)
from tactilevision.records.certified import REASONS, CertifiedPoint
from tactilevision.records.measured import Curve, ForceSeries
from tactilevision.records.ranges import range_of
from tactilevision.records.rig import Gel, Indenter, Press, Sensor


def printed(value: float) -> float:
    """A number as a table keeps it."""
    return float(f"{value:.12g}")


number = st.floats(-1e6, 1e6, allow_nan=False).map(printed)
positive = st.floats(1e-4, 0.9).map(printed)
maybe = st.one_of(st.just(math.nan), number)


def of(name: str) -> st.SearchStrategy[float]:
    """Numbers that a field of this name may hold, or NaN."""
    least, most = range_of(name) or (-1e6, 1e6)
    return st.one_of(st.just(math.nan), st.floats(max(least, -1e6), min(most, 1e6)).map(printed))


# labels may hold commas, quotes, line breaks inside, letters of any script; spaces around them do not count
label = st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), min_size=1, max_size=8).filter(
    lambda text: text == text.strip() != "" and is_plain(text)
)
# what stands in a column without a name of ours: one kind of thing in a column
note = st.text("abc, \"'", min_size=1, max_size=5).filter(lambda text: text == text.strip())


def equal(one: Any, other: Any) -> bool:
    """Equality of records: NaN equals NaN, arrays element by element."""
    if dataclasses.is_dataclass(one):
        return all(equal(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one))
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and all(map(equal, one.ravel().tolist(), other.ravel().tolist()))
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(equal, one, other))
    return bool(
        one == other or (isinstance(one, float) and isinstance(other, float) and one != one and other != other)
    )


POINT_NUMBERS = (
    "depth_std_mm",
    "fz_std_N",
    "fx_N",
    "fy_N",
    "time_s",
    "depth_uncorrected_mm",
    "rest_s",
    "speed_mm_s",
    "x_mm",
    "y_mm",
)
PRESS_NUMBERS = (
    "target_depth_mm",
    "x_mm",
    "y_mm",
    "rest_s",
    "speed_mm_s",
    "hold_s",
    "temperature_C",
    "time_of_day_s",
)


@st.composite
def points(draw: st.DrawFn) -> list[CertifiedPoint]:
    found = []
    for press in draw(st.lists(label, min_size=1, max_size=4, unique=True)):
        accepted = draw(st.booleans())
        main = number if accepted else maybe
        more: dict[str, Any] = {name: draw(of(name)) for name in POINT_NUMBERS}
        more |= {"accepted": accepted, "reason": "" if accepted else draw(st.sampled_from(REASONS))}
        found.append(CertifiedPoint(press, "A1", draw(main), draw(main), **more, extra={"note": draw(note)}))
    return found


@st.composite
def curves(draw: st.DrawFn) -> list[Curve]:
    found, with_stage = [], draw(st.booleans())
    start = 0.0
    for press in draw(st.lists(label, min_size=1, max_size=3, unique=True)):
        steps = draw(st.lists(positive, min_size=2, max_size=6))
        time_s = np.array([printed(t) for t in start + np.cumsum(steps)])
        start = float(time_s[-1]) + 1
        count = len(steps)
        columns = [np.array(draw(st.lists(number, min_size=count, max_size=count))) for _ in range(6)]
        phase = draw(
            st.lists(st.sampled_from(["free", "load", "hold", "unload", ""]), min_size=count, max_size=count)
        )
        found.append(
            Curve(
                press,
                time_s,
                columns[0],
                np.column_stack(columns[1:4]),
                np.array(phase),
                columns[4] if with_stage else None,
                {"humidity": columns[5]},
            )
        )
    return found


@st.composite
def presses(draw: st.DrawFn) -> tuple[Press, ...]:
    found, start = [], 0.0
    for press in draw(st.lists(label, min_size=1, max_size=4, unique=True)):
        start, end = printed(start + draw(positive)), printed(start + 1 + draw(positive))
        more: dict[str, Any] = {name: draw(of(name)) for name in PRESS_NUMBERS}
        more["date"] = draw(st.sampled_from(["", "2026-11-21"]))
        more["lubricated"] = draw(st.sampled_from([math.nan, 0.0, 1.0]))
        found.append(Press(press, "A1", start, end, **more, extra={"note": draw(note)}))
        start = end
    return tuple(found)


def record(root: Path, **held: Any) -> Recording:
    sensor = Sensor("custom", 0, 0, (math.nan, math.nan))
    return Recording(root, "made", sensor, indenters={"A1": Indenter("A1", radius_mm=2.5)}, **held)


def there_and_back(**held: Any) -> Recording:
    with tempfile.TemporaryDirectory() as folder:
        write_recording(record(Path(folder) / "made", **held))
        return read_recording(Path(folder) / "made")


@settings(max_examples=30, deadline=None)
@given(points())
def test_points_come_back(given_points: list[CertifiedPoint]) -> None:
    assert equal(list(there_and_back(points=tuple(given_points)).points), given_points)


@settings(max_examples=30, deadline=None)
@given(curves())
def test_curves_come_back(given_curves: list[Curve]) -> None:
    assert equal(list(there_and_back(curves=tuple(given_curves)).curves), given_curves)


@settings(max_examples=30, deadline=None)
@given(presses())
def test_presses_come_back(given_presses: tuple[Press, ...]) -> None:
    point = (CertifiedPoint("1", "A1", 0.1, 1.0),)
    assert equal(there_and_back(presses=given_presses, points=point).presses, given_presses)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(*[number] * 6, of("temperature_C")), min_size=2, max_size=8), st.booleans())
def test_forces_and_stage_come_back(rows: Sequence[tuple[float, ...]], full: bool) -> None:
    table = np.array(rows)
    time_s = np.arange(len(rows)) / 8
    forces = ForceSeries(
        time_s, table[:, :3], (0.1, 0.2, 0.3), table[:, 3:6] if full else None, table[:, 6] if full else None
    )
    stage = StageSeries(time_s, table[:, 0])
    kept = {"forces.csv": {"strain": table[:, 1]}, "stage.csv": {"mode": np.array(["a"] * len(rows))}}
    point = (CertifiedPoint("1", "A1", 0.1, 1.0),)
    back = there_and_back(forces=forces, stage=stage, points=point, extra=kept)
    assert equal(back.forces, forces)
    assert equal(back.stage, stage)
    assert equal(back.extra, kept)


def test_the_whole_recording_comes_back(tmp_path: Path) -> None:
    before = read_recording(write_small(tmp_path / "small"))
    maps = (np.full((24, 32), 1.5, np.float32), np.full((24, 32), 2.5, np.float32))
    gel = Gel(3.0, 0.1, "rectangle", None, (20.0, 30.0), 0.48, 0.01, 0.2, 0.02)
    indenters = {
        "A1": Indenter("A1", "flat_cylinder", 2.5, 0.01, 0.15, 0.005, "left", 5.0, 10.0, 0.02),
        "ball": Indenter("ball", "sphere", 3.0),
        "tip": Indenter("tip", "cone", half_angle_deg=60.0),
    }
    folder = tmp_path / "other"
    planned = dataclasses.replace(
        before,
        path=folder,
        date=datetime.date(2027, 1, 2),
        sensor=dataclasses.replace(before.sensor, rectification=maps, has_markers=True, serial="07", gel=gel),
        depth_source="gauge",
        depth_std_mm=0.003,
        clock_offset_s=-0.02,
        indenters=indenters,
        balls=(BallPress(folder / "reference/ball/b1.png", 3.0, (10.5, 11.5), 6.25),),
        frames_path=folder / "frames",
        flats=(folder / "reference/flat/untouched.png",),
        white_level=1023.0,
        extra={"frames.csv": {"exposure_s": np.arange(10.0)}},
    )
    write_recording(planned)
    for name in before.frame_names:
        write_image(folder / "frames" / name, picture(1))
    write_image(planned.balls[0].path, picture(2))
    write_image(planned.flats[0], picture(3))
    after = read_recording(folder)
    for field in dataclasses.fields(Recording):
        if field.name != "settings":
            assert equal(getattr(after, field.name), getattr(planned, field.name)), field.name


def test_writing_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    points = [CertifiedPoint("1", "A1", 1 / 3, 0.1 + 0.2, time_s=172800.123456)]
    write_points(tmp_path, points)
    first = (tmp_path / "points.csv").read_text()
    assert first == (
        "press,indenter,depth_mm,fz_N,time_s,accepted,reason\n1,A1,0.333333333333,0.3,172800.123456,true,\n"
    )
    write_recording(record(tmp_path / "a", points=tuple(points)))
    write_points(tmp_path, read_recording(tmp_path / "a").points)
    assert (tmp_path / "points.csv").read_text() == first


def test_curves_of_different_columns_share_a_table(tmp_path: Path) -> None:
    two = np.zeros(2)
    phase = np.array(["", ""])
    write_curves(
        tmp_path,
        [
            Curve("1", two, two, np.zeros((2, 3)), phase, z_mm=np.ones(2)),
            Curve("2", two, two, np.zeros((2, 3)), phase, extra={"humidity": two}),
        ],
    )
    lines = (tmp_path / "curves.csv").read_text().splitlines()
    assert lines[0] == "press,time_s,depth_mm,fx_N,fy_N,fz_N,z_mm,humidity"
    assert (lines[1], lines[-1]) == ("1,0,0,0,0,0,1,", "2,0,0,0,0,0,,0")


def test_a_failed_write_leaves_the_old_table(tmp_path: Path) -> None:
    write_table(tmp_path / "t.csv", {"a": [1.0]})
    with pytest.raises(ValueError, match="shorter"):
        write_table(tmp_path / "t.csv", {"a": [1.0, 2.0], "b": [1.0]})
    assert (tmp_path / "t.csv").read_text() == "a\n1\n"
    with pytest.raises(OutputError):
        write_table(tmp_path / "t.csv" / "u.csv", {"a": [1.0]})


def test_times_since_1970_keep_their_fractions(tmp_path: Path) -> None:
    times = 1.7e9 + np.array([0.0, 0.0123, 3.0892])
    curve = Curve("1", times, np.zeros(3), np.zeros((3, 3)), np.full(3, ""))
    write_curves(tmp_path, [curve])
    rows = (tmp_path / "curves.csv").read_text().splitlines()[1:]
    assert [float(row.split(",")[1]) for row in rows] == times.tolist()
