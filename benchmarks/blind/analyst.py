"""Those who look at a recording without knowing the truth: the diagnosis, and two naive ways."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.effects import EFFECTS
from calibration.fit.least_squares import Fit, fit
from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured, Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.noise.model import Noise
from tactilevision.errors import ConvergenceError
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Pair

SEED = 7


@dataclass(frozen=True, slots=True)
class Finding:
    """What an analyst says: the verdict, effects added in order, all that it cannot tell apart, and the material.

    The modulus with its std and its 95 % interval (which also reaches to what friction and equals may make of it),
    errors in N, `seconds` of wall clock; `failed` says what was raised, if
    anything.
    """

    verdict: str
    named: tuple[str, ...]
    candidates: tuple[str, ...]
    modulus_MPa: float | None = None
    interval_MPa: Pair | None = None
    held_out_N: float = float("nan")
    floor_N: float = float("nan")
    seconds: float = float("nan")
    lack_of_fit_p: float = float("nan")
    failed: str = ""
    std_MPa: float = float("nan")


def observed(folder: Path) -> Observations:
    """The curves of a recording, as anybody reads them."""
    recording = read_recording(folder)
    return observe_curves(Measured(recording, curves=recording.curves))


def diagnosing(folder: Path) -> Finding:
    """The library's own diagnosis."""
    from calibration.tasks.diagnose import diagnose

    data = observed(folder)
    start = time.perf_counter()
    found = diagnose(data, np.random.default_rng(SEED))
    seconds = time.perf_counter() - start
    modulus = found.material.after.youngs_modulus
    return Finding(
        found.verdict,
        tuple(e.key for e in found.effects),
        tuple(found.candidates),
        modulus.value,
        modulus.interval95,
        found.errors.held_out_after,
        found.errors.floor,
        seconds,
        lack_of_fit_p=found.search.lack_of_fit_p,
        std_MPa=modulus.std or float("nan"),
    )


def naive(folder: Path) -> dict[str, Finding]:
    """Two naive ways, each point a datum with white noise and each effect tried alone.

    "pointwise BIC" takes the smallest BIC, the law alone among them; "smallest error" the effect that leaves
    least.
    """
    fits = _alone(observed(folder))
    least = min((key for key in fits if key), key=lambda key: fits[key].rms_error_N)
    best = min(fits, key=lambda key: _bic(fits[key]))
    said = (best,) if best else ()
    return {
        "pointwise BIC": Finding("IDENTIFIED" if best else "ADEQUATE", said, said),
        "smallest error": Finding("IDENTIFIED", (least,), (least,)),
    }


def _alone(data: Observations) -> dict[str, Fit]:
    """The law alone under "", and with each effect that these data can show."""
    noise = Noise(1.0, stated=True)
    fits = {"": fit(Model(FlatPunch()), data, noise=noise, tolerances=False)}
    start = fits[""].values
    for key, effect in EFFECTS.items():
        if effect.missing(data):
            continue
        model = Model(FlatPunch()) + effect
        place = model.slices(data)[key]
        starts = [np.insert(start, place.start, row) for row in effect.starts(data)]
        nearest = min(starts, key=lambda values: float(np.sum((model.predict(values, data) - data.normal_N) ** 2)))
        try:
            fits[key] = fit(model, data, noise=noise, starts=nearest[None], tolerances=False)
        except (ConvergenceError, ValueError, ArithmeticError):
            continue
    return fits


def _bic(fitted: Fit) -> float:
    size = fitted.data.size
    return float(size * np.log(np.mean(fitted.residual_N**2)) + fitted.free.sum() * np.log(size))
