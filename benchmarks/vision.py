"""Height maps: accuracy on planted surfaces and speed, beside a straightforward network and float64 transforms.

python -m benchmarks.vision
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from tactilevision.heightmap.build import tuned
from tactilevision.heightmap.poisson import integrate
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import make_reference
from tactilevision.records.maps import Frame
from tactilevision.records.measured import Bytes
from tactilevision.records.rig import Gel
from tactilevision.sensors import get_sensor
from tactilevision.synthetic.camera import Camera, CameraOptions, build_camera
from tactilevision.synthetic.gel import BallPress, Flat
from tactilevision.synthetic.options import GelOptions
from tactilevision.synthetic.punch import PunchPress, punch_profile
from tactilevision.synthetic.simulation import picture_still, plan_balls

SIZES = ((320, 240), (427, 320), (640, 480))
WIDTH_MM = 27.1
QUALITY = 95  # of JPEGs, as cameras write them


class JpegCamera(Camera):
    """A camera whose every frame comes as a JPEG of QUALITY, those of the untouched gel, too."""

    def expose(self, light: Any, rng: np.random.Generator | None, *, averaged: int = 1) -> Bytes:
        """A frame (H, W, 3) of the given light, packed and unpacked again."""
        rgb = super().expose(light, rng, averaged=averaged)
        data = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
        return np.ascontiguousarray(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1])


def calibrated(
    size: tuple[int, int], light: int | None, method: str, *, jpeg: bool = False
) -> tuple[Camera, Reconstructor]:
    """A camera of that size and light, and the reconstructor that 14 of its balls give."""
    scale = WIDTH_MM / size[0]
    options = CameraOptions(
        width_px=size[0], height_px=size[1], mm_per_px=(scale, scale), distortion_px=0.0, light_seed=light
    )
    rng = np.random.default_rng(0)
    camera = build_camera(options, rng)
    if jpeg:
        camera = JpegCamera(**{one.name: getattr(camera, one.name) for one in dataclasses.fields(camera)})
    reference = make_reference([picture_still(camera, Flat(), rng=rng) for _ in range(3)])
    half = (size[0] * scale / 2, size[1] * scale / 2)
    presses = plan_balls(14, (4.0,), half_mm=half, gel=GelOptions(), rng=rng)
    shots = [BallPicture(picture_still(camera, press, rng=rng), press.radius_mm) for press in presses]
    found = calibrate_from_balls(reference, shots, mm_per_px=(scale, scale), fit=PHOTOMETRIC[method])
    sensor = get_sensor("custom", width_px=size[0], height_px=size[1], mm_per_px=scale)
    sensor = dataclasses.replace(sensor, gel=Gel(thickness_mm=3.0))
    free = [camera.picture(Flat(), rng) for _ in range(12)]
    return camera, tuned(sensor, found, pictures=shots, free=free)


def accuracy(light: int | None) -> None:
    camera, reconstructor = calibrated((427, 320), light, "polynomial")
    calibration = reconstructor.calibration
    assert calibration is not None
    rng = np.random.default_rng(1)
    x, y = camera.grid.places((1.0, -0.7))
    r = np.hypot(x, y)
    print(f"light {light}: held-out direction {calibration.direction_error_deg:.1f} deg")
    for radius, contact_px in ((4.0, 12), (4.0, 25), (8.0, 40), (16.0, 60), (20.0, 90)):
        contact = contact_px * camera.grid.spacing_mm[0]
        press = BallPress(radius, contact, 3.0, 0.48, (1.0, -0.7))
        found = reconstructor.height_map(Frame(camera.picture(press, rng)))
        true, inside = press.depth_mm(camera.grid), r < contact
        off = 1e3 * np.sqrt(np.mean((found.depth_mm - true)[inside] ** 2))
        top = found.depth_mm[r < 0.15].mean() / true[r < 0.15].mean()
        print(f"  ball, contact {contact_px:2d} px: peak {top:.3f} of true, inside rms {off:.1f} um")
    for depth in (0.15, 0.3, 0.4, 0.6):
        punch = PunchPress(punch_profile(0.48, 2.5, 3.0), depth, (1.0, -0.7))
        found = reconstructor.height_map(Frame(camera.picture(punch, rng)))
        error = 1e3 * (found.depth_mm - punch.depth_mm(camera.grid))
        rise = " ".join(f"{error[np.abs(r - at) < 0.15].mean():+.1f}" for at in (3.5, 4, 5, 6, 8))
        assert found.std_mm is not None
        face, std = found.depth_mm[r < 2.2].mean() / depth, 1e3 * found.std_mm[r < 2.2].mean()
        plain = plain_depth(reconstructor, camera.picture(punch, np.random.default_rng(1)))
        missed = plain[r < 2.2].mean() - plain[r > 8.0].mean()
        print(
            f"  punch {depth} mm: face {face:.3f} of true (std {std:.0f} um; plain {missed / depth:.3f}), "
            f"rise off {rise} um at 3.5 4 5 6 8 mm"
        )


def plain_depth(reconstructor: Reconstructor, rgb: Bytes) -> npt.NDArray[np.floating[Any]]:
    """The surface of the slopes as they are read, walls and all."""
    slopes = reconstructor.method.slopes(rgb)
    return integrate(dataclasses.replace(slopes, valid=None), reconstructor.sensor.mm_per_px)


def honesty(light: int | None) -> None:
    """Share of pixels within one stated deviation, on balls and steps that the calibration never saw."""
    camera, reconstructor = calibrated((427, 320), light, "polynomial")
    shares: dict[str, list[float]] = {}
    for number, centre in enumerate(((1.0, -0.7), (-4.0, 2.0), (5.0, 3.0))):
        balls = [BallPress(*size, 3.0, 0.48, centre) for size in ((4.0, 0.8), (4.0, 1.6), (8.0, 2.5), (16.0, 4.0))]
        steps = [PunchPress(punch_profile(0.48, 2.5, 3.0), depth, centre) for depth in (0.1, 0.3, 0.6)]
        surfaces: list[BallPress | PunchPress] = [*balls, *steps]
        for surface in surfaces:
            found = reconstructor.height_map(Frame(camera.picture(surface, np.random.default_rng(number))))
            assert found.std_mm is not None
            edge = surface.contact_radius_mm if isinstance(surface, BallPress) else 2.5
            r = np.hypot(*camera.grid.places(centre))
            covered = np.abs(found.depth_mm - surface.depth_mm(camera.grid)) < found.std_mm
            kind = "ball" if isinstance(surface, BallPress) else "step"
            for where, mask in (("under", r < 0.9 * edge), ("beside", (r > 1.15 * edge) & (r < edge + 4))):
                shares.setdefault(f"{where} a {kind}", []).append(float(covered[mask & found.valid].mean()))
    print(
        f"light {light}: within one stated deviation "
        + ", ".join(f"{100 * np.mean(share):.0f} % {where}" for where, share in shares.items())
    )


def speed(size: tuple[int, int], methods: Iterable[str] = PHOTOMETRIC) -> None:
    """Whole frames to height maps with their deviations: free gel, a press without and with a wall to restore."""
    usual, floor = milliseconds(straightforward(size), 9), milliseconds(least(size), 40)
    profile, rng = punch_profile(0.48, 2.5, 3.0), np.random.default_rng(2)
    for method in methods:
        camera, reconstructor = calibrated(size, 2, method)
        spent = []
        surfaces: list[Flat | PunchPress] = [Flat()]
        surfaces += [PunchPress(profile, depth, (1.0, -0.7)) for depth in (0.1, 0.4)]
        for surface in surfaces:
            frame = Frame(camera.picture(surface, rng))
            spent.append(milliseconds(lambda r=reconstructor, f=frame: r.height_map(f), 60))  # type: ignore[misc]
        times = " ".join(f"{one:.2f}" for one in spent)
        parts = " ".join(f"{usual / one:.1f}" for one in spent)
        print(
            f"{size[0]}x{size[1]} {method}: free gel, press of .1 mm, press of .4 mm with its wall {times} ms; "
            f"network and float64 transforms {usual:.1f} ms, {parts} times as long; "
            f"one pass and one transform pair {floor:.2f} ms"
        )


def least(size: tuple[int, int]) -> Callable[[], object]:
    """One pass over the picture and one pair of float32 cosine transforms of it."""
    picture = np.random.default_rng(0).random(size[::-1], np.float32)

    def run() -> object:
        return fft.idctn(fft.dctn(picture * picture, norm="ortho"), norm="ortho", overwrite_x=True)

    return run


def straightforward(size: tuple[int, int]) -> Callable[[], object]:
    """A 5-32-32-32-2 network in torch on the whole frame, then a float64 cosine transform pair."""
    import torch

    torch.set_num_threads(1)
    layers = [torch.nn.Linear(a, b) for a, b in ((5, 32), (32, 32), (32, 32), (32, 2))]
    network = torch.nn.Sequential(*[m for layer in layers for m in (layer, torch.nn.ReLU())][:-1])
    pixels = torch.rand(size[0] * size[1], 5)
    picture: Bytes = np.zeros((size[1], size[0], 3), np.uint8)

    def run() -> object:
        with torch.no_grad():
            network(pixels)
        return fft.idctn(fft.dctn(picture[..., 0].astype(np.float64), norm="ortho"), norm="ortho")

    return run


def milliseconds(work: Callable[[], object], times: int) -> float:
    """The processor's time for one run, on one core, that a tenth of the runs stay under: others slow the rest."""
    work()
    spent = []
    for _ in range(times):
        began = time.thread_time()
        work()
        spent.append(time.thread_time() - began)
    return 1e3 * float(np.percentile(spent, 10))


def main() -> None:
    import cv2

    cv2.setNumThreads(1)
    for light in (None, 1, 2):
        accuracy(light)
        honesty(light)
    for size in SIZES:
        speed(size)


def quick() -> None:
    accuracy(None)
    speed(SIZES[0], ["polynomial"])


if __name__ == "__main__":
    main()
