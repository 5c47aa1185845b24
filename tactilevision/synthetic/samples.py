"""Generate sample_frames/ reproducibly: python -m tactilevision.synthetic.samples [FOLDER]."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from tactilevision.files.writing import write_text
from tactilevision.recording.model import Recording
from tactilevision.recording.write import write_recording
from tactilevision.records.certified import CertifiedPoint
from tactilevision.records.rig import Gel, Indenter, Sensor
from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.options import GelOptions, IndenterOptions, RigOptions, SimulationOptions
from tactilevision.synthetic.punch import PAD_RADIUS_MM
from tactilevision.synthetic.rig import Protocol
from tactilevision.synthetic.simulation import simulate

GELSLIM3_SEED = 20261121  # seed of the sample recording

# Five points of P/w = 5.2662 w/h + 3.4943, h = 3 mm; the paper does not print its readings.
_PAPER_SLOPE_N_MM = 5.2662  # N/mm, growth of P/w with w/h
_PAPER_INTERCEPT_N_MM = 3.4943  # N/mm, P/w at w = 0
_PAPER_THICKNESS_MM = 3.0  # mm, the paper's gel


def gelslim3_options() -> SimulationOptions:
    """Return the options of sample_frames/gelslim3, with few frames per press."""
    return SimulationOptions(
        name="gelslim3-sample",
        gel=GelOptions(youngs_modulus_MPa=0.1942, poisson_ratio=0.478, friction=0.4, prior=0.48, prior_std=0.01),
        indenters=IndenterOptions(edge_radius_mm=0.06),
        rig=RigOptions(protocol=Protocol(rest_s=2.0, hold_s=0.5, free_s=0.6), frames_per_press=18),
        frames="jpeg",
        jpeg_quality=90,
        flats=2,
        balls=16,
    )


def make_samples(folder: Path | str) -> None:
    """Write gelslim3 and paper_points into `folder`, replacing existing ones."""
    root = Path(folder)
    for name in ("gelslim3", "paper_points"):
        shutil.rmtree(root / name, ignore_errors=True)
    simulate(root / "gelslim3", seed=GELSLIM3_SEED, options=gelslim3_options())
    write_text(root / "gelslim3" / "README.md", _GELSLIM3)
    write_paper_points(root / "paper_points")
    write_text(root / "paper_points" / "README.md", _PAPER)


def write_paper_points(folder: Path) -> None:
    """Write the paper's five presses as certified points on its printed line."""
    kit, camera = IndenterOptions(), CameraOptions()
    made = [
        (f"A{i}", w, round((_PAPER_INTERCEPT_N_MM + _PAPER_SLOPE_N_MM * w / _PAPER_THICKNESS_MM) * w, 4))
        for i, w in enumerate(kit.heights_mm, start=1)
    ]
    gel = Gel(thickness_mm=_PAPER_THICKNESS_MM, shape="disc", radius_mm=PAD_RADIUS_MM)
    write_recording(
        Recording(
            path=folder,
            name="paper-points",
            sensor=Sensor("gelslim3", camera.width_px, camera.height_px, camera.mm_per_px, gel=gel),
            depth_source="gauge",
            indenters={name: Indenter(name, radius_mm=kit.radius_mm, height_mm=depth) for name, depth, _ in made},
            points=tuple(CertifiedPoint(name[1:], name, depth, force) for name, depth, force in made),
        )
    )


_GELSLIM3 = f"""# gelslim3: a simulated calibration run

Simulated from beginning to end by `tactilevision.synthetic`, with seed {GELSLIM3_SEED}; no frame, force or number
of a real sensor is in it. It is made again, bit by bit on the same versions, by

    python -m tactilevision.synthetic.samples sample_frames

Five flat cylinders (radius 2.5 mm, 0.15 to 0.6 mm over the bevel on their right) press a gel of 3 mm thickness,
three good presses each, and eight presses in which something went wrong, one for each reason for which a press
can be rejected. One frame is torn. The frames (JPEG, colours at full resolution) are those of a camera at 90 Hz,
thinned to about 18 a press and dense round the bevel's touch; the force sensor's readings are complete. Its clock
runs off the camera's by an amount that is not stated. `reference/` holds 2 pictures of the untouched gel and 16 of
balls, each the mean of 16 frames. What is true is in `truth.toml`, which only tests and benchmarks read.

The gel: neo-Hookean finite elements of this very gel and punch (E = .1942 MPa, nu = .478, friction .4, edge radius
.06 mm) give the surface beside the punch and the force at every depth; c and beta in `truth.toml` are the straight
line through that force. Beside balls it is linear theory. The lights, their fall-off and colours were set by eye
and by block means to look like GelSlim 3.0. Licence: as the project (MIT).
"""

_PAPER = """# paper_points: five certified points from a printed line

The paper prints, for h = 3.0 mm, a = 2.5 mm and a pad of radius 15 mm, the line P/w = 5.2662 w/h + 3.4943 (N/mm,
R^2 = 0.9999) through five presses to w = 0.15, 0.3, 0.4, 0.5 and 0.6 mm. The forces in points.csv are that line at
these depths, rounded to 0.1 mN: the measured scatter is not in them, so they can show that the paper's route is
reproduced (c = 3.4943 N/mm, beta = 1.5071, nu = 0.4797) but cannot decide why its beta is so large.

    python -m tactilevision.synthetic.samples sample_frames

makes this folder again.
"""


if __name__ == "__main__":
    make_samples(sys.argv[1] if len(sys.argv) > 1 else "sample_frames")
