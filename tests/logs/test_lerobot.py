"""A data set that LeRobot wrote gains depth, contact and force; one that is not whole is refused in a sentence."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tactilevision.cli import main
from tactilevision.errors import InputError, OutputError
from tactilevision.profile.sensor import CalibratedSensor
from tactilevision.records.maps import Frame, HeightMap
from tactilevision.records.rig import Gel
from tactilevision.robots import lerobot as statistics
from tactilevision.robots.depth_video import CODES, DepthVideo, depth_range_mm
from tactilevision.robots.lerobot import STEP_MM, Annotated, annotate, base_of, read_frame, shrunk
from tactilevision.robots.lerobot_dataset import read_dataset

sys.path.insert(0, str(Path(__file__).parents[1] / "profile"))
from lamp_sensor import free, pressed, profile, saved

FIXTURE = Path(__file__).parents[1] / "data" / "lerobot_v3"  # lerobot_fixture.py says how LeRobot wrote it
TACTILE, WRIST = "observation.images.tactile", "observation.images.wrist"
TABLE, VIDEO = "data/chunk-000/file-000.parquet", f"videos/{TACTILE}/chunk-000/file-000.mp4"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
PRESSED = np.array([False] * 3 + [True] * 3 + [False] * 3 + [True])


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A copy that a test may spoil."""
    return Path(shutil.copytree(FIXTURE, tmp_path / "set"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Annotated]:
    out = tmp_path_factory.mktemp("made")
    return out, annotate(read_dataset(FIXTURE, TACTILE), CalibratedSensor(profile()), out)


def change(path: Path, how: Callable[[pa.Table], pa.Table]) -> None:
    pq.write_table(how(pq.read_table(path)), path)


def tell(path: Path, **news: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | news))


def encode(path: Path, times_s: Iterator[float] | list[float], size: tuple[int, int] = (180, 240)) -> None:
    """A video of dark pictures at these times."""
    with av.open(str(path), "w", format="mp4") as box:
        stream = box.add_stream("libx264", rate=10, options={"bf": "0"})
        stream.height, stream.width, stream.pix_fmt = *size, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for time_s in times_s:
            frame = av.VideoFrame.from_ndarray(np.full((*size, 3), 20, np.uint8), format="rgb24")
            frame.pts, frame.time_base = round(1000 * time_s), Fraction(1, 1000)
            box.mux(stream.encode(frame))
        box.mux(stream.encode())


def test_frames_come_in_order_from_video_and_table() -> None:
    shown = list(read_dataset(FIXTURE, TACTILE).pictures())
    assert [(row.episode.number, row.frame) for row, _ in shown] == [(0, k) for k in range(6)] + [
        (1, k) for k in range(4)
    ]
    for k, (_, rgb) in enumerate(shown):
        drawn = pressed(k - 3 if k < 6 else 0, 1.5) if PRESSED[k] else free(k % 6)
        assert np.abs(rgb.astype(int) - drawn).mean() < 3.0  # H.264 at LeRobot's own quality
    small = [rgb for _, rgb in read_dataset(FIXTURE, WRIST).pictures()]
    assert [np.unique(rgb).tolist() for rgb in small] == [[10 * k] for k in range(10)]


def test_depth_contact_and_force_stand_beside_the_frames(made: tuple[Path, Annotated]) -> None:
    out, told = made
    table = pq.read_table(out / TABLE)
    assert (told.episodes, told.frames, told.in_contact, told.not_read) == (2, 10, 4, 0)
    np.testing.assert_array_equal(table["observation.tactile.contact"].to_numpy(), PRESSED)
    depth = np.array(table["observation.tactile.depth_mm"].to_pylist(), float)
    assert depth.shape == (10, 45, 60)
    raw = read_frame(CalibratedSensor(profile()), pressed(0, 1.5), shrink=4)
    peak = table["observation.tactile.peak_mm"].to_numpy()
    np.testing.assert_allclose(peak[PRESSED], raw["peak_mm"], rtol=0.15)  # LeRobot packs at crf 30
    assert np.nanmean(np.abs(depth[PRESSED] - raw["depth_mm"])) < 0.04
    assert np.nanmax(np.abs(depth[~PRESSED])) < 0.2
    assert not np.any(depth[np.isfinite(depth)] * 1024 % 1)
    wrench = np.array(table["observation.tactile.wrench"].to_pylist())
    assert (wrench[PRESSED, 2] > 0.1).all()
    assert (np.abs(wrench[~PRESSED, 2]) < 0.05).all()


