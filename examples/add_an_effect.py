"""
Add an effect by hand
=====================

The base model misses these presses by twice their repeatability. Adding relaxation reduces the error.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from calibration import Measured, Viscoelasticity, compare, observe
from tactilevision import read_recording

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "hidden_material"


def draw(names: list[str], held_out_N: list[float], repeatability_N: float) -> None:
    """Plot the error on held-out presses of each model, with the repeatability."""
    figure, axes = plt.subplots(figsize=(7, 2.4), layout="constrained")
    axes.barh(names, [1e3 * error for error in held_out_N], color=["#b0b7c3", "#00429d"])
    axes.axvline(1e3 * repeatability_N, color="k", ls="--", label="repeatability")
    axes.invert_yaxis()
    axes.set(xlabel="rms error on held-out presses (mN)")
    axes.legend()
    figure.savefig("add_an_effect.png", dpi=150)


def main() -> None:
    recording = read_recording(SAMPLE)
    data = observe([Measured(recording, recording.points, recording.curves)])
    models = compare(data, [Viscoelasticity()], rng=np.random.default_rng(0)).models
    draw([model.name for model in models], [model.held_out_N for model in models], models[-1].repeatability_N)
    for model in models:
        causes = [cause.key for cause in model.covariates if cause.p_adjusted < 0.05]
        print(
            f"{model.name}: {1e3 * model.held_out_N:.1f} mN on held-out presses, "
            f"repeatability {1e3 * model.repeatability_N:.1f}; "
            f"the residual still depends on: {', '.join(causes) or 'nothing recorded'}"
        )
        for name, found in model.parameters:
            print(f"    {name} = {found.value:.4g} ± {found.std:.2g} {found.unit}")


if __name__ == "__main__":
    main()
