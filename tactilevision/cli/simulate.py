"""`tactilevision simulate OUT`: a recording with known truth."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console


class Frames(StrEnum):
    """What a simulated recording holds."""

    PNG = "png"
    JPEG = "jpeg"
    CURVES = "curves"
    POINTS = "points"


def simulate(
    out: Annotated[Path, typer.Argument(help="Folder of the recording; made if missing.")],
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same recording.")] = 0,
    frames: Annotated[
        Frames, typer.Option(help="Format of the pictures; curves or points: no pictures.")
    ] = Frames.PNG,
    presses: Annotated[int | None, typer.Option(min=1, help="Good presses with each indenter.")] = None,
    youngs_modulus: Annotated[float | None, typer.Option(help="True Young's modulus in MPa.")] = None,
    poisson_ratio: Annotated[float | None, typer.Option(help="True Poisson's ratio.")] = None,
    faults: Annotated[bool, typer.Option(help="Add one bad press of every kind.")] = True,
    markers: Annotated[bool, typer.Option(help="Print markers on the gel.")] = False,
    shadows: Annotated[bool, typer.Option(help="Let the lamps, strips of 12 by 2 mm, cast shadows.")] = False,
) -> None:
    """Simulate a recording: gel, camera, rig and their faults; truth.toml says what was put in."""
    from tactilevision.synthetic import SimulationOptions, simulate as run
    from tactilevision.synthetic.strips import SHADOW_STRIP_MM

    options = SimulationOptions(frames=frames.value)
    gel = options.gel
    if youngs_modulus is not None:
        gel = replace(gel, youngs_modulus_MPa=youngs_modulus)
    if poisson_ratio is not None:
        gel = replace(gel, poisson_ratio=poisson_ratio)
    options = replace(options, gel=gel, camera=replace(options.camera, markers=markers))
    if shadows:
        options = replace(options, camera=replace(options.camera, shadow_strip_mm=SHADOW_STRIP_MM))
    if presses is not None:
        options = replace(options, presses=presses)
    if not faults:
        options = replace(options, faults=())
    with console.progress_bar("rendering") as progress:
        folder = run(out, seed=seed, options=options, progress=progress)
    console.say(f"wrote {folder}: a recording with seed {seed}; its truth is in {folder / 'truth.toml'}")
