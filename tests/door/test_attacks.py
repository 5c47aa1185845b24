"""Attacks on whole readers, as they were tried: each is one clear error, and nothing is written elsewhere."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from each import each
from shared_scenes import sample_reconstructor

from calibration.tasks.session import History, Step, load_history
from tactilevision.errors import InputError
from tactilevision.files.writing import staged
from tactilevision.force.calibrated import read_clock_offset, read_material
from tactilevision.recording.images import read_image
from tactilevision.recording.layout import FORCE_COLUMNS
from tactilevision.recording.read import read_recording
from tactilevision.recording.read_tables import read_forces
from tactilevision.recording.settings import ForceSettings
from tactilevision.recording.tables import read_table
from tactilevision.records.maps import LIGHT
from tactilevision.sensors import deepest_mm

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "sample_frames" / "gelslim3"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """The sample's settings and tables with its first pictures."""
    folder = tmp_path / "recording"
    shutil.copytree(SAMPLE, folder, ignore=shutil.ignore_patterns("frames", "reference", "truth.toml"))
    (folder / "frames").mkdir()
    for path in sorted((SAMPLE / "frames").iterdir())[:3]:
        shutil.copy(path, folder / "frames")
    names = sorted(path.name for path in (folder / "frames").iterdir())
    rows = "".join(f"{name},{0.1 * k}\n" for k, name in enumerate(names))
    (folder / "frames.csv").write_text("frame,time_s\n" + rows)
    for name in ("forces.csv", "presses.csv", "stage.csv"):
        (folder / name).unlink(missing_ok=True)
    return folder


@pytest.mark.parametrize("name", ["../victim.png", "{outside}/victim.png", "link.png"])
def test_a_listed_frame_outside_the_recording_is_refused_by_name(
    name: str, recording: Path, tmp_path: Path
) -> None:
    victim = tmp_path / "victim.png"
    shutil.copy(next((recording / "frames").iterdir()), victim)
    (recording / "frames" / "link.png").symlink_to(victim)
    name = name.format(outside=tmp_path)
    table = recording / "frames.csv"
    table.write_text(table.read_text() + f"{name},0.9\n")
    with pytest.raises(InputError, match="leads out of its folder") as refused:
        read_recording(recording)
    assert refused.value.value == name


def test_a_rectification_outside_the_recording_is_refused(recording: Path) -> None:
    toml = recording / "recording.toml"
    toml.write_text(toml.read_text().replace('"maps.npz"', '"../maps.npz"'))
    if "../maps.npz" not in toml.read_text():
        toml.write_text(toml.read_text().replace("[sensor]", '[sensor]\nrectification = "../maps.npz"', 1))
    with pytest.raises(InputError, match="leads out of its folder"):
        read_recording(recording)


@each("suffix", [".png", ".jpg", ".npy", ".tiff"])
def test_a_pipe_in_place_of_a_picture_is_no_picture(suffix: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / f"a{suffix}")
    with pytest.raises(InputError, match="is a pipe"):
        read_image(tmp_path / f"a{suffix}")


def test_a_link_to_a_device_is_no_picture(tmp_path: Path) -> None:
    (tmp_path / "a.png").symlink_to("/dev/zero")
    with pytest.raises(InputError, match="is a device"):
        read_image(tmp_path / "a.png")


def test_settings_that_are_a_pipe_are_refused(recording: Path) -> None:
    (recording / "recording.toml").unlink()
    os.mkfifo(recording / "recording.toml")
    with pytest.raises(InputError, match="is a pipe"):
        read_recording(recording)


def test_an_indenter_that_states_its_name_is_read(recording: Path) -> None:
    toml = recording / "recording.toml"
    text = toml.read_text()
    first = next(line for line in text.split("\n") if line.startswith("[indenter."))
    toml.write_text(text.replace(first, f'{first}\nname = "x"', 1))
    assert "x" not in read_recording(recording).indenters


