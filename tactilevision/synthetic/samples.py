"""Generate sample_frames/ reproducibly: python -m tactilevision.synthetic.samples [FOLDER]."""

from __future__ import annotations

import sys
from pathlib import Path

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
    """Write gelslim3 and paper_points into `folder`, replacing existing ones except for their README.md."""
    simulate(Path(folder) / "gelslim3", seed=GELSLIM3_SEED, options=gelslim3_options())
    write_paper_points(Path(folder) / "paper_points")


def write_paper_points(folder: Path) -> None:
    """Write the paper's five presses as certified points on its printed line."""
    kit, camera, thickness_mm = IndenterOptions(), CameraOptions(), GelOptions().thickness_mm  # of the paper
    made = [
        (f"A{i}", w, round((_PAPER_INTERCEPT_N_MM + _PAPER_SLOPE_N_MM * w / thickness_mm) * w, 4))
        for i, w in enumerate(kit.heights_mm, start=1)
    ]
    gel = Gel(thickness_mm=thickness_mm, shape="disc", radius_mm=PAD_RADIUS_MM)
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


if __name__ == "__main__":
    make_samples(sys.argv[1] if len(sys.argv) > 1 else "sample_frames")
