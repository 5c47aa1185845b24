"""Poisson's ratio from whole simulated frames, friction unknown: to reach .01 in 9 of 10, covered in 9 of 10.

As in nu_from_profile.py the gel is a fresh finite element solution that no table holds, here with a drawn edge of
the punch too, and it is seen through a camera: lights, noise, JPEG, a ramp, an unknown clock. 15 presses of five
depths, nothing stated of nu. Beside it the published route, nu from the beta of the same certified points.
python -m benchmarks.nu_from_frames [recordings] [first seed]
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.main_job import SIDES
from calibration.calibrate import calibrate
from calibration.data import Measured
from tactilevision.errors import ConvergenceError, TactilevisionError
from tactilevision.press.beside import with_nu
from tactilevision.press.certify import certify
from tactilevision.reconstruct import build_reconstructor
from tactilevision.recording import read_recording
from tactilevision.records import Estimate, Floats, Material
from tactilevision.synthetic import SimulationOptions, simulate
from tactilevision.synthetic.profile import PunchProfile

RADIUS_MM, THICKNESS_MM = 2.5, 3.0
HEIGHTS_MM = (0.15, 0.22, 0.28, 0.34, 0.39)  # as deep as finite elements go at any nu
DEPTHS = (0.01, 0.03, 0.06, 0.09, 0.12, 0.13)  # w/h of the solution
RECORDINGS, FIRST_SEED = 10, 7000


@dataclass(frozen=True, slots=True)
class FemProfile:
    """The whole surface by finite elements: `rise` and `outward` displacement over the depth, (m, n) each, at the
    nodes `r_mm` (n,) and the depths `w_over_h` (m,)."""

    r_mm: Floats
    w_over_h: Floats
    rise: Floats
    outward: Floats


@dataclass(frozen=True, slots=True)
class SolvedProfile(PunchProfile):
    """The surface beside a punch by finite elements: `rise`, `outward` (m, n) over the depth at `depths_mm`."""

    depths_mm: Floats
    rise: Floats
    outward: Floats

    def carried(self, depth_mm: float) -> Floats:
        """Outward displacement (n,), mm."""
        return depth_mm * _at(self.outward, self.depths_mm, depth_mm)

    def seen(self, depth_mm: float) -> tuple[Floats, Floats]:
        """Places that the camera sees, and the depth there, mm."""
        places = self.radius_mm + self.carried(depth_mm)
        return np.maximum.accumulate(places), -depth_mm * _at(self.rise, self.depths_mm, depth_mm)


def _at(values: Floats, depths: Floats, depth: float) -> Floats:
    """Rows of `values` (m, n) at one depth, linear in between, held beyond the ends."""
    low = int(np.clip(np.searchsorted(depths, depth) - 1, 0, len(depths) - 2))
    part = float(np.clip((depth - depths[low]) / (depths[low + 1] - depths[low]), 0, 1))
    return np.asarray((1 - part) * values[low] + part * values[low + 1])


def solve(nu: float, friction: float, edge_mm: float) -> SolvedProfile:
    """A fresh finite element solution of the punch."""
    from tactilevision.mechanics.punch_fem.contact import RoundedPunch
    from tactilevision.mechanics.punch_fem.march import march
    from tactilevision.mechanics.punch_fem.newton import equations
    from tactilevision.mechanics.punch_fem.problem import PunchProblem, build

    punch = RoundedPunch(RADIUS_MM, edge_mm, friction)
    model = build(PunchProblem(Material(1.0, nu), punch, THICKNESS_MM, 5 * THICKNESS_MM))
    r, z = model.mesh.nodes_mm.T
    top = np.flatnonzero(z > THICKNESS_MM * (1 - 1e-9))
    top = top[np.argsort(r[top])]
    states = list(march(equations(model, by_force=False), [w * THICKNESS_MM for w in DEPTHS], []))
    rise, outward = (np.array([s.u[2 * top + row] / s.depth_mm for s in states]) for row in (1, 0))
    return _beside(FemProfile(r[top], np.array(DEPTHS), rise, outward))


def _beside(found: FemProfile) -> SolvedProfile:
    beside = found.r_mm >= RADIUS_MM
    rise, outward = found.rise[:, beside].copy(), found.outward[:, beside]
    rise[:, 0] = -1.0  # the wall
    r, depths = found.r_mm[beside], found.w_over_h * THICKNESS_MM
    return SolvedProfile(RADIUS_MM, r, -rise[-1], outward[-1], depths, rise, outward)


def options_of(seed: int, nu: float, profile: SolvedProfile) -> SimulationOptions:
    """Own lights, gel, bevel's side and clock; 15 good presses, nothing known of nu."""
    plain = SimulationOptions(name=f"nu-{seed}", frames="jpeg", presses=3, balls=14, faults=(), torn_frame=False)
    gel = replace(plain.gel, poisson_ratio=nu, prior_std=None)
    kit = replace(plain.indenters, heights_mm=HEIGHTS_MM, bevel=SIDES[seed % 4], profile=profile)
    camera = replace(plain.camera, light_seed=seed)
    return replace(plain, gel=gel, indenters=kit, camera=camera, rig=replace(plain.rig, frames_per_press=40))


def run(seed: int) -> tuple[float, float, Estimate, Estimate, str]:
    """Truth, friction, nu by the picture, nu by the published route, and the source that calibrate names."""
    rng = np.random.default_rng(seed)
    nu, friction = float(rng.uniform(0.45, 0.495)), float(rng.choice([0.1, 0.2, 0.4, 0.7]))
    profile = solve(nu, friction, float(rng.uniform(0.02, 0.08)))
    with tempfile.TemporaryDirectory() as folder:
        place = simulate(Path(folder) / "made", seed=seed, options=options_of(seed, nu, profile))
        recording = read_recording(place)
        reconstructor = build_reconstructor(recording)
        certificate, bulge = with_nu(recording, reconstructor, certify(recording, reconstructor))
        if bulge is None:
            raise TactilevisionError(f"seed {seed}: no press shows the gel beside it")
    measured = Measured(recording, certificate.points)
    result = calibrate(measured, clock_offset=certificate.clock_offset, bulge=bulge)
    paper = calibrate(measured, law="paper").poisson_ratio
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
    print(f"within .01: {within} of {len(errors)}; intervals cover {sum(covered)} of {len(errors)}; "
          f"rms {np.sqrt(np.mean(np.square(errors))):.4f}")  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1:])
