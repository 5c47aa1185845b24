"""Shear from pictures against simulated truth: grain of several contrasts and markers, under a contact's light.

A known traction moves the gel (linear layer); the simulated camera of synthetic/ draws the moved surface with its
own lights, lens blur and noise; shear is read from the two frames. The force then comes from that shear and from
the true depth with 5 um noise, so that what is wrong with it is the shear's.

python -m benchmarks.shear [cases]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.force_cases import Forward, View, at_camera, draw_case
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.records.maps import HeightMap
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel
from tactilevision.shear.displacement import read_untouched
from tactilevision.synthetic.camera import CameraOptions, build_camera
from tactilevision.synthetic.gel import Area, Flat, Grid, Singles, Surface

VIEW = View((240, 320), 0.0855, 2)
GEL, MATERIAL = Gel(3.0), Material(0.2, 0.48)
SETTINGS = ForceSettings(large_depth=False)
KINDS = ("Hertz", "flat punch", "two contacts")
DEPTH_STD_MM = 0.005


@dataclass(frozen=True)
class Moved(Surface):
    """A surface for the simulated camera: `depth` (H, W) and `carried` (2, H, W), both at the camera's places."""

    depth: Floats
    carried: Floats
    steep: tuple[Area, ...] = ()

    def depth_mm(self, grid: Grid) -> Singles:
        """Depth (H, W)."""
        return self.depth.astype(np.float32)

    def shift_mm(self, grid: Grid) -> tuple[Singles, Singles]:
        """How far the ink seen at each place has come."""
        return self.carried[0].astype(np.float32), self.carried[1].astype(np.float32)


@dataclass(frozen=True)
class Look:
    """What the gel shows."""

    name: str
    texture: float
    markers: bool = False


LOOKS = (
    Look("grain .012 (the sample's)", 0.012),
    Look("grain .03", 0.03),
    Look("grain .08", 0.08),
    Look("markers", 0.012, markers=True),
)


def shear_errors(look: Look, *, cases: int, seed: int) -> Floats:
    """Rows: rms error of the shear in um where it matters (contact and near) and its std there, share known, error
    of fx and fy over the resultant's size, their pulls; NaN where nothing could be followed."""
    rng, forward = np.random.default_rng(seed), Forward(VIEW, GEL, MATERIAL)
    scale = (VIEW.mm_per_px, VIEW.mm_per_px)
    field = ForceField(GEL, MATERIAL, scale, view_px=VIEW.shape, settings=SETTINGS)
    options = CameraOptions(
        width_px=VIEW.shape[1],
        height_px=VIEW.shape[0],
        mm_per_px=scale,
        texture=look.texture,
        markers=look.markers,
        distortion_px=0.0,
    )
    rows = []
    for number in range(cases):
        camera = build_camera(options, np.random.default_rng([seed, number]))
        untouched = read_untouched(camera.picture(Flat(), rng), scale)
        traction = draw_case(KINDS[number % len(KINDS)], VIEW, rng)
        u = forward(traction)
        surface = Moved(at_camera(u, VIEW), np.stack([_at_camera(u, part) for part in u[:2]]))
        shear = untouched.shear(camera.picture(surface, rng))
        depth = surface.depth + DEPTH_STD_MM * rng.standard_normal(VIEW.shape)
        height = HeightMap(depth, np.ones(VIEW.shape, bool), scale, std_mm=np.full(VIEW.shape, DEPTH_STD_MM))
        found = field(height, shear)
        true = traction.sum(axis=(1, 2)) * (VIEW.mm_per_px / VIEW.fine) ** 2
        error = np.asarray(found.resultant_N)[:2] - true[:2]
        near = shear.valid & (u[2] > 0.3 * u[2].max())
        off = np.stack([shear.u_x_mm - u[0], shear.u_y_mm - u[1]])[:, near]
        std = np.broadcast_to(np.asarray(shear.std_mm, dtype=float), VIEW.shape)[near]
        rms = 1e3 * float(np.sqrt(np.mean(off**2))) if near.any() else np.nan
        stated = 1e3 * float(np.sqrt(np.mean(std**2))) if near.any() else np.nan
        pulls = error / np.asarray(found.resultant_std_N)[:2]
        motion = 1e3 * float(np.hypot(u[0], u[1]).max())
        rows.append([rms, stated, shear.valid.mean(), *error / np.linalg.norm(true), *pulls, motion])
    return np.array(rows)


def _at_camera(u: Floats, part: Floats) -> Floats:
    """A field of the material at the places where the camera sees it."""
    return at_camera(np.stack([u[0], u[1], part]), VIEW)


def main(arguments: Sequence[str]) -> None:
    """Print the table."""
    cases = int(arguments[0]) if arguments else 24
    for look in LOOKS:
        rows = shear_errors(look, cases=cases, seed=5)
        known = np.isfinite(rows[:, 3])
        print(f"{look.name}: followed in {known.sum()} of {len(rows)}; motion to {rows[:, 7].max():.0f} um")
        if known.any():
            off, inside = 100 * np.abs(rows[known, 3:5]), np.abs(rows[known, 5:7]) < 1.96
            middle, most = np.percentile(off, [50, 95])
            real, said = np.nanmedian(rows[known, :2], axis=0)
            print(f"    shear in the contact off by {real:.0f} um rms (it says {said:.0f})")
            print(
                f"    fx, fy off by {middle:.1f} % of the force (median), {most:.1f} % (95th); "
                f"{100 * inside.mean():.0f} % inside the 95 % interval",
                flush=True,
            )


def quick() -> None:
    main(["1"])


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main(sys.argv[1:])
