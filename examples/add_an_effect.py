"""The model beside the measurements; an effect added by hand, and the error seen to fall."""

from pathlib import Path

import numpy as np

from calibration.effects.viscoelasticity import Viscoelasticity
from calibration.inputs.observations import Measured
from calibration.tasks.calibrate import observe
from calibration.tasks.compare import compare
from tactilevision import read_recording

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "hidden_material"


def main() -> None:
    recording = read_recording(SAMPLE)
    data = observe([Measured(recording, recording.points, recording.curves)])
    for model in compare(data, [Viscoelasticity()], np.random.default_rng(0)).models:
        told = [cause.key for cause in model.covariates if cause.p_adjusted < 0.05]
        print(
            f"{model.name}: {1e3 * model.held_out_N:.1f} mN on presses left out, "
            f"repeatability {1e3 * model.repeatability_N:.1f}; the residual still depends on: {', '.join(told) or 'nothing recorded'}"
        )
        for name, found in model.parameters:
            print(f"    {name} = {found.value:.4g} ± {found.std:.2g} {found.unit}")


if __name__ == "__main__":
    main()
