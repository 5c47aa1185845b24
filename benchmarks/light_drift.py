"""Balls and flat steps while the light is five grey levels off: python -m benchmarks.light_drift [seeds]

Each seed is a light of its own, calibrated from 14 balls; then balls of 12 to 90 px in contact radius and a flat
punch are pressed in three places while all lamps are 7 % up, 7 % down or as they were. Printed for each light: the
peak over the true one by size, how many depths are within 15 um or 4 %, the direction of slope pixel by pixel and
after a mean over SMOOTH px, which leaves the camera's noise out, and which share of the depths lies within one
stated deviation of the truth. Beside the direction stands the least that any reading of single pixels can reach
under the camera's noise, the light known exactly (Cramer and Rao): with J the grey levels' answer to slope and S
their variance, slopes are known to (J' S^-1 J)^-1 at best. No setting of the library was chosen on these seeds.
"""

from __future__ import annotations

import dataclasses
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np

from tactilevision.photometric import PHOTOMETRIC, BallPicture, calibrate_from_balls, make_reference
from tactilevision.reconstruct import Reconstructor, tuned
from tactilevision.records import Bools, Bytes, Frame, Gel, Pair
from tactilevision.sensors import get_sensor
from tactilevision.synthetic.ball import BallPress
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import Area, Flat, Grid, Singles
from tactilevision.synthetic.optics import CameraOptions, build_camera
from tactilevision.synthetic.options import GelOptions
from tactilevision.synthetic.profile import punch_profile
from tactilevision.synthetic.punch import PunchPress
from tactilevision.synthetic.reference import picture_still, plan_balls

FIRST_SEED, SIZE, VIEW_MM, THICKNESS_MM, NU = 2101, (427, 320), 27.1, 3.0, 0.48
PLACES: tuple[Pair, ...] = ((1.0, -0.7), (-4.0, 2.0), (4.5, 3.0))
BALLS = ((4.0, 0.76), (4.0, 1.59), (8.0, 2.54), (16.0, 3.81), (20.0, 5.71))  # radius, contact radius in mm
LARGE_MM = 4.0  # of contact: in the middle of the picture only
FACE_MM, DEPTHS_MM = 2.5, (0.1, 0.3, 0.45)
GAINS = (1.0, 1.07, 0.93)
SMOOTH = 2.0
STEP = 0.01  # of slope, over which grey levels answer straight


def main(arguments: Sequence[str] = ()) -> None:
    within: dict[str, list[float]] = defaultdict(list)
    peaks: list[float] = []
    for seed in range(FIRST_SEED, FIRST_SEED + (int(arguments[0]) if arguments else 2)):
        scale = VIEW_MM / SIZE[0]
        options = CameraOptions(
            width_px=SIZE[0], height_px=SIZE[1], mm_per_px=(scale, scale), distortion_px=0.0, light_seed=seed
        )
        rng = np.random.default_rng(seed)
        camera = build_camera(options, rng)
        peaks += _one_light(seed, camera, _calibrated(camera, rng), rng=rng, within=within)
    off = np.array(peaks) - 1
    print(f"peaks: rms {100 * np.sqrt(np.mean(off**2)):.1f} %, within 2 %: {np.mean(np.abs(off) < 0.02):.0%}")
    print("within one deviation: " + ", ".join(f"{key} {np.mean(v):.0%}" for key, v in within.items()))


def _calibrated(camera: Camera, rng: np.random.Generator) -> Reconstructor:
    flats = [picture_still(camera, Flat(), rng) for _ in range(3)]
    scale = VIEW_MM / SIZE[0]
    half = (0.5 * VIEW_MM, 0.5 * SIZE[1] * scale)
    presses = plan_balls(14, (4.0,), half, GelOptions(), rng)
    shots = [BallPicture(picture_still(camera, press, rng), press.radius_mm) for press in presses]
    calibration = calibrate_from_balls(make_reference(flats), shots, (scale, scale), fit=PHOTOMETRIC["either"])
    sensor = get_sensor("custom", width_px=SIZE[0], height_px=SIZE[1], mm_per_px=scale)
    sensor = dataclasses.replace(sensor, gel=Gel(thickness_mm=THICKNESS_MM))
    return tuned(sensor, calibration, shots, [camera.picture(Flat(), rng) for _ in range(12)])


def _presses() -> Iterator[tuple[str, Pair, float, BallPress | PunchPress]]:
    """Kind, centre, contact radius in mm, and the press."""
    for centre in PLACES:
        for radius, contact in BALLS:
            if contact < LARGE_MM or centre == PLACES[0]:
                yield "balls", centre, contact, BallPress(radius, contact, THICKNESS_MM, NU, centre)
        for depth in DEPTHS_MM:
            profile = punch_profile(NU, FACE_MM, THICKNESS_MM)
            yield "steps", centre, FACE_MM, PunchPress(profile, depth, centre)