@pytest.fixture(scope="module")
def native(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Annotated]:
    out = tmp_path_factory.mktemp("native")
    return out, annotate(read_dataset(FIXTURE, TACTILE), CalibratedSensor(profile()), out, native=True)


def decoded(path: Path) -> list[Any]:
    """12-bit codes by PyAV alone."""
    with av.open(str(path)) as box:
        return [frame.to_ndarray(format="gray12le").astype(float) for frame in box.decode(video=0)]


def test_native_depth_comes_back_within_half_a_step_of_a_micrometre(native: tuple[Path, Annotated]) -> None:
    out, told = native
    assert told.features[:2] == (f"{TACTILE}_depth", "observation.tactile.depth_valid")
    info = json.loads((out / "meta/info.json").read_text())["features"][f"{TACTILE}_depth"]
    about, sensor = info["info"], CalibratedSensor(profile())
    assert (info["dtype"], info["shape"], about["is_depth_map"]) == ("video", [45, 60, 1], True)
    assert (about["video.depth_min"], about["video.use_log"], about["depth_unit"]) == (0.0, False, "m")
    thickness_mm = sensor.profile.sensor.gel.thickness_mm  # type: ignore[union-attr]
    assert about["video.depth_max"] == pytest.approx(1e-3 * thickness_mm)
    step_mm = thickness_mm / CODES
    assert step_mm <= 1e-3
    valid = np.array(pq.read_table(out / TABLE)["observation.tactile.depth_valid"].to_pylist())
    codes = decoded(out / "videos" / f"{TACTILE}_depth" / "chunk-000/file-000.mp4")
    assert len(codes) == len(valid) == 10
    sensor.look(
        [sensor.reconstructor.rectified(Frame(rgb)) for _, rgb in read_dataset(FIXTURE, TACTILE).pictures()]
    )
    for code, known, (_, rgb) in zip(codes, valid, read_dataset(FIXTURE, TACTILE).pictures(), strict=True):
        depth = read_frame(sensor, rgb, shrink=4)["depth_mm"]
        np.testing.assert_array_equal(known, np.isfinite(depth))
        assert np.abs(code * step_mm - np.clip(depth, 0, None))[known].max() <= step_mm / 2 * (1 + 1e-6)
        assert not code[~known].any()
    each = pq.read_table(out / EPISODES)
    assert each[f"videos/{TACTILE}_depth/from_timestamp"].to_pylist() == [0.0, 0.6]
    assert each[f"videos/{TACTILE}_depth/to_timestamp"].to_pylist() == [0.6, 1.0]
    stats = json.loads((out / "meta/stats.json").read_text())[f"{TACTILE}_depth"]
    assert np.shape(stats["mean"]) == (1, 1, 1)
    assert stats["max"][0][0][0] == pytest.approx(1e-3 * step_mm * max(code.max() for code in codes))
    assert (out / VIDEO).read_bytes() == (FIXTURE / VIDEO).read_bytes()


def test_any_depth_of_the_gel_is_stored_and_what_is_beyond_is_masked(tmp_path: Path) -> None:
    video = DepthVideo((33, 51), 29.97, depth_range_mm(replace(profile().sensor, gel=Gel(6.0))))
    assert video.range_mm == pytest.approx(4.095)
    rng = np.random.default_rng(3)
    maps = [rng.uniform(0, 4.095, (33, 51)) for _ in range(5)]
    maps[2][0, :3] = np.nan, 4.2, -0.3
    with video.writer(tmp_path / "depth.mp4") as put:
        stored = [put(one) for one in maps]
    for code, kept, depth in zip(decoded(tmp_path / "depth.mp4"), stored, maps, strict=True):
        valid = np.isfinite(kept)
        np.testing.assert_allclose(code[valid] * 1e-3, kept[valid], atol=1e-9)
        assert np.abs(kept - np.clip(depth, 0, None))[valid].max() <= 0.5001e-3
    assert np.isnan(stored[2][0, :2]).all()
    assert stored[2][0, 2] == 0.0


