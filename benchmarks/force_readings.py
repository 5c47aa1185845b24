"""Recordings of `force` next to a force/torque sensor, with faults, made by the exact layer.

A press is a mixture of Hertz patches that grow with its force; the camera sees their displacement by one transform
of the whole plane (`force_cases`), and the sensor reads the integral of the traction. Only the forces "by the
picture" are those of the inverse step: it is what is compared.

    python -m benchmarks.force_readings [FOLDER]       writes the sample hidden_force
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import tomli_w

from benchmarks.force_cases import Forward, View, at_camera
from tactilevision.files.writing import write_text
from tactilevision.force.comparison import write_comparison
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.force.frame import FrameForce, Solved, as_force
from tactilevision.recording.model import Recording
from tactilevision.records.maps import Frame, HeightMap, ShearMap
from tactilevision.records.measured import Floats, Material, Pair
from tactilevision.records.rig import Gel, Indenter, Press, Sensor
from tactilevision.records.wrench import triple

VIEW = View((90, 120), 0.171, 4)
SCALE = (VIEW.mm_per_px, VIEW.mm_per_px)
GEL, MATERIAL = Gel(3.0), Material(0.2, 0.48)
SEED = 20261129
FRAMES_A_SECOND = 6.0  # of the camera
HOLD_S = 1.5  # at the deepest point
LEVELS = 4  # forces of a press at which maps are made
LEAST_SHARE = 0.03  # of the deepest force: below it nothing is seen to touch
BEYOND_PX = 24  # of gel beyond each border of the view, where a contact is cut by it
PIXEL_MM = 0.004  # std of a pixel's depth, as stated


@dataclass(frozen=True)
class Kind:
    """One press: patch radius and place (mm), deepest force over E (mm²), seconds of its ramp."""

    radius_mm: float
    place_mm: Pair
    force_over_E: float
    ramp_s: float


@dataclass(frozen=True)
class Truth:
    """What is hidden: E and h over the stated ones, F/T clock minus camera clock, share that relaxes and its time
    constant, a force read in air, and the gain of the height map.
    """

    modulus: float = 1.0
    thickness: float = 1.0
    clock_s: float = 0.0
    relaxes: float = 0.0
    tau_s: float = 1.0
    bias_N: float = 0.0
    map_gain: float = 0.0


@dataclass(frozen=True)
class Noise:
    """Std of one frame's force by the picture and of one reading (N), of one frame's depth (mm), and of a press:
    gain of its height maps, and their zero (mm).
    """

    picture_N: float = 0.0015
    reading_N: float = 0.002
    depth_mm: float = 0.001
    gain: float = 0.004
    zero_mm: float = 0.002


PROTOCOL = tuple(
    Kind(radius, place, 0.35 * radius**1.5, ramp)
    for radius, place, ramp in (
        (1.0, (0.0, 0.0), 1.5), (1.6, (-3.0, 1.5), 0.8), (2.4, (2.5, -1.0), 3.0), (1.6, (3.5, 2.0), 1.5),
        (1.0, (-4.0, -2.5), 0.5), (2.4, (-1.5, 0.5), 0.8), (1.0, (2.0, -3.0), 3.0), (1.6, (0.5, 2.5), 0.5),
        (2.4, (0.5, -0.5), 1.5),
    )
)  # fmt: skip


@cache
def moved(kind: Kind, thickness_mm: float, grows: bool) -> Floats:
    """Displacement (LEVELS, 3, H, W) in mm by forces that rise evenly to the deepest one."""
    inside = bool((np.abs(kind.place_mm) + kind.radius_mm < np.array(VIEW.size_mm) / 2).all())
    more = 0 if inside else BEYOND_PX
    view = replace(VIEW, shape=(VIEW.shape[0] + 2 * more, VIEW.shape[1] + 2 * more))
    forward = Forward(view, replace(GEL, thickness_mm=thickness_mm), replace(MATERIAL, youngs_modulus_MPa=1.0))
    x, y = view.mesh()
    square, fields = (x - kind.place_mm[0]) ** 2 + (y - kind.place_mm[1]) ** 2, list[Floats]()
    for share in np.arange(1, LEVELS + 1) / LEVELS:
        if fields and not grows:
            fields.append((len(fields) + 1) * fields[0])
            continue
        radius = kind.radius_mm * (share ** (1 / 3) if grows else 1.0)
        shape = np.sqrt(np.clip(1 - square / radius**2, 0, None))
        shape *= share * kind.force_over_E / (shape.sum() * (VIEW.mm_per_px / VIEW.fine) ** 2)
        whole = forward(np.stack([0 * shape, 0 * shape, shape]))
        fields.append(whole[:, more : more + VIEW.shape[0], more : more + VIEW.shape[1]])
    return np.stack(fields)


@cache
def solved(kind: Kind, thickness_mm: float, grows: bool) -> tuple[tuple[Solved, FrameForce], ...]:
    """The step that is compared, on maps of each level without noise."""
    field, everywhere = step(), np.ones(VIEW.shape, dtype=bool)
    found = []
    for u in moved(kind, thickness_mm, grows):
        height = HeightMap(at_camera(u, VIEW), everywhere, SCALE, std_mm=np.full(VIEW.shape, PIXEL_MM))
        shear = ShearMap(u[0], u[1], everywhere, SCALE, std_mm=PIXEL_MM)
        traction = field(height, shear)
        found.append((Solved(height, shear, traction), as_force(traction, Frame(np.zeros((1, 1, 3), np.uint8)))))
    return tuple(found)


@cache
def step() -> ForceField:
    """The inverse step, linear as the displacements are."""
    return ForceField(GEL, MATERIAL, SCALE, view_px=VIEW.shape, settings=ForceSettings(large_depth=False))


def course(kind: Kind, time_s: Floats) -> Floats:
    """Share (n,) of the deepest elastic force at times since the touch: up, held, down."""
    end = 2 * kind.ramp_s + HOLD_S
    corners = [0, kind.ramp_s, kind.ramp_s + HOLD_S, end]
    return np.asarray(np.interp(time_s, corners, [0, 1, 1, 0], left=0, right=0))


def read(kind: Kind, truth: Truth, time_s: Floats) -> Floats:
    """Normal force (n,) in N at times since the touch, by the hereditary integral on a fine grid."""
    grid = np.linspace(0, 2 * kind.ramp_s + HOLD_S + 1, 4000)
    elastic = kind.force_over_E * MATERIAL.youngs_modulus_MPa * truth.modulus * course(kind, grid)
    kept = np.exp(-grid / truth.tau_s)
    part = np.convolve(np.gradient(elastic, grid), kept)[: grid.size] * (grid[1] - grid[0])
    force = elastic - truth.relaxes * (elastic - part)
    return np.asarray(np.interp(time_s, grid, np.maximum(force, 0), left=0, right=0))


def make(
    folder: Path,
    truth: Truth,
    *,
    noise: Noise | None = None,
    protocol: Sequence[Kind] = PROTOCOL,
    grows: bool = False,
    seed: int = SEED,
    name: str = "made",
) -> Path:
    """Write what `force` writes next to a sensor's readings, of contacts that are flat or grow as balls."""
    rng, noise = np.random.default_rng(seed), noise or Noise()
    rows, maps, presses, begin = list[FrameForce](), list[Solved](), list[Press](), 1.0
    for k, kind in enumerate(protocol):
        label, end = f"p{k + 1:02d}", begin + 2 * kind.ramp_s + HOLD_S
        times = np.arange(begin + rng.uniform(0, 1) / FRAMES_A_SECOND, end, 1 / FRAMES_A_SECOND)
        times = times[course(kind, times - begin) > LEAST_SHARE]
        levels = solved(replace(kind, ramp_s=0.0), truth.thickness * GEL.thickness_mm, grows)
        at, share = np.arange(LEVELS + 1) / LEVELS, course(kind, times - begin)
        picture, deep = (
            np.array([0.0, *values])
            for values in ([row.resultant_N[2] for _, row in levels], [row.depth_mm for _, row in levels])
        )
        force, depth, stiff = (
            np.interp(share, at, table) for table in (picture, deep, np.gradient(picture, deep))
        )
        zero, gain = noise.zero_mm * rng.standard_normal(), truth.map_gain + noise.gain * rng.standard_normal()
        force = (1 + gain) * force + zero * stiff + noise.picture_N * rng.standard_normal(times.size)
        depth = (1 + gain) * depth + zero + noise.depth_mm * rng.standard_normal(times.size)
        reading = read(kind, truth, times - truth.clock_s - begin) + truth.bias_N
        measured = np.column_stack([np.zeros((times.size, 2)), reading]) + noise.reading_N * rng.standard_normal(
            (times.size, 3)
        )
        for i, time in enumerate(times):
            level, row = levels[min(int(share[i] * LEVELS), LEVELS - 1)]
            maps.append(level)
            rows.append(
                replace(
                    row, frame=f"{len(rows):04d}", time_s=float(time), press=label, depth_mm=float(depth[i]),
                    resultant_N=(0.0, 0.0, float(force[i])), measured_N=triple(measured[i]),
                    model_std_N=abs(float(force[i])) * row.model_std_N / row.resultant_N[2],
                )
            )  # fmt: skip
        presses.append(Press(label, f"B{kind.radius_mm:g}", begin, end))
        begin = end + float(rng.uniform(2, 10))
    sensor = Sensor("custom", VIEW.shape[1], VIEW.shape[0], SCALE, gel=GEL)
    bodies = {p.indenter: Indenter(p.indenter, "sphere", float(p.indenter[1:])) for p in presses}
    recording = Recording(path=folder, name=name, sensor=sensor, presses=tuple(presses), indenters=bodies)
    written = write_comparison(
        recording,
        rows,
        step(),
        folder=folder,
        maps=lambda number: (maps[number].height, maps[number].shear),
        material_std=0.01,
    )
    assert written is not None
    return written


