"""Draws cases: what is hidden in which design under which noise, sized to show but not to shout."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.blind.design import DESIGNS, Design
from benchmarks.blind.record import write
from benchmarks.blind.rig import Noise, add_noise, read
from benchmarks.blind.signal import NU_STD, Stage, apart, set_stage, sized
from benchmarks.blind.world import HIDDEN, World, draw_world
from tactilevision.records.measured import Floats

LEVELS = {"half": 0.5, "one": 1.0, "double": 2.0}
STRENGTH = (9.0, 20.0)  # the targets are stated for signals above 8
SEEN = 8.0
RIVALS = (0.25, 1.0)  # shares of an effect's range at which a rival's signal is looked at


@dataclass(frozen=True, slots=True)
class Case:
    """One recording to be made. `hidden` keys; `gel` law (a straight bracket) or fem (as computed)."""

    seed: int
    hidden: tuple[str, ...] = ()
    design: str = "rich"
    level: str = "one"
    noise: str = "white"
    gel: str = "law"
    source: str = ""

    @property
    def name(self) -> str:
        """The folder's name; it does not say what is hidden."""
        return f"{self.design}-{self.level}-{self.noise}-{self.gel}-{self.seed:05d}"


@dataclass(frozen=True, slots=True)
class Made:
    """A case that was made: the world behind it, how strongly each hidden effect shows, and its rivals.

    `rivals` are catalogued effects whose signal, at any size, stays within 3 sigma of the hidden one's.
    """

    case: Case
    folder: Path
    world: World
    strength: dict[str, float]
    rivals: tuple[str, ...]


def make(case: Case, folder: Path, *, rivals: bool = True) -> Made:
    """Draw the world, size what is hidden, add noise, write the recording."""
    rng = np.random.default_rng([20261121, case.seed])
    design = DESIGNS[case.design](rng)
    noise = Noise(kind=case.noise).times(LEVELS[case.level])
    world, stage, strength = draw(case, design, noise, rng)
    reads = add_noise(read(world, design), noise, rng)
    nu_stated = float(np.clip(world.nu + NU_STD * rng.standard_normal(), 0.45, 0.495))  # as far off as is stated
    write(folder / case.name, world, design, reads, noise=noise, name=case.name, nu_stated=nu_stated)
    found = _rivals(stage, world, case.hidden) if rivals and len(case.hidden) == 1 else ()
    return Made(case, folder / case.name, world, strength, found)


def draw(
    case: Case, design: Design, noise: Noise, rng: np.random.Generator
) -> tuple[World, Stage, dict[str, float]]:
    """The world of a case, its stage, and how strongly each hidden effect shows in it."""
    world = draw_world(rng, straight=case.gel == "law")
    sources = {HIDDEN[key].source for key in case.hidden} - {"vision"}
    world = replace(world, source=case.source or (sources.pop() if sources else "vision"))
    stage = set_stage(world, design, noise)
    for key in case.hidden:
        sign = -1.0 if HIDDEN[key].signed and rng.random() < 0.5 else 1.0
        wanted = float(np.exp(rng.uniform(*np.log(STRENGTH))))
        world = sized(stage, world.with_amount(key, sign * HIDDEN[key].low), key, wanted)
    strength = {}
    for key in case.hidden:
        alone = replace(world, amounts={key: world.amount(key)})
        strength[key] = stage.strength(alone)
    return world, stage, strength


def signal_of(stage: Stage, world: World, key: str) -> Floats:
    """What one hidden effect alone adds, white and freed of what the law absorbs."""
    return stage.signal(replace(world, amounts={key: world.amount(key)}))


def _rivals(stage: Stage, world: World, hidden: tuple[str, ...]) -> tuple[str, ...]:
    key = hidden[0]
    target = signal_of(stage, world, key)
    found = []
    for other, about in HIDDEN.items():
        if other == key or not about.catalogued or not _testable(about.source, about.certified, stage):
            continue
        sizes = [s * about.high * share for share in RIVALS for s in ((1.0, -1.0) if about.signed else (1.0,))]
        signals = [stage.signal(replace(world, amounts={other: size})) for size in sizes]
        if min(apart(target, signal) for signal in signals) < 3:
            found.append(other)
    return tuple(found)


def _testable(source: str, certified: bool, stage: Stage) -> bool:
    here = stage.world.source
    return here in ("vision", "gauge") if certified else source in ("vision", here)
