"""Height maps beside a public library's, on the same real pictures in the same process.

    python -m benchmarks.peers [SET...]

The library is gs_sdk (github.com/joehjhuang/gs_sdk, GPL 3): its own network, features, reconstruction and
integration, imported from where it is installed. A third of a set's balls at a time is left out of both
calibrations and read by both. gs_sdk takes circles that people click; it is given those that our calibration found
with all balls, and these are the truth for both; of set E also those that its makers clicked. Its network is
trained as its `train_model` trains (loss, optimiser, schedule, share of background), from one tensor instead of
file by file.
"""

from __future__ import annotations

import csv
import dataclasses
import importlib
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.own_contacts import FOLDS
from benchmarks.real_frames import MINI, OBJECTS, REAL, ROOT, SETS, objects_of, real_balls
from benchmarks.vision import milliseconds
from tactilevision.errors import InputError, RecordingError
from tactilevision.heightmap.ball_validation import dent_mm
from tactilevision.heightmap.build import build_reconstructor, tuned
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_detection import Ball, ball_slopes
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.ball_samples import INSIDE, far_from, from_axis
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls, direction_error_deg
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import Reference
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes, Floats, Pair
from tactilevision.sensors import get_sensor
from tactilevision.sensors.rectification import rectify

ABSENT = (
    "gs_sdk is not there: clone github.com/joehjhuang/gs_sdk and name its folder in PYTHONPATH behind this one "
    "(PyPI's gs-sdk is another thing)"
)
EPOCHS, BATCH, RATE, HALVED_EVERY = 200, 1024, 0.002, 10  # as gs_sdk's train_model has them
LESS_PX = 4.0  # px off a labelled radius, as gs_sdk's prepare_data takes them
CLICKED = "E_clicked"  # set E by the circles of its makers
FREE_OBJECTS = (0, 3)  # of the pictures of objects in B: nothing touches the gel there
FRAMES = {"free gel": 0.0, "gentle press": 0.05, "deep press": 9.0}  # of the sample, nearest to this depth in mm
TIMES = 60  # runs of a frame that is timed, of each library in turns
Map = npt.NDArray[np.floating[Any]]


@dataclasses.dataclass(frozen=True, slots=True)
class Reading:
    """What one library makes of a picture: slopes (H, W) each, dz/dx and dz/dy, and depth (H, W) mm."""

    dz_dx: Map
    dz_dy: Map
    depth_mm: Map


def main(names: Sequence[str] = ()) -> None:
    cv2.setNumThreads(1)
    try:
        peer = importlib.import_module("gs_sdk.gs_reconstruct")
    except ImportError:
        print(ABSENT)
        return
    import torch

    torch.set_num_threads(1)
    speed(peer)
    if not REAL.is_dir():
        print("the real frames are not at hand")
        return
    for name in names or [*SETS, CLICKED]:
        reference, pictures, scale = real_balls("E" if name == CLICKED else name)
        if name == CLICKED:
            pictures, balls = clicked(pictures)
        else:
            balls = calibrated(reference, pictures, scale).balls
        compare(peer, name, reference, pictures, scale, balls)


def clicked(pictures: Sequence[BallPicture]) -> tuple[list[BallPicture], tuple[Ball | None, ...]]:
    """The pictures of set E with the circles that its makers clicked, and these circles."""
    with (REAL / MINI / "labels.csv").open(encoding="utf-8") as table:
        rows = {
            row["img"]: [float(row[key]) for key in ("cx", "cy", "radius_px")] for row in csv.DictReader(table)
        }
    labelled, balls = [], list[Ball | None]()
    for one in pictures:
        x, y, radius_px = rows[one.name]
        labelled.append(dataclasses.replace(one, centre_px=(x, y), contact_radius_px=radius_px))
        balls.append(Ball((x, y), radius_px, one.radius_mm))
    return labelled, tuple(balls)


