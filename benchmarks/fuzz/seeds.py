"""Small valid files, written by the library itself."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from calibration.tasks.session import History, Step
from tactilevision.batch.folder import FrameResult
from tactilevision.batch.jobs import Journal
from tactilevision.files.arrays import read_archive
from tactilevision.files.exports import write_npz
from tactilevision.files.tiff import write_tiff
from tactilevision.photometric.card import MethodCard
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.methods.polynomial import POWERS, PRODUCTS, Polynomial
from tactilevision.photometric.reference import Reference
from tactilevision.photometric.storage import load_method, save_method
from tactilevision.press.certified_faces import DepthScale
from tactilevision.profile.model import Profile
from tactilevision.profile.storage import write_profile
from tactilevision.recording import layout
from tactilevision.recording.model import BallPress
from tactilevision.recording.write import MAPS, write_balls, write_frame_table, write_image, write_table
from tactilevision.records.maps import HeightMap
from tactilevision.records.rig import Gel, Indenter, Sensor
from tactilevision.robots.log_export import depth_message, open_writer, wrench_message
from tactilevision.synthetic.simulation import write_toml

FINGERPRINT = "0" * 64
HEIGHT, WIDTH = 10, 12  # px
_DATA_SET = Path(__file__).parents[2] / "tests" / "data" / "lerobot_v3"
_MODELS = Path(__file__).parents[2] / "models"


def pixels() -> npt.NDArray[np.uint8]:
    """A coloured ramp (HEIGHT, WIDTH, 3), grey levels."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([10 * x, 10 * y, 5 * (x + y)], axis=-1).astype(np.uint8)


def picture(path: Path) -> None:
    """One picture; its ending says which kind."""
    write_image(path, pixels())


def recording(folder: Path) -> None:
    """A recording with every table, four pictures and a rectification."""
    for place in ("frames", "reference/flat", "reference/ball"):
        (folder / place).mkdir(parents=True, exist_ok=True)
    names = [f"{k}.png" for k in range(3)]
    for name in names:
        picture(folder / "frames" / name)
    picture(folder / "reference/flat/a.png")
    picture(folder / "reference/ball/b.png")
    write_frame_table(folder, names, times_s=np.array([0.0, 0.5, 1.0]))
    write_balls(folder, [BallPress(folder / "reference/ball/b.png", 2.0, (5.0, 5.0), 3.0)])
    indenter = {"shape": "flat_cylinder", "radius_mm": 2.5, "height_mm": 0.3}
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    np.savez_compressed(folder / MAPS, map_x=x, map_y=y)
    gel = {"thickness_mm": 3.0, "shape": "disc", "radius_mm": 15.0, "poisson_ratio": 0.48}
    sensor = {"kind": "gelslim3", "mm_per_px": [0.06, 0.06], "rectification": MAPS, "gel": gel}
    force = {"std_N": [0.01, 0.01, 0.01], "rate_Hz": 10.0, "rotation": np.eye(3).tolist()}
    about = {"format": layout.FORMAT, "name": "seed", "date": "2026-11-21", "sensor": sensor, "force": force}
    write_toml(folder / layout.SETTINGS, about | {"clock": {"offset_s": 0.1}, "indenter": {"A": indenter}})
    _tables(folder)


def log(folder: Path, name: str) -> None:
    """A log of two wrenches and a small map, by its ending."""
    path = folder / name
    with open_writer(path if path.suffix != ".db3" else path.with_suffix("")) as (put, kind):
        for number in range(2):
            about: dict[str, Any] = {"time_ns": 10**18 + number * 10**8, "frame_id": "pad", "encoding": kind}
            put("/ft", wrench_message(np.ones(3), np.ones(3), **about), about["time_ns"])
        image = depth_message(_map(), **about)
        image.encoding, image.step, image.data = "rgb8", 3 * WIDTH, pixels().ravel()
        put("/camera", image, about["time_ns"])
    for found in path.with_suffix("").glob("*.db3"):
        found.replace(path)


def dataset(folder: Path) -> None:
    """A data set that LeRobot wrote."""
    shutil.copytree(_DATA_SET, folder, dirs_exist_ok=True)


def _map() -> HeightMap:
    return HeightMap(np.zeros((HEIGHT, WIDTH), np.float32), np.ones((HEIGHT, WIDTH), bool), (0.06, 0.06))


