"""The calibration folder of gs_sdk: presses, labels and untouched gel; and what is wrong with one, by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each

from tactilevision.errors import InputError
from tactilevision.recording.ball_folder import read_ball_folder
from tactilevision.recording.pictures import read_flats
from tactilevision.recording.write import write_image, write_table

SIZE = (240, 320, 3)


def gs_sdk_folder(root: Path, diameters: tuple[float, ...] = (4.0, 4.0, 6.35)) -> Path:
    """As collect_data.py and label_data.py write it; the last press has no label."""
    write_image(root / "background.png", np.full(SIZE, 90, np.uint8))
    names = []
    for number, diameter in enumerate(diameters):
        name = f"{diameter:.3f}mm/{number}"
        write_image(root / name / "gelsight.png", np.full(SIZE, 100 + number, np.uint8))
        if number < len(diameters) - 1:
            np.savez(root / name / "label.npz", center=[100 + number, 80.5], radius=30)
        names.append(name)
    write_table(root / "catalog.csv", {"experiment_reldir": names, "diameter(mm)": list(diameters)})
    return root


def test_presses_are_read_with_their_labels(tmp_path: Path) -> None:
    found = read_ball_folder(gs_sdk_folder(tmp_path), "gelsight_mini")
    assert [ball.ball_radius_mm for ball in found.balls] == [2.0, 2.0, 3.175]
    assert [ball.centre_px for ball in found.balls] == [(100.0, 80.5), (101.0, 80.5), None]
    assert [ball.contact_radius_px for ball in found.balls] == [30.0, 30.0, None]
    assert [ball.name for ball in found.balls][2] == "6.350mm/2/gelsight.png"
    assert read_flats(found)[0].max() == 90
    assert found.sensor.mm_per_px == (0.0634, 0.0634)
    assert any("3 presses, 2 of them labelled" in one for one in found.warnings)


def test_a_table_in_the_folder_comes_before_the_labels(tmp_path: Path) -> None:
    root = gs_sdk_folder(tmp_path)
    write_table(
        root / "ball.csv",
        {
            "frame": ["4.000mm/1/gelsight.png"],
            "ball_radius_mm": [2.0],
            "centre_x_px": [7.0],
            "centre_y_px": [8.0],
            "contact_radius_px": [9.0],
        },
    )
    (ball,) = read_ball_folder(root, "gelsight_mini").balls
    assert (ball.centre_px, ball.contact_radius_px) == ((7.0, 8.0), 9.0)
    assert ball.path == root / "4.000mm" / "1" / "gelsight.png"


def test_names_of_windows_are_read(tmp_path: Path) -> None:
    root = gs_sdk_folder(tmp_path)
    catalogue = root / "catalog.csv"
    catalogue.write_text(catalogue.read_text().replace("mm/", "mm\\"))
    assert len(read_ball_folder(root, "gelsight_mini").balls) == 3


@each(
    "row, said",
    [
        ("../elsewhere,4.0", "leads out of its folder"),
        ("/etc,4.0", "leads out of its folder"),
        ("4.000mm/9,4.0", "no picture"),
        ("4.000mm/0,-4.0", "line 2: ball_radius_mm must lie between"),
        ("4.000mm/0,wide", "no finite number"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(row: str, said: str, tmp_path: Path) -> None:
    root = gs_sdk_folder(tmp_path)
    (root / "catalog.csv").write_text(f"experiment_reldir,diameter(mm)\n{row}\n")
    with pytest.raises(InputError, match=said):
        read_ball_folder(root, "gelsight_mini")


@each(
    "content",
    [
        {"center": [1.0, 2.0]},
        {"center": [1.0, 2.0, 3.0], "radius": 4},
        {"center": [1.0, np.nan], "radius": 4},
        {"center": [1.0, 2.0], "radius": 0},
        {"center": ["a", "b"], "radius": 4},
        {"center": np.array([{}, {}], object), "radius": 4},
    ],
)
def test_a_label_that_holds_no_circle_is_refused(content: dict[str, Any], tmp_path: Path) -> None:
    root = gs_sdk_folder(tmp_path)
    np.savez(root / "4.000mm" / "0" / "label.npz", allow_pickle=True, **content)
    with pytest.raises(InputError, match=r"label\.npz"):
        read_ball_folder(root, "gelsight_mini")


def test_without_the_untouched_gel_it_says_what_is_missing(tmp_path: Path) -> None:
    root = gs_sdk_folder(tmp_path)
    (root / "background.png").unlink()
    with pytest.raises(InputError, match="untouched gel"):
        read_ball_folder(root, "gelsight_mini")
