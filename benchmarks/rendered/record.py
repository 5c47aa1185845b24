"""A whole recording under one rig: the simulator's presses, forces and clocks, seen by the rendered camera.

Presses of one indenter share their place and stand level, so that their depths are rendered once; the bad presses
whose fault is seen (tilt, footprint, border) are rendered by themselves. truth.toml is the simulator's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from benchmarks.rendered.camera import RenderedCamera
from benchmarks.rendered.families import Rig, stream
from benchmarks.rendered.sets import draw_gel, truth_of
from tactilevision.synthetic import simulation as writing
from tactilevision.synthetic.camera import CameraOptions
from tactilevision.synthetic.options import FAULTS, IndenterOptions, RigOptions, SimulationOptions
from tactilevision.synthetic.scenario import Scenario, draw_scenario
from tactilevision.synthetic.simulation import write_scenario

RENDERING = "rendering.toml"


def write_rendered_recording(
    folder: Path,
    camera: RenderedCamera,
    *,
    presses: int = 3,
    balls: int = 24,
    faults: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a recording as `tactilevision simulate` does; what was drawn of the rig is in rendering.toml."""
    options = recording_options(camera.rig, presses=presses, balls=balls, faults=faults)
    scenario = share_places(
        draw_scenario(options, int(stream(camera.rig.family, camera.rig.seed, 5).integers(2**31)))
    )
    write_scenario(folder, scenario, camera=camera, progress=progress)
    writing.write_toml(folder / RENDERING, truth_of(camera))


def recording_options(rig: Rig, *, presses: int, balls: int, faults: bool) -> SimulationOptions:
    """The protocol of the simulator's own recordings on the rig's gel."""
    rng = stream(rig.family, rig.seed, 8)
    optics = CameraOptions(
        width_px=rig.width_px,
        height_px=rig.height_px,
        mm_per_px=(rig.mm_per_px, rig.mm_per_px),
        light_seed=rig.seed,
        distortion_px=0.0,
    )
    return SimulationOptions(
        name=f"rendered-{rig.family}-{rig.seed}",
        date="2026-11-23",
        gel=draw_gel(rig),
        camera=optics,
        indenters=IndenterOptions(edge_radius_mm=round(float(rng.uniform(0.04, 0.07)), 4)),
        rig=RigOptions(tilt_std=0.0),
        presses=presses,
        faults=FAULTS if faults else (),
        balls=balls,
    )


def share_places(scenario: Scenario) -> Scenario:
    """The scenario with every press of an indenter, but for those at the border, where its first good one is."""
    places = {press.indenter: press.centre_mm for press in reversed(scenario.presses) if not press.fault}
    moved = (
        press if press.fault == "border" else replace(press, centre_mm=places.get(press.indenter, press.centre_mm))
        for press in scenario.presses
    )
    return replace(scenario, presses=tuple(moved))
