"""
An effect of your own
=====================

Plant a clamp that creeps with every press in the data, define the effect, and recover it::

    P -> P (1 + amplitude * order / last order)

For the command line, put the class into its own file: ``tactilevision diagnose RECORDING --effect FILE.py``.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from calibration import EffectBase, Measured, Observations, Parameter, Stage, State, compare, observe
from tactilevision import Estimate, Floats, read_recording

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


def draw(found: Estimate) -> None:
    """Plot the planted and the estimated size, with its 95 % interval."""
    assert found.value is not None
    assert found.std is not None
    figure, axes = plt.subplots(figsize=(6, 1.9), layout="constrained")
    axes.errorbar([found.value], [0], xerr=1.96 * found.std, fmt="o", capsize=4, label="found (95 % interval)")
    axes.axvline(PLANTED, color="k", ls="--", label="planted")
    axes.set(xlabel="amplitude of the clamp's creep", yticks=[], ylim=(-1, 2.2))
    axes.legend(ncols=2, loc="upper right")
    figure.savefig("own_effect.png", dpi=150)


def main() -> None:
    recording = read_recording(SAMPLE)
    data = observe([Measured(recording, recording.points, recording.curves)])
    crept = replace(data, force_N=data.force_N * (1 + PLANTED * share_of(data))[:, None])
    base, _, added = compare(crept, ["viscoelasticity", ClampCreep()], rng=np.random.default_rng(0)).models
    found = dict(added.parameters)["clamp_creep.amplitude"]
    draw(found)
    print(f"planted {PLANTED:.3f}, found {found.value:.3f} ± {found.std:.3f}")
    print(
        f"error on held-out presses: {1e3 * base.held_out_N:.0f} -> {1e3 * added.held_out_N:.0f} mN, "
        f"repeatability {1e3 * added.repeatability_N:.0f} mN"
    )


if __name__ == "__main__":
    main()
