"""`tactilevision lerobot DATASET --camera KEY --sensor FILE.tvs`: depth and force beside frames."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console


def lerobot(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="A data set of LeRobot, version 3.")],
    camera: Annotated[str, typer.Option(metavar="KEY", help="The tactile camera: observation.images.tactile.")],
    sensor: Annotated[Path, typer.Option(help="The sensor's profile (.tvs).")],
    out: Annotated[Path, typer.Option("--out", help="Folder of the new data set; made if missing.")],
    shrink: Annotated[int, typer.Option(min=1, help="Depth as means of so many pixels squared.")] = 4,
    shadows: Annotated[
        bool,
        typer.Option(
            "--shadows", help="Undo what lamps cast, as `depth` does; a deep frame takes up to a second."
        ),
    ] = False,
    json: console.JsonOption = None,
) -> None:
    """Write a data set that also has depth, contact and force; frames are kept as they are."""
    from tactilevision.logs.lerobot.annotate import annotate
    from tactilevision.logs.lerobot.dataset import read_dataset
    from tactilevision.profile.sensor import load_sensor

    source, reader = read_dataset(dataset, camera), load_sensor(sensor, shadows=shadows)
    if reader.reconstructor.keeps_shadows:
        console.warn(
            ["this sensor's lamps cast shadows beside deep contacts, and they stay: --shadows undoes them"]
        )
    with console.progress_bar("frames") as progress:
        found = annotate(source, reader, out, shrink=shrink, tell=progress)
    console.say(f"{found.frames} frames of {found.episodes} episodes, {found.in_contact} in contact: {out}")
    console.say("new features: " + ", ".join(found.features))
    unread = [f"{found.not_read} frames were not read: their flags say why"] if found.not_read else []
    console.warn([*found.warnings, *unread])
    console.hand_over(asdict(found), json)