def test_native_depth_needs_the_gels_thickness_and_tells_depth_beyond_it(root: Path, tmp_path: Path) -> None:
    made = profile()
    bare = CalibratedSensor(
        replace(made, sensor=replace(made.sensor, gel=None), calibration=None, compliance=None)
    )
    with pytest.raises(InputError, match="thickness, which the profile does not state"):
        annotate(read_dataset(root, TACTILE), bare, tmp_path / "out", native=True)
    thin = CalibratedSensor(
        replace(made, sensor=replace(made.sensor, gel=Gel(0.3)), calibration=None, compliance=None)
    )
    assert annotate(read_dataset(root, TACTILE), thin, tmp_path / "thin", native=True).not_read == 4
    table = pq.read_table(tmp_path / "thin" / TABLE)
    assert "mm deep, more than the 0.24 mm that this gel allows" in table["observation.tactile.flags"][9].as_py()
    assert not np.any(table["observation.tactile.depth_valid"].to_pylist()[9])


def test_single_pictures_are_read_as_they_were_taken(root: Path, tmp_path: Path) -> None:
    raw = [free(0), pressed(0, 1.5)] * 5
    packed = [{"bytes": cv2.imencode(".png", rgb[..., ::-1])[1].tobytes(), "path": None} for rgb in raw]
    change(root / TABLE, lambda table: table.append_column(TACTILE, [packed]))
    features = json.loads((root / "meta/info.json").read_text())["features"]
    features[TACTILE]["dtype"] = "image"
    tell(root / "meta/info.json", features=features)
    sensor, out = CalibratedSensor(profile()), tmp_path / "out"
    assert annotate(read_dataset(root, TACTILE), sensor, out, shrink=1).in_contact == 5
    depth = np.array(pq.read_table(out / TABLE)["observation.tactile.depth_mm"][1].as_py(), np.float32)
    expected = sensor.read(raw[1]).height
    assert isinstance(expected, HeightMap)
    np.testing.assert_allclose(depth[expected.valid], expected.depth_mm[expected.valid], atol=STEP_MM / 2)
    assert np.isnan(depth[~expected.valid]).all()


def test_all_that_was_there_is_kept(made: tuple[Path, Annotated]) -> None:
    out, _ = made
    before, after = pq.read_table(FIXTURE / TABLE), pq.read_table(out / TABLE)
    assert after.select(before.column_names).equals(before.replace_schema_metadata())
    assert (out / VIDEO).read_bytes() == (FIXTURE / VIDEO).read_bytes()
    assert (out / "meta/tasks.parquet").read_bytes() == (FIXTURE / "meta/tasks.parquet").read_bytes()
    old, new = pq.read_table(FIXTURE / EPISODES), pq.read_table(out / EPISODES)
    assert new.select(old.column_names).equals(old)
    names = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
    assert names == {str(path.relative_to(FIXTURE)) for path in FIXTURE.rglob("*") if path.is_file()}


def test_the_new_features_follow_the_schema_of_the_old(made: tuple[Path, Annotated]) -> None:
    out, told = made
    old, new = (json.loads((root / "meta/info.json").read_text()) for root in (FIXTURE, out))
    assert {key: value for key, value in new.items() if key != "features"} == {
        key: value for key, value in old.items() if key != "features"
    }
    assert set(new["features"]) == {*old["features"], *told.features}
    stats, each = json.loads((out / "meta/stats.json").read_text()), pq.read_table(out / EPISODES)
    numeric = [key for key in told.features if new["features"][key]["dtype"] != "string"]
    for key in numeric:
        assert "image" not in key
        assert set(stats[key]) == set(stats["observation.state"])
        assert stats[key]["count"] == [10]
        assert each[f"stats/{key}/count"].to_pylist() == [[6], [4]]
    assert np.shape(stats["observation.tactile.depth_mm"]["mean"]) == (1, 1)
    assert stats["observation.tactile.contact"]["mean"] == [0.4]


def test_statistics_are_those_of_all_values_and_nan_is_left_out() -> None:
    rng = np.random.default_rng(5)
    values = rng.normal(size=(90, 2))
    parts = [statistics.statistics_of_values(part) for part in (values[:20], values[20:])]
    whole = statistics.pooled_statistics(parts)
    np.testing.assert_allclose(whole["mean"], values.mean(axis=0))
    np.testing.assert_allclose(whole["std"], values.std(axis=0))
    np.testing.assert_allclose(whole["min"], values.min(axis=0))
    gaps = statistics.statistics_of_values(np.array([[1.0, np.nan], [3.0, np.nan], [np.nan, np.nan]]))
    assert (gaps["mean"].tolist(), gaps["max"].tolist()) == ([2.0, 0.0], [3.0, 0.0])
    maps = [np.full((40, 50), float(k)) for k in range(3)]
    maps[2][7, 9], maps[0][0, 0] = 9.0, np.nan
    found = statistics.statistics_of_depth([statistics.sample_depth(one) for one in maps])
    assert (found["max"].item(), found["min"].item(), found["q50"].item()) == (9.0, 0.0, 1.0)


