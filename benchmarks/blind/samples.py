"""Makes the folders sample_frames/hidden_* again: python -m benchmarks.blind.samples [FOLDER].

Each hides one thing: an effect of the rig (with pictures), one of the material, one outside the catalogue; the
last one two things.
"""

from __future__ import annotations

import shutil
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import tomli_w

from benchmarks.blind.design import Design, rich
from benchmarks.blind.record import write
from benchmarks.blind.rig import Noise, add_noise, read
from benchmarks.blind.world import World, draw_world
from tactilevision.files.writing import write_text
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_balls
from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.options import GelOptions, IndenterOptions, RigOptions, SimulationOptions
from tactilevision.synthetic.rig import Protocol
from tactilevision.synthetic.simulation import simulate

SEED = 20261122
TWO = {"viscoelasticity": 0.05, "thickness_wedge": 0.03}  # of one gel, a share and mm/mm
BALLS_STATED = 1.25  # a ball of 5 mm taken for one of 4: every slope is taken for smaller than it is


def main(arguments: Sequence[str] = ()) -> None:
    """Write the four folders in place of what is there."""
    root = Path(arguments[0] if arguments else "sample_frames")
    for name in ("hidden_rig", "hidden_material", "hidden_unknown", "hidden_two"):
        shutil.rmtree(root / name, ignore_errors=True)
    make_rig(root / "hidden_rig")
    make_curves(root / "hidden_material", SEED + 1, {"viscoelasticity": 0.05})
    make_curves(root / "hidden_unknown", SEED + 2, {"two_ranges": 0.03})
    make_curves(root / "hidden_two", SEED + 3, TWO)
    for name, text in READMES.items():
        write_text(root / name / "README.md", text)


def make_rig(folder: Path) -> None:
    """A small camera, three indenters, and reference balls that are not as large as their table says."""
    options = SimulationOptions(
        name="hidden-rig",
        gel=GelOptions(youngs_modulus_MPa=0.21, poisson_ratio=0.479, friction=0.25, prior=0.48, prior_std=0.005),
        camera=CameraOptions(width_px=280, height_px=210, mm_per_px=(0.0965, 0.0965), distortion_px=0.0),
        indenters=IndenterOptions(heights_mm=(0.25, 0.4, 0.55)),
        rig=RigOptions(protocol=Protocol(rest_s=2.0, hold_s=0.5, free_s=0.6), frames_per_press=18),
        presses=3,
        faults=(),
        frames="jpeg",
        jpeg_quality=84,
        flats=1,
        balls=20,
        torn_frame=False,
    )
    simulate(folder, seed=SEED, options=options)
    balls = read_recording(folder).balls
    write_balls(
        folder, [replace(ball, ball_radius_mm=round(BALLS_STATED * ball.ball_radius_mm, 4)) for ball in balls]
    )
    truth = folder / "truth.toml"
    content = tomllib.loads(truth.read_text(encoding="utf-8"))
    hidden = {"photometric_gain": {"amount": 1 / BALLS_STATED - 1, "unit": "1", "catalogued": True}}
    write_text(truth, tomli_w.dumps({**content, "hidden": hidden}))


def make_curves(folder: Path, seed: int, amounts: dict[str, float]) -> None:
    """Whole curves of the rich design, sampled more densely."""
    rng = np.random.default_rng(seed)
    design = _dense(rich(rng))
    source = "stage" if "screw_error" in amounts else "vision"
    world: World = replace(draw_world(rng), amounts=amounts, source=source)
    noise = Noise()
    reads = add_noise(read(world, design), noise, rng)
    write(folder, world, design, reads, noise=noise, name=folder.name.replace("_", "-"), nu_stated=0.48)


def _dense(design: Design) -> Design:
    shares = tuple(float(share) for share in np.linspace(0.03, 0.97, 24))
    hold = tuple(float(share) for share in np.linspace(0.03, 0.97, 8))
    return replace(design, load=shares, hold=hold, unload=(0.9, 0.75, 0.6, 0.45, 0.3, 0.15, 0.05, -1.0))


_END = """
No frame, force or number of a real sensor is in it. It is made again by

    python -m benchmarks.blind.samples sample_frames

with the seed {seed}. Something is hidden in it that the recording does not say; `truth.toml`, which only tests and
benchmarks read, says what. Find it first:

    tactilevision diagnose sample_frames/{name} --out diagnosis

Licence: as the project (MIT).
"""

_RIG = """# hidden_rig: a simulated calibration run with pictures, and something wrong with the rig

Three flat cylinders (radius 2.5 mm; .25, .4 and .55 mm over the bevel on their right), three presses each, seen by
a small camera (280 x 210, JPEG, colours at full resolution, about 18 frames a press), made by
`tactilevision.synthetic`; `reference/` holds one picture of the untouched gel and twenty of balls.
"""

_CURVES = """# {title}

39 presses of three flat cylinders over three days: three speeds, three repeats, four places twice, four long
holds, waits from 10 to 150 s. Depth (by {source}) and force of each press are in curves.csv, 41 samples each,
on one clock. The gel's slope at small depth is Hayes' (from a table of kappa), its bend that of printed finite
elements of a neo-Hookean gel; the noise is 4 mN a sample and, press by press, .5 % of the force and 4 um of the
depth. None of it shares a formula with `calibration`.
"""

_MATERIAL = _CURVES.format(title="hidden_material: simulated curves of a gel with a secret", source="vision")
_TWO = _CURVES.format(title="hidden_two: simulated curves of a gel with two secrets", source="vision")
_UNKNOWN = _CURVES.format(title="hidden_unknown: simulated curves out of the catalogue", source="vision")

READMES = {
    "hidden_rig": _RIG + _END.format(seed=SEED, name="hidden_rig"),
    "hidden_material": _MATERIAL + _END.format(seed=SEED + 1, name="hidden_material"),
    "hidden_two": _TWO
    + _END.format(seed=SEED + 3, name="hidden_two")
    .replace("Something is", "Two things are")
    .replace("Find it", "Find them"),
    "hidden_unknown": _UNKNOWN + _END.format(seed=SEED + 2, name="hidden_unknown"),
}


if __name__ == "__main__":
    main(sys.argv[1:])
