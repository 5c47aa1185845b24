"""One recording from its kind and seed: drawn, computed, read with noise, and written; the truth stays here."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.experimenter import design, faults
from benchmarks.others_curves import noise
from benchmarks.others_curves.law import Array
from benchmarks.others_curves.protocol import Press, Protocol
from benchmarks.others_curves.recording import write
from benchmarks.others_curves.strength import NU_STD, StraightLaw

KINDS = ("clean", *faults.FAULTS)
UNSTATED_NU = 0.0144  # std of a nu that only the bound of elastomers holds, .45 to .5
TESTABLE = 4.0  # std from which on a fault is to be found
TOUCH = 3.0  # std of a depth within which a reading may be of the touch
FAULTLESS = "noise_grows"  # a kind whose samples have another noise, and nothing else


@dataclass(frozen=True, slots=True)
class Made:
    """What is true of a recording.

    `strength`: std by which the fault changes the readings beyond what E, beta of each radius and nu absorb;
    `off_E`: share by which it moves E of a fit by the law alone.
    """

    kind: str
    seed: int
    sizes: dict[str, float]
    strength: float
    off_E: float
    modulus_MPa: float
    nu: float
    presses: int
    radii: int
    noise: str
    stated: dict[str, Any]


def make(folder: Path, kind: str, seed: int) -> Made:
    """Write the recording of this kind and seed into `folder`."""
    rng = np.random.default_rng([seed, KINDS.index(kind), 50])
    gel, plan, stated = design.draw(rng, kind, nu_std=NU_STD)
    reader, sizes = noise.draw(rng), faults.draw(rng, kind)
    fault = faults.FAULTS[kind][0] if sizes else faults.noise_grows  # which changes no reading
    scene = faults.Scene(gel, plan)
    read = [fault(scene, k, sizes) for k in range(len(plan.presses))]
    rows = [
        _noisy(rng, press, reader, depth, force, sizes)
        for press, (depth, force) in zip(plan.presses, read, strict=True)
    ]
    tolerances = (stated.thickness_std_mm, stated.radius_std_mm)
    write(folder, plan, reader, stated.nu, rows, depth_source=stated.depth_source, tolerances_mm=tolerances)
    law = straight_law(gel, plan, reader, read, nu_std=UNSTATED_NU if stated.nu is None else NU_STD)
    return Made(
        kind=kind,
        seed=seed,
        sizes=sizes,
        strength=_of_noise(gel, plan, reader, sizes) if kind == FAULTLESS else law.leaves()[0],
        off_E=law.off_E,
        modulus_MPa=gel.modulus_MPa,
        nu=gel.nu,
        presses=len(plan.presses),
        radii=len(gel.radius_mm),
        noise=reader.kind,
        stated={"noise": reader.stated, "nu": stated.nu, "source": stated.depth_source, "tolerances": tolerances},
    )


def straight_law(
    gel: design.Gel, plan: Protocol, reader: noise.Reader, read: list[tuple[Array, Array]], *, nu_std: float
) -> StraightLaw:
    """Return the law at the depths that are read, and what the fault adds to its force there."""
    at = tuple(replace(press, depth_mm=w) for press, (w, _) in zip(plan.presses, read, strict=True))
    truth, near_mm = [], TOUCH * np.hypot(reader.zero_mm, reader.depth_mm)  # where a press's zero counts
    for press, (_, force) in zip(at, read, strict=True):
        clean, touching = gel.force_N(press, press.depth_mm), press.depth_mm + near_mm
        truth.append((clean, gel.slope_N_per_mm(press, touching), force - clean))
    return StraightLaw(Protocol(at, gel.thickness_mm), reader, gel.nu, truth, nu_std=-nu_std)


def _of_noise(gel: design.Gel, plan: Protocol, reader: noise.Reader, sizes: faults.Sizes) -> float:
    """Std of noise that grows: of twice the log likelihood over that of one noise for all samples in the gel."""
    variance = [
        faults.noise_factor(press, sizes) ** 2
        * (reader.force_N**2 + (reader.depth_mm * gel.slope_N_per_mm(press, press.depth_mm)) ** 2)
        for press in plan.presses
    ]
    v = np.concatenate(variance)[np.concatenate([press.depth_mm > 0 for press in plan.presses])]
    return float(np.sqrt(max(v.size * np.log(v.mean()) - np.log(v).sum(), 0.0)))


def _noisy(
    rng: np.random.Generator,
    press: Press,
    reader: noise.Reader,
    depth: Array,
    force: Array,
    sizes: faults.Sizes,
) -> tuple[Array, Array, float]:
    """What is read of one press, with samples' noise and the press's own gain and zero."""
    larger, n = faults.noise_factor(press, sizes), force.size
    zero, gain = (float(noise.student(rng, reader.heavy, 1)[0]) for _ in range(2))
    seen = force * (1 + reader.gain * gain) + reader.force_N * larger * noise.samples(rng, reader, n)
    w = depth + reader.zero_mm * zero + reader.depth_mm * larger * noise.samples(rng, reader, n)
    if reader.step_N:
        seen = np.round(seen / reader.step_N) * reader.step_N
    if step := sizes.get("step_mm"):
        w = np.round(w / step) * step
    return w, seen, 0.0
