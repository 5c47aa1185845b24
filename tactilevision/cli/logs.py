"""Commands `import`, `export` and `lerobot`: robots' logs and data sets."""

from __future__ import annotations

from dataclasses import asdict

from tactilevision.cli import console, options, source
from tactilevision.profile.sensor import load_sensor
from tactilevision.robots import log_export, log_import as imports
from tactilevision.robots.lerobot import annotate
from tactilevision.robots.lerobot_dataset import read_dataset
from tactilevision.robots.messages import Clock


def import_log(given: options.ImportLog) -> None:
    """Convert a log of ROS 1, ROS 2 or MCAP to a recording: frames, forces and their times. No ROS is needed."""
    turn = None if given.rotation is None else imports.parse_rotation(given.rotation)
    frames, clock = given.frames or imports.the_picture_topic(given.log), Clock(given.clock)
    settings = imports.ImportSettings(frames, given.wrench, clock, given.sensor, given.mm_per_px, turn)
    found = imports.import_log(given.log, given.out, settings)
    forces = f"{found.readings} readings of force"
    console.say(f"{found.frames} frames of {frames} over {found.seconds:.3f} s, {forces}: {given.out}")
    console.say(*found.not_taken)
    if given.sensor is None:
        console.warn(["recording.toml names no sensor: give --sensor, or add its kind under [sensor]"])
    console.warn(found.warnings)
    console.hand_over(asdict(found), given.json)


def export_log(given: options.ExportLog) -> None:
    """Write depth (Image, 32FC1, metres), force (WrenchStamped) and tractions (PointCloud2, Pa) to a log."""
    recording, added = source.Choice(given.sensor).open(given.path), {"depth": given.depth, "force": given.force}
    found = log_export.export_log(recording, given.out, **added, frame_id=given.frame_id)
    counts = f"{found.depths} height maps, {found.wrenches} wrenches, {found.tractions} traction maps"
    console.say(f"{counts}: {given.out}")
    if found.without:
        console.warn([f"{found.without} frames have no height map in {given.depth}"])
    console.hand_over(asdict(found), given.json)


def lerobot(given: options.Lerobot) -> None:
    """Write a data set with depth, contact and force added; frames are unchanged."""
    source, reader = read_dataset(given.dataset, given.camera), load_sensor(given.sensor)
    with console.progress_bar("frames") as progress:
        native = given.depth == "native"
        found = annotate(source, reader, given.out, shrink=given.shrink, native=native, progress=progress)
    console.say(f"{found.frames} frames of {found.episodes} episodes, {found.in_contact} in contact: {given.out}")
    console.say("new features: " + ", ".join(found.features))
    unread = [f"{found.not_read} frames were not read: see their flags"] if found.not_read else []
    console.warn([*found.warnings, *unread])
    console.hand_over(asdict(found), given.json)
