"""Impossible numbers are refused by constructors and by readers, with file, field, value and range."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError, RecordingError
from tactilevision.recording.layout import CURVE_COLUMNS, FORCE_COLUMNS, POINT_COLUMNS, PRESS_COLUMNS
from tactilevision.recording.model import BallPress, StageSeries
from tactilevision.recording.read import read_recording
from tactilevision.records.certified import CertifiedPoint, EdgeDrop
from tactilevision.records.measured import ForceSeries, Material
from tactilevision.records.ranges import range_of
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

GEL, INDENTER = Gel(3.0), Indenter("A", radius_mm=2.5)
POINT = CertifiedPoint("p", "A", 0.1, 1.0)
TWO = np.array([0.0, 1.0])
FORCES = ForceSeries(TWO, np.zeros((2, 3)), (0.1, 0.1, 0.1))

IMPOSSIBLE: list[tuple[Any, str, Any]] = [
    (GEL, "thickness_mm", 1e12),
    (GEL, "thickness_mm", -5.0),
    (GEL, "thickness_std_mm", -0.1),
    (GEL, "size_mm", (20.0, -1.0)),
    (GEL, "poisson_ratio", 0.7),
    (GEL, "youngs_modulus_MPa", -1.0),
    (INDENTER, "radius_mm", -5.0),
    (INDENTER, "radius_mm", float("inf")),
    (INDENTER, "bevel_angle_deg", 100.0),
    (Sensor("custom", 10, 10, (0.1, 0.1)), "mm_per_px", (0.1, 0.0)),
    (Press("p", "A", 0.0, 1.0), "rest_s", -1.0),
    (Press("p", "A", 0.0, 1.0), "temperature_C", -300.0),
    (POINT, "fz_N", 1e9),
    (POINT, "time_s", 1.8e12),
    (EdgeDrop(90.0, 0.1, 0.2, 0.1), "azimuth_deg", float("9" * 400)),
    (FORCES, "force_N", np.full((2, 3), 1e7)),
    (FORCES, "temperature_C", np.array([20.0, 1e5])),
    (StageSeries(TWO, TWO), "z_mm", np.array([0.0, 1e9])),
    (BallPress(Path("b.png"), 3.0), "ball_radius_mm", -5.0),
    (Material(0.2, 0.48), "youngs_modulus_MPa", 1e12),
]


@each("record, field, value", IMPOSSIBLE)
def test_a_constructor_refuses_what_is_impossible(record: Any, field: str, value: Any) -> None:
    bounds = range_of(field)
    assert bounds is not None
    with pytest.raises(
        InputError, match=re.escape(f"{field} must lie between {bounds[0]:g} and {bounds[1]:g} (got ")
    ):
        replace(record, **{field: value})


def test_unknown_numbers_and_those_of_microscopes_are_possible() -> None:
    assert Gel(float("nan")).radius_mm is None
    assert replace(POINT, rest_s=float("nan")).depth_mm == 0.1
    assert Indenter("tip", shape="sphere", radius_mm=5e-6).radius_mm == 5e-6
    assert Gel(0.01).thickness_mm == 0.01


def test_every_column_with_a_unit_has_a_range() -> None:
    for columns in (FORCE_COLUMNS, POINT_COLUMNS, CURVE_COLUMNS, PRESS_COLUMNS):
        numbers = (*columns.numbers, *columns.gap_numbers, *columns.maybe_numbers)
        assert [name for name in numbers if range_of(name) is None] in ([], ["lubricated"])


TOML = "format = 1\n[sensor.gel]\nthickness_mm = 3.0\n[indenter.A]\nradius_mm = 2.5\n"
CSV = "press,indenter,depth_mm,fz_N\na,A,.1,1\n"


@each(
    "file, old, new, said",
    [
        (
            "recording.toml",
            "= 3.0",
            "= 1e11",
            "recording.toml: [sensor.gel] thickness_mm must lie between 0.001 and",
        ),
        ("recording.toml", "= 2.5", "= 1e6", "recording.toml: [indenter.A] radius_mm must lie between 1e-06 and"),
        ("recording.toml", "= 2.5", "= -5", "recording.toml: [indenter.A] radius_mm must be above 0 (got -5)"),
        (
            "points.csv",
            "a,A,.1,1",
            "a,A,.1,1e9",
            "line 2: fz_N must lie between -1e+06 and 1e+06 (got 1000000000.0)",
        ),
        ("points.csv", "N\na,A,.1,1", f"N,fall_{'9' * 400}_0.1_0.2_mm\na,A,.1,1,.1", "0 and 360 (got inf)"),
        ("points.csv", "N\na,A,.1,1", "N,rest_s\na,A,.1,1,-3", "line 2: rest_s must lie between 0 and"),
        (
            "points.csv",
            "N\na,A,.1,1",
            "N,touch_std_s\na,A,.1,1,-3",
            "line 2: contact_std_s must lie between 0 and",
        ),
    ],
)
def test_a_reader_names_the_file_and_the_field(file: str, old: str, new: str, said: str, tmp_path: Path) -> None:
    for name, text in (("recording.toml", TOML), ("points.csv", CSV)):
        (tmp_path / name).write_text(text.replace(old, new) if name == file else text)
    with pytest.raises(RecordingError) as refused:
        read_recording(tmp_path)
    assert said in str(refused.value)
    assert file in str(refused.value)


def test_an_edge_s_column_of_another_shape_is_kept_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "recording.toml").write_text(TOML)
    (tmp_path / "points.csv").write_text(CSV.replace("N\na,A,.1,1", "N,fall_0_1.2.3_4_mm\na,A,.1,1,.1"))
    (point,) = read_recording(tmp_path).points
    assert point.edge_profile is None
    assert dict(point.extra) == {"fall_0_1.2.3_4_mm": 0.1}
