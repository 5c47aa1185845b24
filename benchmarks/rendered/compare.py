"""Cast shadows of the simulator beside Mitsuba's: the same strips, diffuse ink, direct light alone.

Both pass the same colours and response. Counted are the values (pixel and channel) that shadows darken by more
than five grey levels in Mitsuba's picture.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.rendered.camera import build_camera, mix
from benchmarks.rendered.families import Rig, draw_rig
from benchmarks.rendered.sets import draw_gel, plan_steps
from tactilevision.records.measured import Bools, Bytes, Floats
from tactilevision.synthetic.camera import Camera, CameraOptions
from tactilevision.synthetic.gel import Area, BallPress, Flat, Grid, Singles, Surface
from tactilevision.synthetic.lights import Finish, Strip, Triple
from tactilevision.synthetic.punch import PunchPress

DARKER = 5  # grey levels by which a shadow must darken a value for it to count
_SAMPLES = 64
_KEPT_MM = 5.5  # half the side of the square that is kept for the test
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
        drift=(np.zeros(3), 1.0),
        options=CameraOptions(blur_px=0.0, gamma=1.0, shadow_strip_mm=(0.0, 0.0) if shadows else None),
    )
    return camera.ideal(surface)


def compare(rig: Rig, cache: Path) -> Iterator[Agreement]:
    """Steps and a ball under one rig."""
    for name, pair in _pairs(rig, cache):
        simulated, plain = (pair.simulated(rig, shadows=shadows) for shadows in (True, False))
        dark = darkened(pair.shadowed, pair.lit)
        yield Agreement(
            name,
            int(dark.sum()),
            rms(simulated, pair.shadowed, dark),
            rms(plain, pair.shadowed, dark),
            rms(simulated, pair.shadowed, np.ones_like(dark)),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Pictured:
    """Mitsuba's pictures (H, W, 3) of a surface with shadows and without; `scale` (3,) is the simulator's."""

    surface: Surface
    shadowed: Bytes
    lit: Bytes
    scale: Floats

    def simulated(self, rig: Rig, *, shadows: bool) -> Bytes:
        """The simulator's picture (H, W, 3)."""
        camera = build_camera(rig, Path())
        lamps = simulated_lamps(rig.lamps, camera.grid, self.surface, shadows=shadows)
        return camera.expose(mix(lamps, rig, self.scale), None)


def diffuse_rig(seed: int) -> Rig:
    """A rig of the family `train` with diffuse ink."""
    rig = draw_rig("train", seed)
    return replace(rig, ink=replace(rig.ink, kind="diffuse"))


def _pairs(rig: Rig, cache: Path) -> Iterator[tuple[str, Pictured]]:
    traced, unshadowed = (
        build_camera(rig, cache, transport=transport, samples=_SAMPLES) for transport in ("direct", "unshadowed")
    )
    # what makes the simulator's lamps as bright as the tracer's, from the free gel
    bare = simulated_lamps(rig.lamps, traced.grid, Flat(), shadows=False)
    scale = traced.scale * np.median(traced.tracer.lamps(Flat()) / bare, axis=(0, 1))
    for name, surface in _surfaces(rig):
        shadowed, lit = (
            traced.expose(mix(camera.tracer.lamps(surface), rig, traced.scale), None)
            for camera in (traced, unshadowed)
        )
        yield name, Pictured(surface, shadowed, lit, scale)


def darkened(shadowed: Bytes, lit: Bytes) -> Bools:
    """Values (H, W, 3) that shadows darken by more than DARKER grey levels."""
    return np.asarray(lit.astype(int) - shadowed > DARKER)


def report(seeds: range, cache: Path) -> None:
    """Print a line for each surface of each rig of the family `train`."""
    print("rig        surface          values   rms there   without shadows   whole picture")
    for seed in seeds:
        for one in compare(diffuse_rig(seed), cache):
            figures = f"{one.count:8d} {one.rms:10.2f} {one.rms_without:14.1f} {one.rms_all:15.2f}"
            print(f"train {seed:3d}  {one.name:14s} {figures}", flush=True)


def keep(path: Path, seed: int, cache: Path) -> None:
    """Write Mitsuba's pictures around the deepest step, and that step, for a test that has no Mitsuba."""
    rig = diffuse_rig(seed)
    name, pair = max(_pairs(rig, cache), key=lambda named: named[0])
    step = pair.surface
    if not isinstance(step, PunchPress):
        raise SystemExit(f"no step to keep, but {name}")
    part = build_camera(rig, cache).grid.part(Area(step.centre_mm, (_KEPT_MM, _KEPT_MM)))
    places, depths = step.profile.seen(step.face_mm)
    np.savez_compressed(
        path,
        seed=seed,
        rows=(part[0].start, part[0].stop),
        columns=(part[1].start, part[1].stop),
        shadowed=pair.shadowed[part],
        lit=pair.lit[part],
        scale=pair.scale,
        centre_mm=step.centre_mm,
        rounding_mm=step.rounding_mm,
        places_mm=places.astype(np.float32),
        depths_mm=depths.astype(np.float32),
    )


def _surfaces(rig: Rig) -> Iterator[tuple[str, Surface]]:
    gel = draw_gel(rig)
    for step in plan_steps(rig, gel, 4)[1:]:
        yield f"step {step.face_mm:.2f} mm", step
    yield "ball 4 mm", BallPress(4.0, 2.2, gel.thickness_mm, gel.poisson_ratio, (1.5, -2.0))


def rms(one: Bytes, other: Bytes, where: Bools) -> float:
    """Root mean square difference in grey levels over some values."""
    return float(np.sqrt(np.mean(np.square(one.astype(float) - other)[where]))) if where.any() else 0.0
