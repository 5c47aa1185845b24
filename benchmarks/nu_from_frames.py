"""Poisson's ratio from whole simulated frames, friction unknown: to reach .01 in 9 of 10, covered in 9 of 10.

As in nu_from_profile.py the gel is a fresh finite element solution that no table holds, as all simulated gels are,
here with a drawn friction and edge, seen through a camera: lights, noise, JPEG, a ramp, an unknown clock. 15
presses of five depths, nothing stated of nu. Beside it the published route, nu from the beta of the
same certified points.
python -m benchmarks.nu_from_frames [recordings] [first seed]
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.main_job import SIDES
from calibration.inputs.observations import Measured
from calibration.tasks.calibrate import calibrate
from tactilevision.errors import ConvergenceError, TactilevisionError
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.press.certification import certify
from tactilevision.press.poisson_from_rise import with_nu
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Estimate
from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.simulation import simulate

HEIGHTS_MM = (0.15, 0.22, 0.28, 0.34, 0.39)  # as deep as finite elements go at any nu
RECORDINGS, FIRST_SEED = 10, 7000


def options_of(seed: int, nu: float, friction: float, edge_mm: float) -> SimulationOptions:
    """Own lights, gel, edge, bevel's side and clock; 15 good presses, nothing known of nu."""
    plain = SimulationOptions(name=f"nu-{seed}", frames="jpeg", presses=3, balls=14, faults=(), torn_frame=False)
    gel = replace(plain.gel, poisson_ratio=nu, friction=friction, prior_std=None)
    kit = replace(plain.indenters, heights_mm=HEIGHTS_MM, bevel=SIDES[seed % 4], edge_radius_mm=edge_mm)
    camera = replace(plain.camera, light_seed=seed)
    return replace(plain, gel=gel, indenters=kit, camera=camera, rig=replace(plain.rig, frames_per_press=40))


def run(seed: int, *, small: bool = False) -> tuple[float, float, Estimate, Estimate, str]:
    """Truth, friction, nu by the picture, nu by the published route, and the source that calibrate names."""
    rng = np.random.default_rng(seed)
    nu, friction = float(rng.uniform(0.45, 0.495)), float(rng.choice([0.1, 0.2, 0.4, 0.7]))
    options = options_of(seed, nu, friction, float(rng.uniform(0.02, 0.08)))
    if small:
        camera = replace(options.camera, width_px=213, height_px=160, mm_per_px=(0.127, 0.127))
        options = replace(options, camera=camera, presses=1, rig=replace(options.rig, frames_per_press=24))
    with tempfile.TemporaryDirectory() as folder:
        place = simulate(Path(folder) / "made", seed=seed, options=options)
        recording = read_recording(place)
        reconstructor = build_reconstructor(recording)
        certificate, bulge = with_nu(recording, reconstructor, certificate=certify(recording, reconstructor))
        if bulge is None:
            raise TactilevisionError(f"seed {seed}: no press shows the gel beside it")
    measured = Measured(recording, certificate.points)
    result = calibrate(measured, clock_offset=certificate.clock_offset, bulge=bulge, test=False)
    paper = calibrate(measured, law="paper", test=False).poisson_ratio
    return nu, friction, bulge, paper, result.poisson_ratio_source


def main(arguments: list[str] | None = None) -> None:
    """Print one line a recording and the summary. `arguments`: how many recordings, the first seed."""
    count, first = ([int(a) for a in arguments or []] + [RECORDINGS, FIRST_SEED][len(arguments or []) :])[:2]
    print("seed     nu  friction   found     std   error  covers  source  paper's route")
    errors, covered = [], []
    for seed in range(first, first + count):
        try:
            nu, friction, found, paper, source = run(seed)
        except ConvergenceError as fault:
            print(f"{seed:4d} no truth: {fault}", flush=True)
            continue
        low, high = found.interval95 or (np.nan, np.nan)
        errors.append((found.value if found.value is not None else np.nan) - nu)
        covered.append(low <= nu <= high)
        verdict = "yes" if covered[-1] else "NO"
        said = f"{nu + errors[-1]:8.4f} {found.std or np.nan:7.4f} {errors[-1]:+7.4f} {verdict:>6}  {source:>6}"
        print(f"{seed:4d} {nu:.4f} {friction:8.2f} {said} {paper.value or np.nan:10.4f}", flush=True)
    within = sum(abs(error) <= 0.01 for error in errors)
    print(
        f"within .01: {within} of {len(errors)}; intervals cover {sum(covered)} of {len(errors)}; "
        f"rms {np.sqrt(np.mean(np.square(errors))):.4f}"
    )


def quick() -> None:
    nu, _, found, paper, source = run(FIRST_SEED, small=True)
    print(f"nu {nu:.4f}, found {found.value} within {found.interval95}; source {source}; paper {paper.value}")


if __name__ == "__main__":
    main(sys.argv[1:])
