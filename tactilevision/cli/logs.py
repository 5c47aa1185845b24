"""Commands `import`, `export` and `lerobot`: robots' logs and data sets."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

from tactilevision.cli import console, source
from tactilevision.profile.sensor import load_sensor
from tactilevision.robots import log_export, log_import as imports
from tactilevision.robots.lerobot import annotate
from tactilevision.robots.lerobot_dataset import read_dataset
from tactilevision.robots.messages import Clock


def import_log(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="A .bag, .db3 or .mcap file, or a ROS 2 bag's folder.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Write the recording into this folder.")],
    frames: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="Read pictures from this topic; by default the only such one."),
    ] = None,
    wrench: Annotated[str | None, typer.Option(metavar="TOPIC", help="Read WrenchStamped from here.")] = None,
    clock: Annotated[Clock, typer.Option(help="Take times of the headers or of the log.")] = Clock.HEADER,
    sensor: Annotated[str | None, typer.Option(help="Name the kind of sensor, or its profile (.tvs).")] = None,
    mm_per_px: source.ScaleOption = None,
    rotation: Annotated[
        str | None, typer.Option(metavar="LIST", help="Give the frame's x, y, z in the wrench's axes.")
    ] = None,
    json: console.JsonOption = None,
) -> None:
    """Convert a log of ROS 1, ROS 2 or MCAP to a recording: frames, forces and their times. No ROS is needed."""
    turn = None if rotation is None else imports.parse_rotation(rotation)
    frames = frames or imports.the_picture_topic(log)
    settings = imports.ImportSettings(frames, wrench, clock, sensor, mm_per_px, turn)
    found = imports.import_log(log, out, settings)
    console.say(
        f"{found.frames} frames of {frames} over {found.seconds:.3f} s, {found.readings} readings of force: {out}"
    )
    console.say(*found.not_taken)
    if sensor is None:
        console.warn(["recording.toml names no sensor: give --sensor, or add its kind under [sensor]"])
    console.warn(found.warnings)
    console.hand_over(asdict(found), json)


def export_log(
    path: Annotated[Path, typer.Argument(metavar="RECORDING", help="The recording, which has the frames' times.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Write FILE.mcap, FILE.bag or a ROS 2 folder.")],
    depth: Annotated[Path | None, typer.Option(help="Take what `tactilevision depth` wrote.")] = None,
    force: Annotated[Path | None, typer.Option(help="Take what `tactilevision force` wrote.")] = None,
    sensor: source.SensorOption = None,
    frame_id: Annotated[str, typer.Option(help="Name the frame of reference of all messages.")] = "gel_pad",
    json: console.JsonOption = None,
) -> None:
    """Write depth (Image, 32FC1, metres), force (WrenchStamped) and tractions (PointCloud2, Pa) to a log.

    No ROS is needed.
    """
    found = log_export.export_log(
        source.Choice(sensor).open(path), out, depth=depth, force=force, frame_id=frame_id
    )
    console.say(f"{found.depths} height maps, {found.wrenches} wrenches, {found.tractions} traction maps: {out}")
    if found.without:
        console.warn([f"{found.without} frames have no height map in {depth}"])
    console.hand_over(asdict(found), json)


def lerobot(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="A data set of LeRobot, version 3.")],
    camera: Annotated[str, typer.Option(metavar="KEY", help="Name it: observation.images.tactile.")],
    sensor: Annotated[Path, typer.Option(help="Use this profile (.tvs) of the sensor.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Write the data set into this folder.")],
    shrink: Annotated[int, typer.Option(min=1, help="Average depth over so many pixels each way.")] = 4,
    depth: Annotated[
        Literal["table", "native"],
        typer.Option(help="Store depth as a column in mm, or as LeRobot's own depth map (0.6 or newer) and mask."),
    ] = "table",
    json: console.JsonOption = None,
) -> None:
    """Write a data set with depth, contact and force added; frames are unchanged."""
    source, reader = read_dataset(dataset, camera), load_sensor(sensor)
    with console.progress_bar("frames") as progress:
        found = annotate(source, reader, out, shrink=shrink, native=depth == "native", progress=progress)
    console.say(f"{found.frames} frames of {found.episodes} episodes, {found.in_contact} in contact: {out}")
    console.say("new features: " + ", ".join(found.features))
    unread = [f"{found.not_read} frames were not read: see their flags"] if found.not_read else []
    console.warn([*found.warnings, *unread])
    console.hand_over(asdict(found), json)
