"""Balls and steps under one rig: reference pictures, frames of flat punches, and the height maps they show."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rendered.camera import RenderedCamera
from benchmarks.rendered.families import Rig, field_mm, stream
from tactilevision.files.writing import replacing
from tactilevision.recording import layout
from tactilevision.recording.model import BallPress as BallRecord, Recording
from tactilevision.recording.write import write_image, write_recording
from tactilevision.records.rig import Gel, Sensor
from tactilevision.synthetic import simulation as writing
from tactilevision.synthetic.gel import BallPress, Flat, Singles, Surface
from tactilevision.synthetic.options import GelOptions
from tactilevision.synthetic.punch import PunchPress, punch_profile
from tactilevision.synthetic.simulation import plan_balls

TRUTH = "truth"
_AVERAGED = 16  # frames in one reference picture
_DEPTHS_MM = (0.15, 0.3, 0.45, 0.6)
_RADII_MM = (2.5, 4.0)
_BALL_RADII_MM = (2.0, 4.0)
_RATE_HZ = 10.0

Progress = Callable[[object], None]


def draw_gel(rig: Rig) -> GelOptions:
    """The rig's gel; nu over the whole range that gels have, for both families."""
    rng = stream(rig.family, rig.seed, 1)
    return GelOptions(
        youngs_modulus_MPa=round(float(rng.uniform(0.12, 0.4)), 4),
        poisson_ratio=round(float(rng.uniform(0.40, 0.4999)), 4),
        friction=round(float(rng.uniform(0.2, 0.7)), 3),
        thickness_mm=round(float(rng.uniform(2.6, 3.4)), 2),
        prior_std=None,
    )


def write_set(
    folder: Path,
    camera: RenderedCamera,
    *,
    balls: int = 24,
    steps: int = 8,
    flats: int = 3,
    progress: Progress = print,
) -> None:
    """A recording without forces: `flats` and `balls` as its reference, `steps` as its frames, truth beside it."""
    rig, gel = camera.rig, draw_gel(camera.rig)
    rng = stream(rig.family, rig.seed, 2)
    presses = plan_balls(balls, _BALL_RADII_MM, half_mm=field_mm(rig), gel=gel, rng=rng)
    places = (folder / layout.BALLS / f"{i:02d}.png" for i in range(len(presses)))
    records = tuple(BallRecord(path, ball.radius_mm) for path, ball in zip(places, presses, strict=True))
    noise = stream(rig.family, rig.seed, 3)
    stills: list[tuple[Path, Surface]] = [(folder / layout.FLATS / f"{i:02d}.png", Flat()) for i in range(flats)]
    stills += zip((record.path for record in records), presses, strict=True)
    for path, surface in stills:
        write_image(path, camera.expose(camera.ideal(surface), noise, averaged=_AVERAGED))
        progress(str(path))
    for i, ball in enumerate(presses):
        write_truth(folder / TRUTH / f"ball_{i:02d}.npz", ball.depth_mm(camera.grid))
    punches = plan_steps(rig, gel, steps)
    shown: list[Surface] = [Flat(), *punches] if punches else []
    for i, surface in enumerate(shown):
        write_image(folder / layout.FRAMES / f"{i:05d}.png", camera.picture(surface, noise))
        write_truth(folder / TRUTH / f"frame_{i:05d}.npz", surface.depth_mm(camera.grid))
        progress(f"{folder / layout.FRAMES}/{i:05d}.png")
    truth = {
        "ball": [_ball(one) for one in presses],
        "step": [_step(one) for one in punches],
    }
    writing.write_toml(folder / "truth.toml", {**truth_of(camera), **truth})
    write_recording(
        Recording(
            path=folder,
            name=f"rendered-{rig.family}-{rig.seed}",
            date=datetime.date(2026, 11, 23),
            sensor=sensor_of(rig, gel),
            frame_names=tuple(f"{i:05d}.png" for i in range(len(shown))),
            frame_times_s=np.arange(len(shown)) / _RATE_HZ,
            balls=records,
        )
    )


def plan_steps(rig: Rig, gel: GelOptions, count: int) -> list[PunchPress]:
    """Flat punches, level, anywhere that leaves 2 mm to the border."""
    rng = stream(rig.family, rig.seed, 4)
    steps = []
    for i in range(count):
        radius = _RADII_MM[i // len(_DEPTHS_MM) % len(_RADII_MM)]
        profile = punch_profile(gel.poisson_ratio, radius, gel.thickness_mm, friction=gel.friction)
        x, y = rng.uniform(-1.0, 1.0, 2) * (np.array(field_mm(rig)) - radius - 2.0)
        steps.append(PunchPress(profile, _DEPTHS_MM[i % len(_DEPTHS_MM)], (float(x), float(y))))
    return steps


def sensor_of(rig: Rig, gel: GelOptions) -> Sensor:
    """What the recording says of its sensor."""
    return Sensor(
        kind="custom",
        width_px=rig.width_px,
        height_px=rig.height_px,
        mm_per_px=(rig.mm_per_px, rig.mm_per_px),
        gel=Gel(thickness_mm=gel.thickness_mm, shape="disc", radius_mm=gel.radius_mm),
        serial="rendered",
    )


def truth_of(camera: RenderedCamera) -> dict[str, Any]:
    """Everything that was drawn."""
    gel = asdict(draw_gel(camera.rig))
    return {
        "rig": asdict(camera.rig),
        "gel": {key: value for key, value in gel.items() if value is not None},
        "transport": camera.tracer.transport,
        "samples": camera.tracer.samples,
    }


def write_truth(path: Path, depth_mm: Singles) -> None:
    """A height map as float16, in steps of a quarter of a micron where it could tell finer ones apart."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, depth_mm=(np.round(4e3 * depth_mm) / 4e3).astype(np.float16))


def _ball(ball: BallPress) -> dict[str, Any]:
    place = list(ball.centre_mm)
    return {"radius_mm": ball.radius_mm, "contact_radius_mm": ball.contact_radius_mm, "centre_mm": place}


def _step(step: PunchPress) -> dict[str, Any]:
    return {"radius_mm": step.profile.punch_radius_mm, "face_mm": step.face_mm, "centre_mm": list(step.centre_mm)}