def test_a_table_of_a_million_columns_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    path.write_text(",".join(map(str, range(1_000_000))) + "\n")
    with pytest.raises(InputError, match="columns"):
        read_table(path, FORCE_COLUMNS)


@pytest.mark.parametrize(
    ("covariance", "why"),
    [([[-1e-6, 0.0], [0.0, 1e-6]], "covariance"), ([[1e-6, 1.0], [1.0, 1e-6]], "covariance")],
)
def test_a_covariance_that_is_none_is_refused_where_it_stands(
    covariance: list[list[float]], why: str, tmp_path: Path
) -> None:
    path = tmp_path / "calibration.json"
    values = {"youngs_modulus_MPa": {"value": 0.2, "std": 0.01}, "poisson_ratio": {"value": 0.48, "std": 0.01}}
    path.write_text(json.dumps(values | {"covariance": {"of": list(values), "matrix": covariance}}))
    with pytest.raises(InputError, match=why):
        read_material(path)


SOUND = {"youngs_modulus_MPa": {"value": 0.2, "std": 0.01, "interval95": [0.1, 0.4], "unit": "MPa"}}


@each(
    "spoilt, why",
    [
        ({"youngs_modulus_MPa": {"value": "0.2", "interval95": [0.1, 0.4]}}, "youngs_modulus_MPa is no number"),
        ({"youngs_modulus_MPa": {"value": 200.0, "unit": "kPa"}}, "has another unit .got 'kPa'"),
        ({"youngs_modulus_MPa": -1.0}, "calibration.json: Young's modulus must be above 0"),
        ({"covariance": "none"}, "not a matrix of numbers"),
        ({"covariance": [[1.0], [2.0, 3.0]]}, "not a matrix of numbers"),
    ],
)
def test_a_material_of_another_kind_is_refused_and_not_passed_over(
    spoilt: dict[str, object], why: str, tmp_path: Path
) -> None:
    """The interval beside a value that is text, or the deviations beside a broken covariance, never stand in."""
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(SOUND | {"poisson_ratio": 0.48} | spoilt))
    with pytest.raises(InputError, match=why):
        read_material(path)


def test_a_key_that_stands_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text('{"poisson_ratio": 0.48, "youngs_modulus_MPa": 0.2, "poisson_ratio": 0.3}')
    with pytest.raises(InputError, match="'poisson_ratio' occurs twice"):
        read_material(path)


def test_a_clock_offset_that_is_no_number_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text('{"clock_offset_s": {"value": NaN}}')
    with pytest.raises(InputError, match="not a readable calibration"):
        read_clock_offset(path)


def test_a_recording_in_a_history_is_never_an_option_of_the_script() -> None:
    history = History(("--effect=/tmp/evil.py",), (), ())
    assert "compare ./--effect=/tmp/evil.py --out" in history.script("out")
    assert "compare ./--effect=/tmp/evil.py" in history.command()


def test_a_tampered_history_puts_no_command_into_the_script(tmp_path: Path) -> None:
    path = tmp_path / "history.json"
    row = {"key": "x; touch /tmp/owned", "path": ""}
    path.write_text(json.dumps({"recordings": ["a"], "steps": [row], "undone": []}))
    with pytest.raises(InputError, match="no history"):
        load_history(path)
    script = History(("a b; c",)).add(Step("mine", "$(touch owned).py")).script("out; x")
    command = script.split("\n")[2]
    assert shlex.split(command)[2:] == ["a b; c", "--with", "$(touch owned).py", "--out", "out; x"]


@pytest.mark.parametrize(
    "content", ['{"recordings": 3}', '{"recordings": ["a"], "steps": [3], "undone": []}', "[]"]
)
def test_a_history_of_another_shape_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "history.json").write_text(content)
    with pytest.raises(InputError, match="no history"):
        load_history(tmp_path / "history.json")


INTERRUPTED = """
import sys
import tactilevision.cli as cli
def interrupted():
    try:
        exec("raise KeyboardInterrupt")
    except KeyboardInterrupt:
        return 130
cli._run = interrupted
sys.exit(cli.main())
"""


