"""How well presses are certified, on simulated recordings of known truth.

Prints for each kind of recording the errors of touch, depth, force and clocks over its accepted presses, and how
the reasons of the bad presses were told apart. python -m benchmarks.certificate [seeds]
"""

from __future__ import annotations

import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.heightmap.build import build_reconstructor
from tactilevision.press.certificate import Certificate
from tactilevision.press.certification import certify
from tactilevision.recording.read import read_recording
from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.options import GelOptions, IndenterOptions, RigOptions, SimulationOptions
from tactilevision.synthetic.simulation import simulate

KINDS: dict[str, SimulationOptions] = {
    "as the sample": SimulationOptions(),
    "left, place not stated, JPEG": SimulationOptions(
        frames="jpeg", indenters=IndenterOptions(bevel="left", state_bevel_place=False)
    ),
    "top, other lights, 30 fps": SimulationOptions(
        camera=CameraOptions(light_seed=5),
        rig=RigOptions(frame_rate_Hz=30.0, frames_per_press=40),
        indenters=IndenterOptions(bevel="top"),
    ),
    "bottom, relaxing gel, nu not stated": SimulationOptions(
        gel=GelOptions(relaxing=(0.1, 1.0), prior_std=None), indenters=IndenterOptions(bevel="bottom")
    ),
}


def main(arguments: Sequence[str] = ()) -> None:
    seeds = int(arguments[0]) if arguments else 1
    for name, options in KINDS.items():
        judge(name, options, seeds)


def judge(name: str, options: SimulationOptions, seeds: int) -> None:
    """Certify recordings of a kind and print their errors."""
    rows: list[dict[str, float]] = []
    told: Counter[tuple[str, str]] = Counter()
    clocks, seconds = [], []
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as folder:
            truth, certificate, took = _run(Path(folder) / "made", 100 + seed, options)
        rows += _errors(truth, certificate)
        told.update(_reasons(truth, certificate))
        offset = certificate.clock_offset.value
        clocks.append(float("nan") if offset is None else 1e3 * (offset - truth["clock_offset_s"]))
        seconds.append(took)
    _print(name, rows, told, clocks, seconds)


def _run(folder: Path, seed: int, options: SimulationOptions) -> tuple[dict[str, Any], Certificate, float]:
    simulate(folder, seed=seed, options=options)
    start = time.process_time()
    recording = read_recording(folder)
    certificate = certify(recording, build_reconstructor(recording))
    took = time.process_time() - start
    return tomllib.loads((folder / "truth.toml").read_text()), certificate, took


def _errors(truth: dict[str, Any], certificate: Certificate) -> list[dict[str, float]]:
    points = {point.press: point for point in certificate.points}
    rows = []
    for press in truth["press"]:
        point = points[press["press"]]
        if press["reason"] or not point.accepted:
            continue
        rows.append(
            {
                "touch (ms)": 1e3 * (point.time_s - press["touch_time_s"]),
                "depth (%)": 100 * (point.depth_mm / press["depth_mm"] - 1),
                "depth (sigma)": (point.depth_mm - press["depth_mm"]) / point.depth_std_mm,
                "force (%)": 100 * (point.fz_N / press["force_N"] - 1),
                "force (sigma)": (point.fz_N - press["force_N"]) / point.fz_std_N,
            }
        )
    return rows


def _reasons(truth: dict[str, Any], certificate: Certificate) -> list[tuple[str, str]]:
    points = {point.press: point for point in certificate.points}
    return [(press["reason"] or "good", points[press["press"]].reason or "good") for press in truth["press"]]


def _print(
    name: str,
    rows: list[dict[str, float]],
    told: Counter[tuple[str, str]],
    clocks: list[float],
    seconds: list[float],
) -> None:
    right = sum(count for (true, got), count in told.items() if true == got)
    print(
        f"\n{name}: {right} of {sum(told.values())} presses judged rightly, {np.mean(seconds):.1f} s of CPU each"
    )
    for key in rows[0] if rows else ():
        values = np.array([row[key] for row in rows])
        spread = f"scatter {values.std():.2f}  largest {np.abs(values).max():.2f}"
        print(f"  {key:15s} mean {values.mean():+.2f}  {spread}")
    print("  clocks (ms)     " + " ".join(f"{error:+.1f}" for error in clocks))
    for (true, got), count in sorted(told.items()):
        if true != got:
            print(f"  {count} x {true} taken for {got}")


def quick() -> None:
    rig, camera = RigOptions(frames_per_press=24), CameraOptions(213, 160, (0.127, 0.127))
    small = SimulationOptions(camera=camera, rig=rig, presses=1, faults=("tilt",))
    judge("half the picture", small, 1)


if __name__ == "__main__":
    main(sys.argv[1:])
