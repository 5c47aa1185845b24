"""Slip before it happens: contacts sheared by Coulomb's law until they slide (stick_slip), read frame by frame.

Shear has the noise of followed texture, 25 um of 1.4 mm correlation length, and half of it, as the mean of four
frames. Thresholds were chosen on 100 contacts of seed 7; figures are quoted on others. Then balls are held below
half the limit on a gel that creeps: `creep` of the force relaxes at rest.

python -m benchmarks.slip [contacts] [seed]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence

import numpy as np

from benchmarks.force_cases import Forward, View, at_camera, noise
from benchmarks.stick_slip import KINDS, Hold, Layer, draw, load
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

VIEW = View((120, 160), 0.171, 1)
GEL, MATERIAL = Gel(3.0), Material(0.2, 0.48)
LINEAR = ForceSettings(large_depth=False, cell_std=False)  # the planted gel is linear
TEXTURE_MM, ALIKE_MM, DEPTH_MM = 0.025, 1.4, 0.005  # noise of shear, its correlation length, noise of depth
LEVELS = {"mean of 4 frames": 0.5, "one frame": 1.0}
ORDER = ("ball", "flat punch", "ball", "rounded punch")  # of four contacts; every other second ball never slips
WIDEST_MM = 3.9  # of the places that touch, from the axis
CREEP = (0.1, 0.3)  # of the force that relaxes: usual, and the most that a diagnosis expects
HELD = 10  # contacts held for each 100 that are sheared


def contact(number: int, seed: int, layer: Layer, forward: Forward, field: ForceField) -> Iterator[Floats]:
    """Rows: number, kind (3: never slips), level, true share, told, friction over the true one, share, flagged,
    lagging cells, motion in mm."""
    rng = np.random.default_rng([seed, number])
    kind, stuck = ORDER[number % 4], number % 8 == 2
    one, ended = draw(rng, kind, VIEW, stuck=stuck), 0
    for state in load(layer, one):
        if state.moved_mm == 0 or ended == 2:
            continue
        ended += state.share > 0.985
        u = forward(state.traction)
        for level, part in enumerate(LEVELS.values()):
            slip = _read(field, u, part, rng)
            if slip is not None:
                share = 0.0 if stuck else state.share
                true = np.nan if stuck else one.friction
                number_of = len(KINDS) if stuck else KINDS.index(kind)
                yield np.array([number, number_of, level, share, *slip / (1, true, 1, 1, 1), state.moved_mm])


def _read(field: ForceField, u: Floats, part: float, rng: np.random.Generator) -> Floats | None:
    """Whether it is told, friction, load share, whether flagged, lagging cells."""
    everywhere, scale, std = np.ones(VIEW.shape, dtype=bool), (VIEW.mm_per_px,) * 2, part * TEXTURE_MM
    off = noise(VIEW, std_mm=std, rng=rng, correlation_mm=ALIKE_MM)
    depth = at_camera(u, VIEW) + DEPTH_MM * rng.standard_normal(VIEW.shape)
    height = HeightMap(depth, everywhere, scale, std_mm=np.full(VIEW.shape, DEPTH_MM))
    alike = ALIKE_MM / VIEW.mm_per_px
    found = field(
        height, ShearMap(u[0] + off[0], u[1] + off[1], everywhere, scale, std_mm=std, correlation_px=alike)
    )
    if not found.patches:
        return None
    slip = max(found.patches, key=lambda patch: patch.wrench.force_N[2]).slip
    assert slip is not None
    return np.array([not slip.why, slip.friction, slip.load_share, slip.imminent, slip.lagging], dtype=float)


def held(number: int, seed: int, layer: Layer, forward: Forward, field: ForceField) -> Iterator[Floats]:
    """Rows: creep, level, whether it sticks wholly, true share, flagged, of a ball held while gel creeps."""
    rng = np.random.default_rng([seed, number, 1])
    stuck, creep = bool(number % 2), CREEP[number // 2 % 2]
    hold = Hold(rng.uniform(0.2, 0.45), by_force=bool(number // 4 % 2), relaxes=creep)
    one = draw(rng, "ball", VIEW, stuck=stuck)
    for state in list(load(layer, one, hold))[-hold.steps :]:
        u = forward(state.traction)
        for level, part in enumerate(LEVELS.values()):
            slip = _read(field, u, part, rng)
            if slip is not None:
                yield np.array([creep, level, stuck, 0.0 if stuck else state.share, slip[3]])


def report(rows: Floats) -> None:
    """Print the table."""
    for level, name in enumerate(LEVELS):
        print(f"{name}: shear off by {1e3 * TEXTURE_MM * list(LEVELS.values())[level]:.1f} um")
        for kind, said in enumerate((*KINDS, "ball that never slips")):
            part = rows[(rows[:, 2] == level) & (rows[:, 1] == kind)]
            if len(part):
                _say(said, part)


def report_held(rows: Floats) -> None:
    """Print what is flagged while gel creeps."""
    for creep in CREEP:
        for level, name in enumerate(LEVELS):
            part = rows[(rows[:, 0] == creep) & (rows[:, 1] == level)]
            stuck, below = part[:, 2] > 0, (part[:, 2] == 0) & (part[:, 3] < 0.5)
            flagged = part[:, 4] > 0
            print(
                f"{creep:.0%} creep, {name}: flagged {flagged[stuck].sum()} of {stuck.sum()} that stick, "
                f"{flagged[below].sum()} of {below.sum()} that slip below half the limit"
            )


def _say(said: str, part: Floats) -> None:
    share, told, friction, flagged = part[:, 3], part[:, 4] > 0, part[:, 5], part[:, 7] > 0
    early, late = share < 0.5, share >= 0.8
    contacts = np.unique(part[:, 0])
    print(f"    {said}: {len(contacts)} contacts; flagged below half: {flagged[early].sum()} of {early.sum()}")
    if not late.any():
        return
    known, leads, by = (share >= 0.75) & np.isfinite(friction), [], []
    for number in contacts:
        own = part[:, 0] == number
        first, slid = own & flagged & ~early, own & (share > 0.985)
        if (own & late).any():
            by.append(flagged[own & ~early & ~late].any() or flagged[own & late][0])
        if first.any() and slid.any():
            leads.append(1 - part[first, 9].min() / part[slid, 9].min())
    off = np.sqrt(np.mean((friction[known] - 1) ** 2)) if known.any() else np.nan
    silent = (~told)[late].mean()
    print(f"        flagged by the first frame from .8 on: {np.mean(by):.0%} of contacts; frames from .8: flagged")
    print(
        f"        {flagged[late].mean():.0%} of {late.sum()}, cannot tell {silent:.0%}; mu from .75 on off by ",
        end="",
    )
    print(f"{off:.1%} rms ({known.sum()} frames); lead {np.median(leads) if leads else np.nan:.0%} of the motion")


def main(arguments: Sequence[str]) -> None:
    """Print everything."""
    contacts, seed = map(int, [*arguments, "300", "79"][:2]) if len(arguments) != 1 else (int(arguments[0]), 79)
    rows, creeping = read(range(contacts), seed=seed)
    report(rows)
    report_held(creeping)


def read(numbers: Sequence[int], *, seed: int) -> tuple[Floats, Floats]:
    """Rows of `contact`, and those of `held` for fewer contacts."""
    forward = Forward(VIEW, GEL, MATERIAL)
    layer = Layer(VIEW, forward, WIDEST_MM)
    field = ForceField(GEL, MATERIAL, (VIEW.mm_per_px,) * 2, view_px=VIEW.shape, settings=LINEAR)
    every = layer, forward, field
    rows = np.array([row for number in numbers for row in contact(number, seed, *every)])
    few = range(max(2, len(numbers) * HELD // 100))
    return rows, np.array([row for number in few for row in held(number, seed, *every)])


def quick() -> None:
    rows, creeping = read(range(2), seed=79)
    report(rows)
    report_held(creeping)


if __name__ == "__main__":
    main(sys.argv[1:])
