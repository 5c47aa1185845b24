"""Cast shadows of the simulator beside Mitsuba's: the same strips, diffuse ink, direct light alone.

Both pass the same colours and response. Counted are the values (pixel and channel) that shadows darken by more
than five grey levels in Mitsuba's picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.rendered.camera import RenderedCamera, build_camera
from benchmarks.rendered.families import Rig, draw_rig
from benchmarks.rendered.sets import draw_gel, plan_steps
from tactilevision.records import Bools, Bytes, Floats
from tactilevision.synthetic.ball import BallPress
from tactilevision.synthetic.camera import Camera
from tactilevision.synthetic.gel import Flat, Grid, Singles, Surface
from tactilevision.synthetic.lights import Finish, Triple
from tactilevision.synthetic.strips import Strip

DARKER = 5  # grey levels by which a shadow must darken a value for it to count
_SAMPLES = 64
_ONE_EACH: tuple[Triple, Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Agreement:
    """Grey levels rms where shadows darken, there by the simulator without shadows, and over the picture."""

    name: str
    count: int
    rms: float
    rms_without: float
    rms_all: float


def simulated_lamps(lamps: tuple[Strip, ...], grid: Grid, surface: Surface, *, shadows: bool) -> Singles:
    """Light (H, W, 3) of each of three strips by the simulator, on diffuse ink; 1 at its brightest level place."""
    strips = tuple(replace(lamp, brightness=1.0, colour=one) for lamp, one in zip(lamps, _ONE_EACH, strict=True))
    level = np.ones((grid.y_mm.size, grid.x_mm.size), np.float32)
    camera = Camera(
        grid,
        strips,
        Finish(gloss=0.0, soft_edge=0.0),
        ink=level,
        stray=np.zeros((*level.shape, 3), np.float32),
        vignette=level,
        to_raw=None,
        blur_px=0.0,
        gamma=1.0,
        full_well=1e4,
        read_noise=0.0,
        drift=(np.zeros(3), 1.0),
        shadow_strip_mm=(0.0, 0.0) if shadows else None,
    )
    return camera.ideal(surface)


def compare(family: str, seed: int, cache: Path) -> Iterator[Agreement]:
    """Steps and a ball under one rig."""
    drawn = draw_rig(family, seed)  # type: ignore[arg-type]
    rig = replace(drawn, ink=replace(drawn.ink, kind="diffuse"))
    traced, unshadowed = (
        build_camera(rig, cache, transport=transport, samples=_SAMPLES) for transport in ("direct", "unshadowed")
    )
    scale = _scale(traced)
    for name, surface in _surfaces(rig):
        shown, lit = (_greys(camera, camera.tracer.lamps(surface)) for camera in (traced, unshadowed))
        simulated, plain = (
            _greys(traced, scale * simulated_lamps(rig.lamps, traced.grid, surface, shadows=shadows))
            for shadows in (True, False)
        )
        dark = darkened(shown, lit)
        yield Agreement(name, int(dark.sum()), _rms(simulated, shown, dark), _rms(plain, shown, dark),
                        _rms(simulated, shown, np.ones_like(dark)))  # fmt: skip


def darkened(shadowed: Bytes, lit: Bytes) -> Bools:
    """Values (H, W, 3) that shadows darken by more than DARKER grey levels."""
    return np.asarray(lit.astype(int) - shadowed > DARKER)


def report(seeds: range, cache: Path) -> None:
    """Print a line for each surface of each rig of the family `train`."""
    print("rig        surface          values   rms there   without shadows   whole picture")
    for seed in seeds:
        for one in compare("train", seed, cache):
            print(f"train {seed:3d}  {one.name:14s} {one.count:8d} {one.rms:10.2f} {one.rms_without:14.1f} "
                  f"{one.rms_all:15.2f}", flush=True)  # fmt: skip


def _surfaces(rig: Rig) -> Iterator[tuple[str, Surface]]:
    gel = draw_gel(rig)
    for step in plan_steps(rig, gel, 4)[1:]:
        yield f"step {step.face_mm:.2f} mm", step
    yield "ball 4 mm", BallPress(4.0, 2.2, gel.thickness_mm, gel.poisson_ratio, (1.5, -2.0))


def _scale(camera: RenderedCamera) -> Floats:
    """What makes the simulator's lamps (3,) as bright as the tracer's, from the free gel."""
    simulated = simulated_lamps(camera.rig.lamps, camera.grid, Flat(), shadows=False)
    return np.asarray(np.median(camera.tracer.lamps(Flat()) / simulated, axis=(0, 1)))


def _greys(camera: RenderedCamera, lamps: Singles | Floats) -> Bytes:
    return camera.expose(camera.coloured(np.asarray(lamps, dtype=np.float32)), None)


def _rms(one: Bytes, other: Bytes, where: Bools) -> float:
    return float(np.sqrt(np.mean(np.square(one.astype(float) - other)[where]))) if where.any() else 0.0
