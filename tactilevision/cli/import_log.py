"""`tactilevision import LOG --frames TOPIC --out RECORDING`: a robot's log into a recording."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console
from tactilevision.cli.source import check_scale
from tactilevision.errors import InputError
from tactilevision.logs.clocks import Clock


def import_log(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="A .bag, .db3 or .mcap file, or a ROS 2 bag's folder.")
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder of the recording; made if missing.")],
    frames: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="Pictures: Image or CompressedImage; the only such topic if left out."),
    ] = None,
    wrench: Annotated[str | None, typer.Option(metavar="TOPIC", help="Forces: WrenchStamped.")] = None,
    clock: Annotated[Clock, typer.Option(help="Times of the headers, or those of the log.")] = Clock.HEADER,
    sensor: Annotated[str | None, typer.Option(help="Its kind's name, or its profile (.tvs).")] = None,
    mm_per_px: Annotated[
        float | None, typer.Option("--mm-per-px", callback=check_scale, help="Scale of the frames.")
    ] = None,
    rotation: Annotated[
        str | None, typer.Option(metavar="LIST", help="Nine numbers: the frame's x, y, z in the wrench's axes.")
    ] = None,
    json: console.JsonOption = None,
) -> None:
    """Turn a log of ROS 1, ROS 2 or MCAP into a recording: frames, forces and their times. No ROS is needed."""
    from tactilevision.logs.read import ImportSettings, import_log, the_picture_topic

    turn = _rotation(rotation)
    frames = frames or the_picture_topic(log)
    settings = ImportSettings(frames, wrench, clock, sensor, mm_per_px, turn)
    found = import_log(log, out, settings)
    console.say(
        f"{found.frames} frames of {frames} over {found.seconds:.3f} s, {found.readings} readings of force: {out}"
    )
    if sensor is None:
        console.warn(["recording.toml names no sensor: give --sensor, or add its kind under [sensor]"])
    console.warn(found.warnings)
    console.hand_over(asdict(found), json)


def _rotation(text: str | None) -> tuple[tuple[float, float, float], ...] | None:
    import numpy as np

    from tactilevision.recording.series import turns

    if text is None:
        return None
    try:
        a, b, c, d, e, f, g, h, i = (float(part) for part in text.split(","))
    except ValueError as fault:
        raise InputError("nine numbers with commas between are needed", where="--rotation", value=text) from fault
    rows = (a, b, c), (d, e, f), (g, h, i)
    if not turns(np.array(rows)):
        raise InputError(
            "these nine numbers do not turn without stretching",
            where="--rotation",
            value=text,
            remedy="Rows have length 1 and stand at right angles: the picture's x, y and z in the wrench's axes.",
        )
    return rows