def test_ctrl_c_within_an_exec_ends_with_130_too(tmp_path: Path) -> None:
    """CPython ends `python -m` by the signal itself where the interrupt came out of an exec."""
    (tmp_path / "interrupted.py").write_text(INTERRUPTED)
    command = [sys.executable, "-m", "interrupted"]
    about = os.environ | {"PYTHONPATH": str(ROOT)}
    assert subprocess.run(command, cwd=tmp_path, env=about, check=False, timeout=60).returncode == 130


def test_sigterm_within_a_private_effect_ends_the_run(tmp_path: Path) -> None:
    """What guards against the effect's own SystemExit does not hold up the word to end."""
    effect = tmp_path / "effect.py"
    effect.write_text("import os, signal, time\nos.kill(os.getppid(), signal.SIGTERM)\ntime.sleep(9)\n")
    command = [
        sys.executable,
        "-m",
        "tactilevision",
        "diagnose",
        str(ROOT / "sample_frames" / "hidden_rig"),
        "--effect",
    ]
    about = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*command, str(effect)], cwd=tmp_path, env=about, check=False, timeout=120, capture_output=True
    )
    assert done.returncode == 143, done.stderr.decode()


def test_a_method_whose_numbers_do_not_fit_is_refused(tmp_path: Path) -> None:
    from tactilevision.photometric.storage import digest, load_method

    source = ROOT / "tests" / "data" / "methods" / "polynomial.npz"
    with np.load(source) as file:
        arrays = dict(file)
    card = json.loads(source.with_suffix(".json").read_text())
    for name, array in arrays.items():
        for other in (np.zeros(3), np.array("text"), np.zeros((2, 0)), None):
            path = tmp_path / "method.npz"
            np.savez(path, **{key: value for key, value in (arrays | {name: other}).items() if value is not None})
            path.with_suffix(".json").write_text(json.dumps(card | {"sha256": digest(path)}))
            try:
                load_method(path)
            except InputError:
                continue
            same = other is not None and other.shape == array.shape
            assert same or name in ("marks", "quiet"), name  # both may be absent
    np.savez(path, **arrays, walls_left=np.zeros(8))
    path.with_suffix(".json").write_text(json.dumps(card | {"sha256": digest(path)}))
    with pytest.raises(InputError, match=r"does not read.*walls_left"):
        load_method(path)


@pytest.mark.parametrize("kind", ["grey", "noise"])
def test_a_picture_of_nothing_is_never_a_depth(kind: str) -> None:
    """Such pictures read deeper than the gel is thick and are rejected, or the map says that it cannot be."""
    reconstructor = sample_reconstructor()
    shape = (reconstructor.sensor.height_px, reconstructor.sensor.width_px, 3)
    grey = np.full(shape, 128, np.uint8)
    noise = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    height = reconstructor.sound_map(grey if kind == "grey" else noise)
    assert height is None or (LIGHT in height.flags and height.depth_mm.max() < deepest_mm(reconstructor.sensor))


def test_a_force_that_no_gel_bears_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    path.write_text("time_s,fx_N,fy_N,fz_N\n0,0,0,1\n0.01,0,0,2e6\n0.02,0,0,1\n")
    with pytest.raises(InputError, match="line 3: fz_N must lie between"):
        read_forces(path, ForceSettings(), toml=tmp_path / "recording.toml")


def test_what_a_killed_run_left_is_cleared_and_a_running_one_is_left_alone(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for name in (f".unfinished-{dead.pid}-abc", ".unfinished-abc", f".unfinished-{os.getpid()}-abc"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "half.png").write_bytes(b"half")
    with staged(tmp_path) as stage:
        (stage / "new.txt").write_text("new")
    assert sorted(path.name for path in tmp_path.iterdir()) == [f".unfinished-{os.getpid()}-abc", "new.txt"]
