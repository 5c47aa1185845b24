"""`tactilevision export RECORDING --depth FOLDER --out FILE`: depth and force as a log of ROS."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console, source


def export_log(
    path: Annotated[
        Path, typer.Argument(metavar="RECORDING", help="The recording that the frames' times are in.")
    ],
    out: Annotated[Path, typer.Option("--out", help="FILE.mcap, FILE.bag (ROS 1), or a ROS 2 folder to make.")],
    depth: Annotated[Path | None, typer.Option(help="The folder that `tactilevision depth` wrote.")] = None,
    force: Annotated[Path | None, typer.Option(help="The folder that `tactilevision force` wrote.")] = None,
    sensor: source.SensorOption = None,
    frame_id: Annotated[str, typer.Option(help="Frame of reference of all messages.")] = "gel_pad",
    json: console.JsonOption = None,
) -> None:
    """Write depth (Image, 32FC1, metres) and force (WrenchStamped) into a log. No ROS is needed."""
    from tactilevision.logs.export import export_log

    found = export_log(source.Choice(sensor).open(path), out, depth=depth, force=force, frame_id=frame_id)
    console.say(f"{found.depths} height maps and {found.wrenches} wrenches: {out}")
    if found.without:
        console.warn([f"{found.without} frames have no height map in {depth}"])
    console.hand_over(asdict(found), json)