def _tables(folder: Path) -> None:
    time_s = np.linspace(-1.0, 2.0, 12)
    ramp = np.linspace(0.0, 1.0, 12)
    force = {"fx_N": 0 * ramp, "fy_N": 0 * ramp, "fz_N": ramp}
    write_table(folder / layout.FORCES, {"time_s": time_s, **force, "temperature_C": 20 + ramp})
    write_table(folder / layout.STAGE, {"time_s": time_s, "z_mm": ramp})
    press: dict[str, Any] = {"press": ["p1", "p2"], "indenter": ["A", "A"]}
    span = {"start_s": [0.1, 0.6], "end_s": [0.4, 0.9], "date": ["2026-11-21", ""], "rest_s": [3.0, 4.0]}
    write_table(folder / layout.PRESSES, press | span)
    label: dict[str, Any] = {"press": ["p1"] * 6 + ["p2"] * 6}
    write_table(folder / layout.CURVES, label | {"time_s": time_s, "depth_mm": 0.1 * ramp, **force})
    found = {"depth_mm": [0.1, 0.2], "fz_N": [0.5, 1.0], "depth_std_mm": [1e-3, 1e-3], "time_s": [0.2, 0.7]}
    write_table(folder / layout.POINTS, press | found | {"accepted": ["true", "true"], "reason": ["", ""]})


def film(folder: Path) -> None:
    """A recording of a video alone."""
    write_toml(
        folder / layout.SETTINGS,
        {
            "format": layout.FORMAT,
            "sensor": {"kind": "custom", "mm_per_px": 0.06, "width_px": 32, "height_px": 24},
        },
    )
    code = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(folder / "frames.avi"), code, 10, (32, 24))
    for k in range(3):
        writer.write(np.full((24, 32, 3), (60 * k, 100, 200), np.uint8))
    writer.release()


def reference() -> Reference:
    """The untouched gel of `pixels`."""
    rgb = pixels().astype(np.float32)
    return Reference(rgb, (1.0, 1.0, 1.0), np.ones((HEIGHT, WIDTH), bool), None)


def method(folder: Path) -> None:
    """A polynomial of the smallest reference."""
    law = Polynomial(np.zeros((2, len(PRODUCTS), len(POWERS))), 1.0)
    card = MethodCard(method="polynomial", balls=3, sensor="gelslim3", held_out_gain_std=0.01)
    save_method(CalibratedMethod(law, reference(), 0.02, None, card), folder / "method.npz")


def profile(folder: Path) -> None:
    """A sensor profile of the smallest method, and its statements by themselves."""
    method(folder)
    made = Profile(
        Sensor("gelslim3", WIDTH, HEIGHT, (0.06, 0.06), Gel(3.0), serial="07"),
        load_method(folder / "method.npz"),
        pixels(),
        (WIDTH, HEIGHT),
        "2026-11-21",
        "nothing",
        "seed",
        face_law=DepthScale((1.0, 0.1), (0.1, 0.5), 0.01),
        indenters={"A": Indenter("A", radius_mm=2.5)},
    )
    write_profile(made, folder / "sensor.tvs")
    (folder / "profile.json").write_bytes(read_archive(folder / "sensor.tvs")["profile.json"])


def network(folder: Path) -> None:
    """The smallest network that is shipped."""
    for suffix in (".onnx", ".json"):
        shutil.copy(_MODELS / f"gelslim3{suffix}", folder / f"network{suffix}")


def calibration(folder: Path) -> None:
    """The keys of calibration.json that the force step looks at."""
    modulus = {"value": 0.19, "std": 0.003, "interval95": [0.18, 0.2], "unit": "MPa"}
    poisson = {"value": 0.476, "std": 0.003, "interval95": [0.47, 0.482], "unit": "1"}
    names = ["youngs_modulus_MPa", "poisson_ratio"]
    about = {
        names[0]: modulus,
        names[1]: poisson,
        "covariance": {"of": names, "matrix": [[9e-6, 1e-6], [1e-6, 9e-6]]},
        "clock_offset_s": {"value": 0.1, "std": 0.001},
        "gel": {"thickness_mm": 3.0},
    }
    (folder / "calibration.json").write_text(json.dumps(about))


def history(folder: Path) -> None:
    """Two steps, one of them undone."""
    steps = (Step("viscoelasticity", "", 0.1, 0.05, 0.1, 0.06, 0.01), Step("mine", "mine.py"))
    History(("a", "b"), steps[:1], steps[1:]).save(folder / "history.json")


def depth(folder: Path) -> None:
    """A height map as TIFF and as NPZ."""
    values = np.linspace(0, 1, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    height = HeightMap(values, values > 0.1, (0.06, 0.06), flags=("at_border",))
    write_tiff(folder / "depth.tiff", height)
    write_npz(folder / "map.npz", height)


def journal(folder: Path) -> None:
    """Two rows of `depth`, of which the first has a map."""
    (folder / "depth").mkdir(exist_ok=True)
    (folder / "depth/a.tiff").touch()
    rows = [FrameResult("a.png", "ok", 0.3, 2.0, 5.0, 0.01, ("at_border",)), FrameResult("b.png", "unreadable: x")]
    Journal(folder / "journal", FINGERPRINT).begin(rows)
