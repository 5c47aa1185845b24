"""Certified depth and force into E and nu: what five printed points say, and what they leave open."""

from pathlib import Path

from calibration.inputs.observations import Measured
from calibration.tasks.calibrate import calibrate
from tactilevision import read_recording

POINTS = Path(__file__).parents[1] / "sample_frames" / "paper_points"


def main() -> None:
    recording = read_recording(POINTS)
    measured = Measured(recording, recording.points, ())

    paper = calibrate(measured, law="paper")
    print(f"as published: E = {paper.youngs_modulus.value:.4f} MPa, nu = {paper.poisson_ratio.value:.4f}")

    ours = calibrate(measured)
    low, high = ours.youngs_modulus.interval95 or (float("nan"), float("nan"))
    print(f"what the points fix: c = {ours.c.value:.4f} N/mm, beta = {ours.beta.value:.3f}")
    print(f"E lies between {low:.3f} and {high:.3f} MPa")
    print("E at some nu: " + ", ".join(f"{E:.4f} at {nu:.3f}" for nu, E in ours.youngs_modulus_of_nu[::10]))
    for line in (*ours.assumptions, *ours.warnings):
        print(f"- {line}")


if __name__ == "__main__":
    main()
