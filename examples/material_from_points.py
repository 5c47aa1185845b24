"""
Depth and force into E and nu
=============================

Five published points of depth and force: what they determine of the gel, and what stays open.
"""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactilevision import CertifiedPoint, calibrate_recording, read_recording

POINTS = Path(__file__).parents[1] / "sample_frames" / "paper_points"


def draw(points: Sequence[CertifiedPoint], nu_E: Sequence[tuple[float, float]]) -> None:
    """Plot the points with their line, and E as a function of nu, which is what one punch determines."""
    depth = np.array([point.depth_mm for point in points])
    stiffness = np.array([point.fz_N for point in points]) / depth
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    left.plot(depth, stiffness, "o", label="five printed points")
    left.plot(depth, np.polyval(np.polyfit(depth, stiffness, 1), depth), label="straight line")
    left.set(xlabel="depth w (mm)", ylabel="P/w (N/mm)", title="force over depth")
    left.legend()
    right.plot(*np.array(nu_E).T)
    right.set(xlabel="Poisson's ratio", ylabel="Young's modulus E (MPa)", title="all of these fit alike")
    figure.savefig("material_from_points.png", dpi=150)


def main() -> None:
    recording = read_recording(POINTS)

    paper = calibrate_recording(recording, law="paper")
    print(f"as published: E = {paper.youngs_modulus.value:.4f} MPa, nu = {paper.poisson_ratio.value:.4f}")

    ours = calibrate_recording(recording)
    low, high = ours.youngs_modulus.interval95 or (float("nan"), float("nan"))
    print(f"what the points fix: c = {ours.c.value:.4f} N/mm, beta = {ours.beta.value:.3f}")
    print(f"E lies between {low:.3f} and {high:.3f} MPa")
    print("E at some nu: " + ", ".join(f"{E:.4f} at {nu:.3f}" for nu, E in ours.youngs_modulus_of_nu[::10]))
    draw(recording.points, ours.youngs_modulus_of_nu)
    for line in (*ours.assumptions, *ours.warnings):
        print(f"- {line}")


if __name__ == "__main__":
    main()