def test_maps_shrink_by_means_of_what_is_known() -> None:
    depth = np.zeros((5, 6))
    depth[:2, :2], depth[:2, 2:4] = [[1.0, 2.0], [3.0, np.nan]], [[1.0, np.nan], [np.nan, np.nan]]
    small = shrunk(depth, 2)
    assert small.shape == (2, 3)
    assert small[0, 0] == pytest.approx(2.0, abs=STEP_MM)
    assert np.isnan(small[0, 1])
    assert shrunk(depth, 1) is depth


def test_no_new_key_is_taken_for_a_picture() -> None:
    assert base_of(TACTILE) == "observation.tactile"
    assert base_of("observation.image") == "observation.tactile"
    assert base_of("observation.images.image_left") == "observation.tactile_left"


def test_what_is_no_such_data_set_is_told(root: Path, tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match=r"no such camera.*observation.images.tactile \(video\), .*wrist \(image\)"
    ):
        read_dataset(root, "observation.images.left")
    with pytest.raises(InputError, match="no data set of LeRobot"):
        read_dataset(tmp_path, TACTILE)
    tell(root / "meta/info.json", codebase_version="v2.1")
    with pytest.raises(InputError, match=r"version that is not read.*v2\.1.*convert"):
        read_dataset(root, TACTILE)
    tell(root / "meta/info.json", codebase_version="v3.0", fps=0)
    with pytest.raises(InputError, match="no rate"):
        read_dataset(root, TACTILE)


def test_missing_frames_and_files_are_told(root: Path) -> None:
    change(root / TABLE, lambda table: pa.concat_tables([table.slice(0, 2), table.slice(3)]))
    with pytest.raises(InputError, match=r"frame 3 of episode 0, where frame 2 of episode 0 is due"):
        list(read_dataset(root, TACTILE).rows())
    change(root / TABLE, lambda table: pq.read_table(FIXTURE / TABLE).slice(0, 8))
    with pytest.raises(InputError, match=r"end before the last episode does.*episode 1"):
        list(read_dataset(root, TACTILE).rows())
    (root / TABLE).unlink()
    with pytest.raises(InputError, match=r"lacks a file.*data/chunk-000/file-000\.parquet"):
        list(read_dataset(root, TACTILE).rows())
    change(root / EPISODES, lambda table: table.slice(1))
    with pytest.raises(InputError, match="lacks an episode"):
        read_dataset(root, TACTILE)


def test_a_frame_off_the_stated_rate_is_told(root: Path) -> None:
    tell(root / "meta/info.json", fps=12)
    with pytest.raises(InputError, match=r"episode 0, frame 1: .*not at the stated rate of 12"):
        list(read_dataset(root, TACTILE).rows())


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (
            [0.0, 0.1, 0.2, 0.33, 0.4],
            r"episode 0, frame 3.*constant rate of 10 a second.*0\.3300 s, not 0\.3000 s",
        ),
        ([0.1 * k for k in range(8)], r"episode 1, frame 2.*the video ends"),
        ([0.05 * k for k in range(20)], r"episode 0, frame 1.*constant rate"),
    ],
)
def test_a_video_of_another_or_variable_rate_is_told(root: Path, times: list[float], said: str) -> None:
    encode(root / VIDEO, times)
    with pytest.raises(InputError, match=said):
        list(read_dataset(root, TACTILE).pictures())


def test_every_cut_and_flipped_byte_is_told_or_harmless(root: Path) -> None:
    rng, said = np.random.default_rng(2), []
    for name in (TABLE, EPISODES, VIDEO):
        whole = (FIXTURE / name).read_bytes()
        for trial in range(5):
            torn = bytearray(whole[: rng.integers(1, len(whole))] if trial % 2 else whole)
            torn[rng.integers(len(torn))] ^= 1 << rng.integers(8)
            (root / name).write_bytes(torn)
            try:
                list(read_dataset(root, TACTILE).pictures())
            except InputError as fault:
                said.append(str(fault))
        (root / name).write_bytes(whole)
    assert len(said) >= 7
    assert not [one for one in said if "\n" in one]


