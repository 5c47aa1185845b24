"""The main job on recordings of unseen seeds: is c right, is E right where nu is given, do the intervals cover?

Each seed draws its own lights, gel, friction, edge, bevel's side, clock, noise; each bad press occurs once.
python -m benchmarks.main_job [recordings] [processes] [seconds of dwell at the touch]
"""

from __future__ import annotations

import json
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.simulation import simulate

FIRST_SEED = 4200
SIDES: tuple[Literal["right", "left", "top", "bottom"], ...] = ("right", "left", "top", "bottom")


def options_of(seed: int, dwell_s: float = 0.0) -> SimulationOptions:
    """A rig like the sample's in front of other lights, with another gel."""
    rng = np.random.default_rng([seed, 17])
    plain = SimulationOptions(name=f"seed-{seed}", frames="jpeg", jpeg_quality=92, presses=3, balls=14)
    gel = replace(
        plain.gel,
        youngs_modulus_MPa=float(rng.uniform(0.12, 0.3)),
        poisson_ratio=float(rng.uniform(0.465, 0.49)),
        friction=float(rng.uniform(0.2, 0.7)),
        prior_std=0.002,
    )
    edge_mm = float(rng.uniform(0.035, 0.065))
    indenters = replace(plain.indenters, bevel=SIDES[seed % 4], edge_radius_mm=edge_mm)
    return replace(
        plain,
        gel=gel,
        indenters=indenters,
        camera=replace(plain.camera, light_seed=seed),
        rig=replace(plain.rig, frames_per_press=48, protocol=replace(plain.rig.protocol, dwell_s=dwell_s)),
    )


def run(seed: int, dwell_s: float = 0.0) -> dict[str, Any]:
    """The figures of a seed's own rig."""
    return judge(seed, options_of(seed, dwell_s))


def judge(seed: int, options: SimulationOptions) -> dict[str, Any]:
    """Simulate, calibrate, compare with the truth."""
    from calibration.inputs.observations import Measured
    from calibration.tasks.calibrate import calibrate
    from tactilevision.heightmap.build import build_reconstructor
    from tactilevision.press.certification import certify
    from tactilevision.press.poisson_from_rise import with_nu
    from tactilevision.recording.read import read_recording

    with tempfile.TemporaryDirectory() as folder:
        place = simulate(Path(folder) / "made", seed=seed, options=options)
        truth = tomllib.loads((place / "truth.toml").read_text())
        recording = read_recording(place)
        reconstructor = build_reconstructor(recording)
        certificate, bulge = with_nu(recording, reconstructor, certificate=certify(recording, reconstructor))
        measured = Measured(recording, certificate.points)
        result = calibrate(measured, clock_offset=certificate.clock_offset, bulge=bulge, test=False)
    return compare(seed, result.as_json(), truth, {p.press: p.reason for p in certificate.points})


def compare(seed: int, found: dict[str, Any], truth: dict[str, Any], reasons: dict[str, str]) -> dict[str, Any]:
    """Errors in per cent, who is covered, and what was said of each press."""
    row: dict[str, Any] = {
        "seed": seed,
        "clock_ms": 1e3 * (found["clock_offset_s"]["value"] - truth["clock_offset_s"]),
    }
    for key in ("c_N_per_mm", "youngs_modulus_MPa", "poisson_ratio"):
        value, (low, high) = found[key]["value"], found[key]["interval95"]
        row[key] = 100 * (value / truth[key] - 1)
        row[f"{key} covered"] = low <= truth[key] <= high
    pairs = Counter[tuple[str, str]]()
    for press in truth["press"]:
        pairs[("" if press["good"] else press["reason"], reasons.get(press["press"], "?"))] += 1
    row["reasons"] = pairs
    return row


def main(arguments: Sequence[str] = ()) -> None:
    """Print one line a recording, then the counts against what is asked for."""
    count = int(arguments[0]) if arguments else 20
    processes = int(arguments[1]) if len(arguments) > 1 else 2
    dwell_s = float(arguments[2]) if len(arguments) > 2 else 0.0
    rows = []
    print(f"{'seed':>6}{'c err %':>9}{'E err %':>9}{'clock ms':>10}  covered c, E, nu   wrong reasons")
    with ProcessPoolExecutor(processes) as pool:
        for row in pool.map(partial(run, dwell_s=dwell_s), range(FIRST_SEED, FIRST_SEED + count)):
            rows.append(row)
            wrong = {f"{a or 'good'}->{b or 'accepted'}": n for (a, b), n in row["reasons"].items() if a != b}
            covered = "".join(
                "y" if row[f"{key} covered"] else "n"
                for key in ("c_N_per_mm", "youngs_modulus_MPa", "poisson_ratio")
            )
            print(
                f"{row['seed']:>6}{row['c_N_per_mm']:>9.2f}{row['youngs_modulus_MPa']:>9.2f}{row['clock_ms']:>10.2f}"
                f"  {covered:18s} {json.dumps(wrong) if wrong else ''}",
                flush=True,
            )
    _totals(rows)


def _totals(rows: Sequence[dict[str, Any]]) -> None:
    total = len(rows)
    for key, limit in (("c_N_per_mm", 1.5), ("youngs_modulus_MPa", 2.0)):
        errors = np.abs([row[key] for row in rows])
        within = np.count_nonzero(errors < limit)
        print(f"{key}: {within} of {total} within {limit} %, median {np.median(errors):.2f} %")
    for key in ("c_N_per_mm", "youngs_modulus_MPa", "poisson_ratio"):
        print(f"{key}: {sum(row[f'{key} covered'] for row in rows)} of {total} covered by the 95 % interval")
    pairs = sum((row["reasons"] for row in rows), Counter[tuple[str, str]]())
    good = sum(n for (a, _), n in pairs.items() if not a)
    lost = sum(n for (a, b), n in pairs.items() if not a and b)
    bad = sum(n for (a, _), n in pairs.items() if a)
    right = sum(n for (a, b), n in pairs.items() if a and a == b)
    print(f"bad presses rejected for their true reason: {right} of {bad}; good ones rejected: {lost} of {good}")


def quick() -> None:
    """One recording of small pictures, each height pressed once."""
    plain = options_of(FIRST_SEED)
    camera = replace(plain.camera, width_px=213, height_px=160, mm_per_px=(0.127, 0.127))
    small = replace(plain, camera=camera, presses=1, faults=("tilt",), rig=replace(plain.rig, frames_per_press=24))
    _totals([judge(FIRST_SEED, small)])


if __name__ == "__main__":
    main(sys.argv[1:])
