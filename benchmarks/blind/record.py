"""Writes what was read as a recording, and what is true beside it."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from benchmarks.blind import figures
from benchmarks.blind.design import Design
from benchmarks.blind.rig import Noise, Reads
from benchmarks.blind.signal import NU_STD, beta_of
from benchmarks.blind.world import HIDDEN, World
from tactilevision.files.writing import write_text
from tactilevision.recording.model import Recording
from tactilevision.recording.write import write_recording
from tactilevision.records.measured import Curve
from tactilevision.records.rig import Gel, Indenter, Press, Sensor

FIRST_DAY = datetime.date(2026, 11, 2)


def write(
    folder: Path, world: World, design: Design, reads: Reads, *, noise: Noise, name: str, nu_stated: float
) -> None:
    """A recording of curves, and truth.toml, which only the scorer opens."""
    radii = sorted({t.radius_mm for t in design.touches})
    gel = Gel(
        world.thickness_mm,
        shape="disc",
        radius_mm=world.pad_radius_mm,
        poisson_ratio=round(nu_stated, 4),
        poisson_ratio_std=NU_STD,
    )
    std = noise.sample_N
    folder.mkdir(parents=True, exist_ok=True)
    write_recording(
        Recording(
            path=folder,
            name=name,
            date=FIRST_DAY,
            sensor=Sensor("custom", 400, 300, (0.06, 0.06), gel=gel),
            force_std_N=(std, std, std),
            depth_source=world.source,  # type: ignore[arg-type]
            indenters={f"R{10 * a:.0f}": Indenter(f"R{10 * a:.0f}", radius_mm=a) for a in radii},
            presses=tuple(_press(design, reads, row) for row in range(len(design.touches))),
            curves=tuple(_curve(world, design, reads, row) for row in range(len(design.touches))),
        )
    )
    write_text(folder / "truth.toml", tomli_w.dumps(truth_of(world, radii)))


def truth_of(world: World, radii: list[float]) -> dict[str, Any]:
    """Material under the names of calibration.json, and one table for each hidden effect."""
    main = radii[len(radii) // 2]
    c = figures.slope_N_per_mm(world.modulus_MPa, world.nu, np.array(main), np.array(world.thickness_mm))
    hidden = {
        key: {"amount": float(size), "unit": HIDDEN[key].unit, "catalogued": HIDDEN[key].catalogued}
        for key, size in world.amounts.items()
        if size
    }
    return {
        "youngs_modulus_MPa": world.modulus_MPa,
        "poisson_ratio": world.nu,
        "beta": beta_of(world, main),
        "c_N_per_mm": float(c),
        "thickness_mm": world.thickness_mm * (1 + world.amount("thickness")),
        "hidden": hidden,
        "shapes": dict(world.shapes) if hidden else {},
    }


def _press(design: Design, reads: Reads, row: int) -> Press:
    touch = design.touches[row]
    date = FIRST_DAY + datetime.timedelta(days=touch.day)
    rich = design.name == "rich"
    return Press(
        press=f"p{row + 1:02d}",
        indenter=f"R{10 * touch.radius_mm:.0f}",
        start_s=float(reads.time_s[row, 0]),
        end_s=float(reads.time_s[row, -1]),
        target_depth_mm=touch.target_mm,
        rest_s=touch.rest_s,
        speed_mm_s=touch.speed_mm_s,
        hold_s=touch.hold_s,
        x_mm=touch.place_mm[0] if rich else np.nan,
        y_mm=touch.place_mm[1] if rich else np.nan,
        temperature_C=touch.temperature_C if rich else np.nan,
        date=date.isoformat() if rich else "",
    )


def _curve(world: World, design: Design, reads: Reads, row: int) -> Curve:
    seen = {"reconstructed_depth_mm": reads.seen_mm[row].round(6)} if world.source == "gauge" else {}
    stage = reads.depth_mm[row].round(6) if world.source == "stage" else None
    return Curve(
        press=f"p{row + 1:02d}",
        time_s=reads.time_s[row],
        depth_mm=reads.depth_mm[row].round(6),
        force_N=reads.force_N[row].round(6),
        phase=np.array(reads.phase),
        z_mm=stage,
        extra=seen,
    )