def compare(
    peer: Any,
    name: str,
    reference: Reference,
    pictures: Sequence[BallPicture],
    mm_per_px: Pair,
    balls: Sequence[Ball | None],
) -> None:
    """Print what both libraries make of balls that they never saw, held against the circles of `balls`."""
    kept = [(picture, ball) for picture, ball in zip(pictures, balls, strict=True) if ball is not None]
    objects = objects_of(name) if name in OBJECTS else []
    free = [objects[number] for number in FREE_OBJECTS] if name == "B" else []
    rows: dict[str, list[tuple[Floats, float, float]]] = {"tactilevision": [], "gs_sdk": []}
    flat: dict[str, list[float]] = {"tactilevision": [], "gs_sdk": []}
    for fold in range(FOLDS):
        others = [pair for number, pair in enumerate(kept) if number % FOLDS != fold]
        readers = {
            "tactilevision": own_reader(reference, [picture for picture, _ in others], mm_per_px),
            "gs_sdk": peer_reader(peer, reference, others, mm_per_px),
        }
        for picture, ball in kept[fold::FOLDS]:
            for library, read in readers.items():
                rows[library].append(judged(read(picture.rgb), ball, mm_per_px))
        for library, read in readers.items():
            flat[library] += [flatness(read(rgb).depth_mm, np.True_) for rgb in free]
    for library, found in rows.items():
        off, ratio = np.concatenate([one for one, _, _ in found]), np.array([one for _, one, _ in found])
        waves = 1e3 * np.array([one for _, _, one in found])
        print(
            f"{name} {library}: {len(found)} balls, direction {np.median(off):.2f} degrees, "
            f"dent {np.median(ratio):.3f} +- {np.std(ratio):.3f} of the true one, "
            f"gel away from the ball {np.median(waves):.0f} um"
            + (f", free frames {1e3 * np.median(flat[library]):.0f} um" if free else "")
        )
    times = timed({library: lambda r=read: r(kept[0][0].rgb) for library, read in readers.items()})
    print(f"{name} a frame: " + ", ".join(f"{library} {one:.1f} ms" for library, one in times.items()))


def judged(found: Reading, ball: Ball, mm_per_px: Pair) -> tuple[Floats, float, float]:
    """Direction's error (N,) in degrees under a ball, its dent over the true one, rms in mm far from it."""
    x, y, distance = from_axis(found.depth_mm.shape, ball, mm_per_px)
    contact_mm = ball.contact_radius_px * mm_per_px[0]
    inside = distance < INSIDE * contact_mm
    true = ball_slopes(x[inside], y[inside], contact_mm=contact_mm, radius_mm=ball.radius_mm)
    slopes = np.stack([found.dz_dx[inside], found.dz_dy[inside]], axis=1)
    dent, of = dent_mm(found.depth_mm, ball, mm_per_px=mm_per_px)
    away = far_from(ball, found.depth_mm.shape, mm_per_px=mm_per_px)
    return (
        direction_error_deg(slopes.astype(np.float64), np.stack(true, axis=1)),
        dent / of,
        flatness(found.depth_mm, away),
    )


def flatness(depth_mm: Map, where: Any) -> float:
    """Rms in mm of depth (H, W) about its median, `where` (H, W) nothing touches."""
    free = depth_mm[np.broadcast_to(where, depth_mm.shape)]
    return float(np.sqrt(np.mean(np.square(free - np.median(free)))))


def calibrated(reference: Reference, pictures: Sequence[BallPicture], mm_per_px: Pair) -> Calibration:
    return calibrate_from_balls(reference, pictures, mm_per_px=mm_per_px, fit=PHOTOMETRIC["auto"])


def own_reader(reference: Reference, pictures: Sequence[BallPicture], mm_per_px: Pair) -> Any:
    """Reads a picture (H, W, 3) by a calibration on these balls, whose circles it finds itself."""
    height, width = reference.shape
    sensor = get_sensor("custom", width_px=width, height_px=height, mm_per_px=mm_per_px[0])
    reader = tuned(sensor, calibrated(reference, pictures, mm_per_px), pictures=pictures, free=[])

    def read(rgb: Bytes) -> Reading:
        height, slopes = reader.rectified_map(rgb), reader.method.slopes(rgb)
        return Reading(slopes.dz_dx, slopes.dz_dy, height.depth_mm)

    return read


def peer_reader(
    peer: Any, reference: Reference, balls: Sequence[tuple[BallPicture, Ball]], mm_per_px: Pair
) -> Any:
    """Reads a picture (H, W, 3) by gs_sdk, trained on these balls; its heights are in px, up from the gel."""
    free = np.ascontiguousarray(np.rint(reference.rgb).astype(np.uint8)[..., ::-1])
    made = peer_on(peer, trained(peer, free, balls, mm_per_px), free)

    def read(rgb: Bytes) -> Reading:
        slopes, height, _ = made.get_surface_info(np.ascontiguousarray(rgb[..., ::-1]), mm_per_px[0])
        return Reading(-slopes[..., 0], -slopes[..., 1], -mm_per_px[0] * height)

    return read


