"""Units in the names of columns and keys are converted as scipy's constants state them, and this is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from each import each
from scipy import constants
from small_recording import edit, write_small

from tactilevision.recording.layout import BALL_COLUMNS, CURVE_COLUMNS, FORCE_COLUMNS, POINT_COLUMNS
from tactilevision.recording.read import read_recording
from tactilevision.recording.tables import read_table

FACTORS = [  # column of the file, column of the format, factor by scipy
    ("fz_mN", "fz_N", constants.milli),
    ("Fz (mN)", "fz_N", constants.milli),
    ("fz [kN]", "fz_N", constants.kilo),
    ("fz_N ", "fz_N", 1.0),
    ("fz (N)", "fz_N", 1.0),
    ("fz_g", "fz_N", constants.g * constants.gram),
    ("fz_gf", "fz_N", constants.g * constants.gram),
    ("fz kgf", "fz_N", constants.kilogram_force),
    ("fz_lbf", "fz_N", constants.pound_force),
    ("fz (lb)", "fz_N", constants.lbf),
    ("time_ms", "time_s", constants.milli),
    ("Time [µs]", "time_s", constants.micro),
    ("time (min)", "time_s", constants.minute),
    ("time_ns", "time_s", constants.nano),
    ("tx_Nmm", "tx_Nm", constants.milli),
    ("tx (N·mm)", "tx_Nm", constants.milli),
    ("tx_mNm", "tx_Nm", constants.milli),
]


@each("name, meant, factor", FACTORS)
def test_a_force_table_in_another_unit_is_converted(name: str, meant: str, factor: float, tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    head = [name if column == meant else column for column in ("time_s", "fx_N", "fy_N", "fz_N", "tx_Nm")]
    path.write_text(",".join(head) + "\n1.5,1.5,1.5,1.5,1.5\n3,3,3,3,3\n", encoding="utf-8")
    table = read_table(path, FORCE_COLUMNS)
    assert table.numbers[meant] == pytest.approx(factor * np.array([1.5, 3.0]), rel=1e-14)
    assert not table.extra
    said = [
        warning for warning in table.warnings if name in warning and meant in warning and f"{factor:g}" in warning
    ]
    assert len(said) == len(table.warnings) == (factor != 1)


def test_every_table_reads_units(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("press,indenter,depth [um],fz (mN),speed (mm/min),depth_std_nm\na,A1,150,563.6,30,2500\n")
    points = read_table(path, POINT_COLUMNS).numbers
    found = [points[name][0] for name in ("depth_mm", "fz_N", "speed_mm_s", "depth_std_mm")]
    assert found == [0.15, 0.5636, 0.5, 0.0025]
    path.write_text("press,time_ms,depth_um,fx_mN,fy_mN,fz_mN,z_um\na,10,150,0,0,5,2\n")
    curves = read_table(path, CURVE_COLUMNS).numbers
    assert [curves[name][0] for name in ("time_s", "depth_mm", "fz_N", "z_mm")] == [0.01, 0.15, 0.005, 0.002]
    path.write_text("frame,ball_radius_inch\na.png,.125\n")
    assert read_table(path, BALL_COLUMNS).numbers["ball_radius_mm"][0] == pytest.approx(0.125 * 25.4)


def test_a_column_of_a_similar_name_stays_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("press,indenter,depth_mm,fz_N,depth_raw,x_left,press_ms\na,A1,0.1,1,7,8,9\n")
    table = read_table(path, POINT_COLUMNS)
    assert {name: column[0] for name, column in table.extra.items()} == {
        "depth_raw": 7,
        "x_left": 8,
        "press_ms": 9,
    }


def test_keys_of_the_settings_in_another_unit_are_converted(tmp_path: Path) -> None:
    folder = write_small(tmp_path / "small")
    edit(folder / "recording.toml", "thickness_mm = 3.0", "thickness_um = 3000")
    edit(folder / "recording.toml", "mm_per_px = 0.06", "um_per_px = [60, 60]")
    edit(folder / "recording.toml", "std_N = [0.01, 0.01, 0.02]", "std_mN = [10, 10, 20]")
    edit(folder / "recording.toml", "radius_mm = 2.5", "radius_um = 2500")
    edit(folder / "forces.csv", "fz_N", "fz (N)")
    recording = read_recording(folder)
    assert recording.sensor.gel is not None
    assert recording.sensor.gel.thickness_mm == 3.0
    assert recording.sensor.mm_per_px == pytest.approx((0.06, 0.06))
    assert recording.force_std_N == (0.01, 0.01, 0.02)
    assert recording.indenters["A1"].radius_mm == 2.5
    said = "recording.toml: [sensor.gel] thickness_um is read as thickness_mm = 3.0"
    assert said in recording.warnings
    assert len([one for one in recording.warnings if "is read as" in one]) == 4