def test_a_name_that_leads_elsewhere_is_refused(root: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere.parquet").write_bytes((root / TABLE).read_bytes())
    (root / TABLE).unlink()
    (root / TABLE).symlink_to(tmp_path / "elsewhere.parquet")
    with pytest.raises(InputError, match="leads out of its folder"):
        list(read_dataset(root, TACTILE).rows())


def test_nothing_is_written_where_frames_do_not_fit(root: Path, tmp_path: Path) -> None:
    sensor, out = CalibratedSensor(profile()), tmp_path / "out"
    with pytest.raises(InputError, match=r"16 x 12 px.*240 x 180 px"):
        annotate(read_dataset(root, WRIST), sensor, out)
    encode(root / VIDEO, [0.1 * k for k in range(9)])
    with pytest.raises(InputError, match="the video ends"):
        annotate(read_dataset(root, TACTILE), sensor, out)
    assert not [path for path in out.rglob("*") if path.is_file()]


def test_the_command_writes_once_and_says_what(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["lerobot", root, "--camera", TACTILE, "--sensor", saved(tmp_path), "--out", out, "--shrink", "20"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["tactilevision", *map(str, words)])
        assert main() == 0
        assert "10 frames of 2 episodes" in capsys.readouterr().out
        assert main() == 2
    assert "holds meta already" in capsys.readouterr().err
    with pytest.raises(InputError, match="such a feature already"):
        annotate(read_dataset(out, TACTILE), CalibratedSensor(profile()), tmp_path / "again")
    with pytest.raises(OutputError):
        annotate(read_dataset(root, TACTILE), CalibratedSensor(profile()), out)


def loaded(*words: object) -> Any:
    """What LeRobot's own loader says. LEROBOT_PYTHON names a Python that has it, with other versions of torch."""
    python = os.environ.get("LEROBOT_PYTHON") or (sys.executable if importlib.util.find_spec("lerobot") else None)
    if python is None:
        pytest.skip("LeRobot is not installed: set LEROBOT_PYTHON")
    plain = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | {"HF_HUB_OFFLINE": "1"}
    script = Path(__file__).with_name("lerobot_loads.py")
    told = [python, str(script), *map(str, words)]
    ran = subprocess.run(told, capture_output=True, text=True, env=plain, check=False)
    if "depth_output_unit" in ran.stderr:
        pytest.skip("this LeRobot is older than 0.6 and has no native depth")
    assert ran.returncode == 0, ran.stderr[-2000:]
    return json.loads(ran.stdout.splitlines()[-1])


@pytest.mark.slow
def test_lerobot_dequantizes_the_native_depth_exactly(native: tuple[Path, Annotated]) -> None:
    out, key = native[0], f"{TACTILE}_depth"
    found = loaded(out, key)
    depth_m, valid = np.array(found["depth_m"]), np.array(found["valid"], bool)
    about = json.loads((out / "meta/info.json").read_text())["features"][key]["info"]
    codes = np.stack(decoded(out / "videos" / key / "chunk-000/file-000.mp4"))
    expected = codes * about["video.depth_max"] / CODES
    assert depth_m.shape == (10, 1, 45, 60)
    np.testing.assert_allclose(depth_m[:, 0], expected, atol=1e-9)  # float32, a thousandth of a step
    column = pq.read_table(out / TABLE)["observation.tactile.depth_valid"].to_pylist()
    np.testing.assert_array_equal(valid, np.array(column))
    assert found["stats"]["max"][0][0][0] == pytest.approx(expected.max(), rel=1e-6)


@pytest.mark.slow
def test_lerobots_own_loader_opens_what_was_written(made: tuple[Path, Annotated]) -> None:
    out, _ = made
    found, table = loaded(out), pq.read_table(out / TABLE)
    assert found["kinds"]["observation.tactile.depth_mm"] == [[45, 60], "torch.float32"]
    assert found["kinds"]["observation.tactile.contact"] == [[], "torch.bool"]
    assert found["kinds"][TACTILE] == [[3, 180, 240], "torch.float32"]
    depth = np.array(table["observation.tactile.depth_mm"].to_pylist(), float)
    np.testing.assert_array_equal(found["deepest"], np.nanmax(depth, axis=(1, 2)))
    wrench = np.array(table["observation.tactile.wrench"].to_pylist(), np.float32)
    np.testing.assert_array_equal(np.array(found["pressing"], np.float32), wrench[:, 2])
    assert found["contact"] == PRESSED.tolist()
    assert found["flags"] == table["observation.tactile.flags"][0].as_py()
    assert {"min", "max", "mean", "std", "count", "q01", "q99"} <= set(found["stats"])