def peer_on(peer: Any, network: Any, free_bgr: Bytes) -> Any:
    """gs_sdk's reconstructor of a network, which it reads from a file."""
    import torch

    with tempfile.TemporaryDirectory() as folder:
        torch.save(network.state_dict(), path := str(Path(folder) / "nnmodel.pth"))
        made = peer.Reconstructor(path)
    made.load_bg(free_bgr)
    return made


def trained(
    peer: Any, free_bgr: Bytes, balls: Sequence[tuple[BallPicture, Ball]], mm_per_px: Pair, *, epochs: int = EPOCHS
) -> Any:
    """gs_sdk's network, trained on balls and on a fifth as much of the untouched gel, as its own scripts do."""
    import torch

    features, angles = [], []
    for picture, ball in balls:
        x, y, distance = from_axis(free_bgr.shape[:2], ball, (1.0, 1.0))
        inside = distance < ball.contact_radius_px - LESS_PX
        upright = np.sqrt((ball.radius_mm / mm_per_px[0]) ** 2 - x[inside] ** 2 - y[inside] ** 2)
        angles.append(np.stack([np.arctan2(side[inside], upright) for side in (x, y)], axis=1))
        features.append(peer.image2bgrxys(np.ascontiguousarray(picture.rgb[..., ::-1]))[inside])
    rng = np.random.default_rng(0)
    still = peer.image2bgrxys(free_bgr).reshape(-1, 5)
    still = still[rng.permutation(len(still))[: sum(map(len, features)) // 5]]
    known = torch.from_numpy(np.concatenate([*features, still]).astype(np.float32))
    true = torch.from_numpy(np.concatenate([*angles, np.zeros((len(still), 2))]).astype(np.float32))
    torch.manual_seed(0)
    network = peer.BGRXYMLPNet()
    optimiser = torch.optim.Adam(network.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.StepLR(optimiser, step_size=HALVED_EVERY, gamma=0.5)
    for _ in range(epochs):
        order = torch.randperm(len(known))
        for start in range(0, len(known), BATCH):
            batch = order[start : start + BATCH]
            optimiser.zero_grad()
            loss: Any = torch.nn.functional.l1_loss(network(known[batch]), true[batch])
            loss.backward()
            optimiser.step()
        schedule.step()
    return network.eval()


def speed(peer: Any) -> None:
    """Raw frames of the sample to height maps by both, in turns; how long a network takes rests on no training."""
    from tactilevision.recording.pictures import read_frame
    from tactilevision.recording.read import read_recording

    recording = read_recording(ROOT / "sample_frames" / "gelslim3")
    reader = build_reconstructor(recording)
    assert reader.referenced is not None
    free = np.ascontiguousarray(np.rint(reader.referenced.reference.rgb).astype(np.uint8)[..., ::-1])
    made = peer_on(peer, peer.BGRXYMLPNet(), free)
    frames = list[Frame]()
    for number in range(len(recording.frame_names)):
        with suppress(InputError, RecordingError):  # some of the sample's frames are torn
            frames.append(read_frame(recording, number))
    depths = np.array([float(reader.height_map(frame).depth_mm.max()) for frame in frames])
    for name, depth_mm in FRAMES.items():
        at = int(np.argmin(np.abs(depths - depth_mm)))

        def theirs(frame: Frame = frames[at], reader: Reconstructor = reader) -> object:
            rgb = rectify(reader.sensor, frame.rgb)
            return made.get_surface_info(np.ascontiguousarray(rgb[..., ::-1]), reader.sensor.mm_per_px[0])

        times = timed({"tactilevision": lambda f=frames[at]: reader.height_map(f), "gs_sdk": theirs})
        ours, other = times.values()
        print(
            f"sample, {name} ({depths[at]:.2f} mm): tactilevision {ours:.2f} ms, gs_sdk {other:.1f} ms, "
            f"{other / ours:.1f} times as long"
        )


def timed(works: dict[str, Any]) -> dict[str, float]:
    """Processor's time in ms of each of the `works`, by name, in turns: the least of three tenth percentiles."""
    turns = [{name: milliseconds(work, TIMES // 3) for name, work in works.items()} for _ in range(3)]
    return {name: min(turn[name] for turn in turns) for name in works}


def quick() -> None:
    main(["D"])


if __name__ == "__main__":
    main(sys.argv[1:])
