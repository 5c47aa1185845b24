"""An effect of one's own, planted in clean data and then looked for: the clamp that creeps with every press.

    P -> P (1 + amplitude * order / last order)

On the command line the same class goes into its own file: `tactilevision diagnose RECORDING --effect FILE.py`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.inputs.observations import Measured, Observations
from calibration.model.parameters import Parameter
from calibration.model.stages import EffectBase, Stage, State
from calibration.tasks.calibrate import observe
from calibration.tasks.compare import compare
from tactilevision import read_recording
from tactilevision.records import Floats

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "hidden_material"
PLANTED = 0.06


@dataclass(frozen=True, slots=True)
class ClampCreep(EffectBase):
    """One amplitude: the relative change of force from the first press to the last."""

    key = "clamp_creep"
    title = "the clamp creeps with every press"
    stage = Stage.INSTRUMENT
    seen_in = ("order",)
    confused_with = ("ageing",)
    separated_by = ("presses at long intervals",)
    source = "own assumption"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("amplitude", "1", 0.0, (-0.5, 0.5), "change from first press to last", 0.05),)

    def missing(self, data: Observations) -> str:
        return "" if data.count > 2 else "needs several presses"

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        return replace(state, force_N=state.force_N * (1 + values[0] * share_of(data)))


def share_of(data: Observations) -> Floats:
    """0 for samples of the first press, 1 for those of the last."""
    return data.presses.order[data.press] / float(np.max(data.presses.order))


def main() -> None:
    recording = read_recording(SAMPLE)
    data = observe([Measured(recording, recording.points, recording.curves)])
    crept = replace(data, force_N=data.force_N * (1 + PLANTED * share_of(data))[:, None])
    base, _, added = compare(crept, ["viscoelasticity", ClampCreep()], np.random.default_rng(0)).models
    found = dict(added.parameters)["clamp_creep.amplitude"]
    print(f"planted {PLANTED:.3f}, found {found.value:.3f} ± {found.std:.3f}")
    print(
        f"error on presses left out: {1e3 * base.held_out_N:.0f} -> {1e3 * added.held_out_N:.0f} mN, "
        f"the repeats' own scatter {1e3 * added.repeatability_N:.0f} mN"
    )


if __name__ == "__main__":
    main()