def _one_light(
    seed: int, camera: Camera, reader: Reconstructor, *, rng: np.random.Generator, within: dict[str, list[float]]
) -> list[float]:
    """Print what one light gives; the peaks of its balls over the true ones."""
    scale = VIEW_MM / SIZE[0]
    peaks: dict[int, list[float]] = defaultdict(list)
    faces: dict[float, list[float]] = defaultdict(list)
    turns, least, close = [], [], []
    for number, (kind, centre, contact, press) in enumerate(_presses()):
        light = np.float32(GAINS[number % len(GAINS)])
        rgb = camera.expose(camera.ideal(press) * light, rng)
        true = press.depth_mm(camera.grid)
        x, y = np.meshgrid(camera.grid.x_mm - centre[0], camera.grid.y_mm - centre[1])
        r = np.hypot(x, y)
        found = reader.height_map(Frame(rgb))
        assert found.std_mm is not None
        off, middle = np.abs(found.depth_mm - true), r < 0.15
        for where, part in (("under", r < 0.9 * contact), ("beside", (r > 1.15 * contact) & (r < contact + 4))):
            part = part & found.valid
            within[f"{where} {kind}"].append(float(np.mean(off[part] < found.std_mm[part])))
        if kind == "steps":
            face = r < 0.85 * contact
            deep = float(true[face].mean())
            faces[round(deep, 2)].append(float(found.depth_mm[face].mean()) / deep)
            continue
        peak = float(true[middle].mean())
        peaks[round(contact / scale)].append(float(found.depth_mm[middle].mean()) / peak)
        rms = float(np.sqrt(np.mean(off[r < contact] ** 2)))
        close.append(rms < max(0.015, 0.04 * peak))
        inside, slopes = (r < 0.93 * contact) & found.valid, list(np.gradient(true, scale))
        turns.append(_directions(reader, rgb, slopes, inside))
        if centre == PLACES[0]:
            least.append(_least_turn(camera, press, slopes, inside))
    raw, smooth = np.mean(turns, axis=0)
    turned = f"direction {raw:.1f} degrees a pixel ({np.mean(least):.1f} at least), {smooth:.1f} without noise"
    print(f"light {seed}: {turned}; depth good {np.mean(close):.0%}")
    for name, values in (("balls (px)", peaks), ("steps (mm)", faces)):
        print(f"  {name} " + "  ".join(f"{k}: " + " ".join(f"{v:.3f}" for v in row) for k, row in values.items()))
    return [value for row in peaks.values() for value in row]


def _directions(reader: Reconstructor, rgb: Bytes, true: Sequence[Any], inside: Bools) -> Pair:
    """Median angle between slopes found and `true` (dy, dx): of single pixels, and of means over SMOOTH px."""
    slopes = reader.slope_map(Frame(rgb))
    turn = []
    for spread in (0.0, SMOOTH):
        x, y = (cv2.GaussianBlur(s, (0, 0), spread) if spread else s for s in (slopes.dz_dx, slopes.dz_dy))
        angle = np.angle((x + 1j * y) * (true[1] - 1j * true[0]))
        turn.append(float(np.median(np.degrees(np.abs(angle[inside])))))
    return turn[0], turn[1]


@dataclasses.dataclass(frozen=True)
class _Tilted:
    """A press on a gel that slopes by `slope` all over."""

    press: BallPress | PunchPress
    slope: Pair

    @property
    def steep(self) -> tuple[Area, ...]:
        return self.press.steep

    def depth_mm(self, grid: Grid) -> Singles:
        x, y = grid.places()
        return np.asarray(self.press.depth_mm(grid) + self.slope[0] * x + self.slope[1] * y, np.float32)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        return self.press.shift_mm(grid)


def _least_turn(camera: Camera, press: BallPress | PunchPress, true: Sequence[Any], inside: Bools) -> float:
    """Median angle between true slopes (dy, dx) and the best reading of pixels that noise allows, degrees."""
    light = np.clip(camera.ideal(press), 1e-6, 1.0)
    answers = []
    for x, y in ((STEP, 0.0), (0.0, STEP)):
        more, less = (camera.ideal(_Tilted(press, (sign * x, sign * y))) for sign in (1, -1))
        answers.append((more - less)[inside] / (2 * STEP))
    light = light[inside]
    to_grey = 255 / camera.gamma * light ** (1 / camera.gamma - 1)
    read = camera.read_noise / 255 * camera.gamma * 0.5 ** (1 - 1 / camera.gamma)
    variance = to_grey**2 * (light / camera.full_well + read**2) + 1 / 12  # and rounding
    answer = np.stack(answers, axis=-1) * to_grey[..., None]
    known = np.linalg.inv(np.einsum("ncs,nc,nct->nst", answer, 1 / variance, answer) + 1e-9 * np.eye(2))
    drawn = np.random.default_rng(0).standard_normal((len(known), 2))
    off = np.einsum("nst,nt->ns", np.linalg.cholesky(known), drawn)
    slope = true[1][inside] + 1j * true[0][inside]
    turn = np.angle((slope + off[:, 0] + 1j * off[:, 1]) * slope.conj())
    return float(np.median(np.degrees(np.abs(turn))))


if __name__ == "__main__":
    main(sys.argv[1:])