HIDDEN = Truth(modulus=0.88, clock_s=0.045)
README = """# hidden_force: forces by pictures next to a force sensor, and two things that changed

Nine presses of balls at nine places, as `tactilevision force` writes them: depth of the contact, force by the
picture (`picture_fz_N`, with E of an earlier calibration) and the sensor's reading, on one clock. The camera's
displacements come from the exact layer, the readings from the integral of the traction; only the forces by the
picture are the inverse step's.

No frame, force or number of a real sensor is in it. It is made again by

    python -m benchmarks.force_readings sample_frames

Something is hidden in it that the recording does not say; `truth.toml`, which only tests and benchmarks read, says
what. Find it first:

    tactilevision diagnose sample_frames/hidden_force --out diagnosis

Licence: as the project (MIT).
"""


def write_sample(arguments: Sequence[str]) -> None:
    """Write the sample in place of what is there."""
    folder = Path(arguments[0] if arguments else "sample_frames") / "hidden_force"
    shutil.rmtree(folder, ignore_errors=True)
    make(folder, HIDDEN, grows=True, name="hidden-force")
    hidden = {
        "clock_offset": {"amount": HIDDEN.clock_s, "unit": "s", "catalogued": True},
        "modulus_change": {"amount": HIDDEN.modulus - 1, "unit": "1", "catalogued": True},
    }
    E = HIDDEN.modulus * MATERIAL.youngs_modulus_MPa
    truth = {"youngs_modulus_MPa": E, "poisson_ratio": MATERIAL.poisson_ratio, "thickness_mm": GEL.thickness_mm}
    write_text(folder / "truth.toml", tomli_w.dumps({**truth, "hidden": hidden}))
    write_text(folder / "README.md", README)


if __name__ == "__main__":
    write_sample(sys.argv[1:])
