"""The examples run as they stand and find what was put into the samples."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from tactilevision.recording.read import read_recording

EXAMPLES = Path(__file__).parents[2] / "examples"


def said_by(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    monkeypatch.chdir(folder)
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    return capsys.readouterr().out


@pytest.fixture
def said(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> str:
    return said_by(request.param, tmp_path, monkeypatch, capsys)


def first(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found.group(1))


def test_every_example_is_run_here() -> None:
    here = Path(__file__).read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        assert f'"{path.stem}"' in here, path.name


@pytest.mark.slow  # the pages run it, too
@pytest.mark.parametrize("said", ["height_map"], indirect=True)
def test_a_frame_becomes_a_map_on_disk(said: str, tmp_path: Path) -> None:
    depth, std = first(r": ([\d.]+) ±", said), first(r"± ([\d.]+) mm", said)
    assert abs(depth - 0.33) < 3 * std  # .3 mm of machined height, less the rise, and the overshoot of the ramp
    assert (tmp_path / "height.tiff").is_file()


@pytest.mark.parametrize("said", ["custom_sensor"], indirect=True)
def test_a_grid_of_dots_makes_a_sensor_that_a_recording_can_name(said: str, tmp_path: Path) -> None:
    assert first(r"px straightened, ([\d.]+) by", said) == pytest.approx(10.5 / 280, rel=0.1)
    about = "format = 1\nname = 'r'\n" + (tmp_path / "sensor.toml").read_text()
    about += "[indenter.A]\nshape = 'flat_cylinder'\nradius_mm = 2.5\nheight_mm = 0.2\n"
    (tmp_path / "recording.toml").write_text(about)
    (tmp_path / "points.csv").write_text("press,indenter,depth_mm,fz_N\np,A,0.2,1.0\n")
    sensor = read_recording(tmp_path).sensor
    assert sensor.mm_per_px[0] != sensor.mm_per_px[1]
    assert sensor.rectification is not None
    assert sensor.rectification[0].shape == (sensor.height_px, sensor.width_px)


@pytest.mark.slow  # the pages run it, too
@pytest.mark.parametrize("said", ["live_loop"], indirect=True)
def test_a_stream_says_when_the_gel_is_touched(said: str) -> None:
    lines = said.splitlines()
    assert lines[0].endswith("free")
    assert sum("contact" in line for line in lines) > 10
    assert "latency in ms" in lines[-1]


@pytest.mark.parametrize("said", ["material_from_points"], indirect=True)
def test_the_published_route_and_what_the_points_leave_open(said: str) -> None:
    assert "E = 0.1988 MPa, nu = 0.4797" in said
    assert "do not determine poisson_ratio" in said


@pytest.mark.slow  # the pages run it, too
@pytest.mark.parametrize("said", ["add_an_effect"], indirect=True)
def test_the_error_falls_to_the_floor(said: str) -> None:
    held_out = [float(value) for value in re.findall(r": ([\d.]+) mN on held-out presses", said)]
    floor = first(r"viscoelasticity: .*repeatability ([\d.]+)", said)
    assert len(held_out) == 2
    assert held_out[1] < 1.2 * floor < held_out[0]


@pytest.mark.slow  # the pages run it, too
@pytest.mark.parametrize("said", ["own_effect"], indirect=True)
def test_a_planted_effect_of_ones_own_is_found(said: str) -> None:
    assert abs(first(r"found ([\d.]+)", said) - 0.06) < 3 * first(r"± ([\d.]+)", said)


@pytest.mark.parametrize("said", ["gel_mechanics"], indirect=True)
def test_the_gel_as_a_solid(said: str, tmp_path: Path) -> None:
    assert first(r"kappa = ([\d.]+)", said) == pytest.approx(2.8103, abs=1e-4)
    assert "*HYPERELASTIC" in (tmp_path / "gel.inp").read_text()


@pytest.mark.slow  # the pages run it, too
@pytest.mark.parametrize("said", ["ros2_node"], indirect=True)
def test_the_node_answers_the_sample_without_ros(said: str, tmp_path: Path) -> None:
    deepest_um = [first(r"gel_pad, to (\d+) um", line) for line in said.splitlines()]
    assert len(deepest_um) == 10
    assert max(deepest_um) > 300
    assert (tmp_path / "ros2_node.png").is_file()


@pytest.mark.slow  # the pages run it, too
@pytest.mark.parametrize("said", ["watch_the_error_fall"], indirect=True)
def test_a_notebook_finds_what_the_gel_does(said: str) -> None:
    assert first(r"tau_s ([\d.]+)", said) == pytest.approx(2.2, abs=0.2)
