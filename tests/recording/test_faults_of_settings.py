"""Each fault of recording.toml has its own message, with the key, the value, and the remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each
from small_recording import edit, write_small

from tactilevision.errors import RecordingError
from tactilevision.recording.read import read_recording

FAULTS = [
    ("format = 1", "format = 2", "this version reads format = 1 only (got 2)"),
    ("format = 1", 'format = "1"', "this version reads format = 1 only (got '1')"),
    ("format = 1", "", "the number of the format is missing"),
    ("format = 1", "fromat = 1", "the number of the format is missing (got 'fromat')"),
    ('kind = "custom"\n', "", "[sensor] kind is missing. State one of gelslim3"),
    ("format = 1", "format =", "recording.toml, line 1: is not TOML"),
    ("[sensor.gel]", "[sensor.gel", "recording.toml, line 11: is not TOML"),
    ('kind = "custom"', "kind = custom", "recording.toml, line 6: is not TOML"),
    ('kind = "custom"', 'kind = "gelslim33"', "Did you mean gelslim3?"),
    (
        "thickness_mm = 3.0",
        "thickness = 3.0",
        "[sensor.gel] thickness is not known (got 3.0). Did you mean thickness_mm? Units are part of the name.",
    ),
    ("thickness_mm = 3.0", "thicknes_um = 3000", "Did you mean thickness_um?"),
    (
        "thickness_mm = 3.0",
        "thickness_mm = 3.0\nthickness_um = 3000",
        "states what thickness_mm states too",
    ),
    (
        "thickness_mm = 3.0",
        'thickness_mm = "3 mm"',
        "[sensor.gel] thickness_mm must be a number (got '3 mm'). Write the number alone",
    ),
    ("thickness_mm = 3.0", "thickness_mm = -3.0", "[sensor.gel] thickness_mm must be above 0 (got -3.0)"),
    ("thickness_mm = 3.0", "thickness_mm = 0", "[sensor.gel] thickness_mm must be above 0 (got 0"),
    ("thickness_mm = 3.0", "thickness_mm = nan", "[sensor.gel] thickness_mm must be a finite number (got nan)"),
    ("thickness_mm = 3.0", "thickness_mm = true", "[sensor.gel] thickness_mm must be a number (got True)"),
    ("thickness_mm = 3.0", "", "[sensor.gel] thickness_mm is missing"),
    (
        '"disc"',
        '"disk"',
        "'curved', 'wedge' or 'mesh' (got 'disk')",
    ),
    ("radius_mm = 15.0", "", '[sensor.gel] shape = "disc" needs radius_mm'),
    ("radius_mm = 2.5", "", '[indenter.A1] shape = "flat_cylinder" needs radius_mm'),
    ("radius_mm = 2.5", "diameter_mm = 5.0", "needs radius_mm, half of its diameter_mm = 5.0"),
    (
        "radius_mm = 2.5",
        "radius_mm = 2.5\ndiameter_mm = 2.5",
        "[indenter.A1] diameter_mm contradicts radius_mm = 2.5 (got 2.5). State it once.",
    ),
    ("thickness_mm = 3.0", "thickness_mm = 3.0\nthickness_mm = 2.5", "line 13: a key or a table is stated twice"),
    (
        "thickness_mm = 3.0",
        "thickness_mm = 3.0\nyoungs_modulus_std_MPa = 0.01\nyoungs_modulus_MPa_std = 0.02",
        "[sensor.gel] youngs_modulus_MPa_std contradicts youngs_modulus_std_MPa = 0.01 (got 0.02)",
    ),
    (
        "radius_mm = 15.0",
        "radius_mm = 15.0\npoisson_ratio = 0.48\npoisson_ratio_std = 0.001\n"
        "poisson_ratio_interval95 = [0.46, 0.49]",
        "[sensor.gel] poisson_ratio_std is narrower than poisson_ratio_interval95 = [0.46, 0.49] (got 0.001)",
    ),
    (
        "radius_mm = 15.0",
        "diameter_mm = 30",
        '[sensor.gel] shape = "disc" needs radius_mm, half of its diameter_mm = 30',
    ),
    ("radius_mm = 2.5", "radius_mm = 2,5", "numbers with a decimal point"),
    ("radius_mm = 2.5", "radius = 2.5", "[indenter.A1] radius is not known (got 2.5). Did you mean radius_mm?"),
    ('bevel = "right"', 'bevel = "rihgt"', "[indenter.A1] bevel must be 'right', 'left', 'top' or 'bottom'"),
    ("[indenter.A1]", "[indenters.A1]", "indenters is not known. Did you mean indenter?"),
    ("[force]", "[forces]", "forces is not known. Did you mean force?"),
    ("std_N = [0.01, 0.01, 0.02]", "std_N = [0.01, 0.02]", "[force] std_N must hold 3 values"),
    ("std_N = [0.01, 0.01, 0.02]", "std_N = [0.01, -1, 0.02]", "[force] std_N[1] must be at least 0 (got -1"),
    ("rate_Hz", "rotation = [[1,0,0],[0,1,0],[0,0,2]]\nrate_Hz", "[force] rotation must be orthogonal"),
    ("rate_Hz", "rotation = [[1,0,0],[0,1,0]]\nrate_Hz", "[force] rotation must hold 3 values"),
    ("offset_s = 0.0", "offset = 0.0", "[clock] offset is not known (got 0.0). Did you mean offset_s?"),
    ("2026-11-21", '"21.11.2026"', "date must be a date such as 2026-11-21 (got '21.11.2026')"),
    ("mm_per_px = 0.06", "mm_per_px = [0.06]", "[sensor] mm_per_px must hold 2 values"),
    ("mm_per_px = 0.06", "", "[sensor] mm_per_px is missing; a custom sensor needs it"),
    ("mm_per_px = 0.06", "mm_per_pix = 0.06", "Did you mean mm_per_px?"),
    ("width_px = 32", "", "[sensor] width_px is missing; a custom sensor needs it"),
    ("width_px = 32", "width_px = 64", "[sensor] width_px = 64, but the frames have 32"),
    ("width_px = 32", "width_px = 32.5", "[sensor] width_px must be a whole number (got 32.5)"),
    (
        "width_px",
        'rectification = "maps.npz"\nwidth_px',
        "maps.npz: the rectification cannot be read: No such file",
    ),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_small(tmp_path / "small")


def message(root: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        read_recording(root)
    return str(caught.value)


@each("old, new, said", FAULTS)
def test_a_fault_is_named_with_its_key(tmp_path: Path, old: str, new: str, said: str) -> None:
    folder = write_small(tmp_path / "small")
    edit(folder / "recording.toml", old, new)
    text = message(folder)
    assert said in text
    assert "recording.toml" in text or "maps.npz" in text


def test_a_value_in_place_of_a_table_is_named(folder: Path) -> None:
    text = (folder / "recording.toml").read_text().replace("[clock]\noffset_s = 0.0\n", "")
    (folder / "recording.toml").write_text("clock = 0.0\n" + text)
    assert "clock must be a table (got 0.0). Open it with its name in [brackets]." in message(folder)


def test_text_in_another_encoding_is_named(folder: Path) -> None:
    (folder / "recording.toml").write_bytes("format = 1\nname = 'Prüfung'\n".encode("latin-1"))
    assert "recording.toml: is not UTF-8 text" in message(folder)


@each(
    "old, new, said",
    [
        (
            "radius_mm = 2.5",
            "radius_mm = 2500",
            "[indenter.A1] radius_mm = 2500 is very large: is it in micrometres?",
        ),
        ("thickness_mm = 3.0", "thickness_mm = 0.003", "[sensor.gel] thickness_mm = 0.003 is very small"),
        (
            "mm_per_px = 0.06",
            "mm_per_px = 16.7",
            "[sensor] mm_per_px = 16.7 is very large: is it in pixels per mm?",
        ),
        ("thickness_mm = 3.0", "thickness_mm = 3.0\nyoungs_modulus_MPa = 200", "is it in kPa or Pa?"),
        ('name = "small"', 'name = "small"\noperator = "Ada"', "operator has no meaning here and is ignored"),
        ("[sensor.gel]", "[gel]", "recording.toml: gel has no meaning here; it has one in [sensor]"),
        ("[sensor.gel]\n", "", "[sensor] thickness_mm has no meaning here; it has one in [sensor.gel]"),
        ("[clock]", "[robot]\nkind = 3\n[clock]", "robot has no meaning here and is ignored"),
    ],
)
def test_what_is_unlikely_or_unknown_is_a_warning(tmp_path: Path, old: str, new: str, said: str) -> None:
    folder = write_small(tmp_path / "small")
    edit(folder / "recording.toml", old, new)
    assert any(said in warning for warning in read_recording(folder).warnings)


def test_unknown_settings_are_kept(folder: Path) -> None:
    edit(folder / "recording.toml", "[clock]", "[robot]\nkind = 3\n[clock]")
    assert read_recording(folder).settings["robot"] == {"kind": 3}


@each(
    "arrays, said",
    [
        ({"map_x": np.zeros((4, 5))}, "map_y is missing; there are map_x"),
        (
            {"map_x": np.zeros((4, 5)), "map_y": np.zeros((5, 4))},
            "map_x and map_y have the same shape (height, width)",
        ),
        ({"map_x": np.array(["a"]), "map_y": np.array(["a"])}, "the rectification cannot be read"),
        ({"map_x": np.array([None]), "map_y": np.array([None])}, "the rectification cannot be read"),
    ],
)
def test_damaged_maps_are_named(tmp_path: Path, arrays: dict[str, Any], said: str) -> None:
    folder = write_small(tmp_path / "small")
    edit(folder / "recording.toml", "width_px", 'rectification = "maps.npz"\nwidth_px')
    np.savez(folder / "maps.npz", **arrays)
    assert said in message(folder)


def test_maps_that_are_no_archive_are_named(folder: Path) -> None:
    edit(folder / "recording.toml", "width_px", 'rectification = "maps.npz"\nwidth_px')
    (folder / "maps.npz").write_bytes(b"not an archive")
    assert "maps.npz: the rectification cannot be read" in message(folder)


def test_a_named_sensor_with_frames_of_another_size_asks_for_its_scale(folder: Path) -> None:
    text = (folder / "recording.toml").read_text()
    named = text.replace('"custom"', '"gelslim3"').replace("width_px = 32\nheight_px = 24\n", "")
    (folder / "recording.toml").write_text(named.replace("mm_per_px = 0.06\n", ""))
    assert "frames of gelslim3 are 32 x 24 here, not 427 x 320" in message(folder)
    (folder / "recording.toml").write_text(named)
    recording = read_recording(folder)
    assert (recording.sensor.width_px, recording.sensor.height_px) == (32, 24)
    assert any("rectification is missing" in warning for warning in recording.warnings)
