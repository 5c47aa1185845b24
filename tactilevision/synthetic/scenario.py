"""What happens in a simulated recording before anybody looks at it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilevision.synthetic.options import SimulationOptions
from tactilevision.synthetic.plan import PlannedPress, gel_law, plan_presses
from tactilevision.synthetic.rig import ForceSensor, GelLaw


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything that happens in a recording before anybody looks: presses, clocks, the force sensor."""

    options: SimulationOptions
    seed: int
    law: GelLaw
    presses: tuple[PlannedPress, ...]
    clock_offset_s: float
    sensor: ForceSensor


def draw_scenario(options: SimulationOptions, seed: int) -> Scenario:
    """Draw everything but the pictures' and the forces' noise."""
    rng = stream(seed, 0)
    law = gel_law(options)
    presses = plan_presses(options, rng)
    offset = options.rig.clock_offset_s
    drawn = float(rng.uniform(-0.2, 0.2))
    largest = max(float(law.force_N(p.profile, p.touch_mm + options.rig.protocol.overtravel_mm)) for p in presses)
    bias, drift = rng.uniform(-0.3, 0.3, 3), rng.uniform(-1e-4, 1e-4, 3)
    sensor = ForceSensor(
        bias_N=(float(bias[0]), float(bias[1]), float(bias[2])),
        drift_N_s=(float(drift[0]), float(drift[1]), float(drift[2])),
        range_N=round(1.4 * largest + 0.5, 1),
    )
    return Scenario(options, seed, law, presses, drawn if offset is None else offset, sensor)


def stream(seed: int, number: int) -> np.random.Generator:
    """Independent streams, so that another picture format leaves the forces as they are."""
    return np.random.default_rng([seed, number])
