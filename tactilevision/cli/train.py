"""`tactilevision train RECORDING`: ball presses into a photometric method with its card."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tactilevision.cli import console
from tactilevision.errors import InputError


def train(
    recording: Annotated[Path, typer.Argument(help="A recording with reference/flat and reference/ball.")],
    method: Annotated[str, typer.Option(help="polynomial or lookup.")] = "polynomial",
    out: Annotated[Path, typer.Option("--out", help="The method's file; its card lies beside it.")] = Path(
        "method.npz"
    ),
) -> None:
    """Calibrate a photometric method, to be used later with --method FILE; its card says how far it is off."""
    from tactilevision.photometric.method import CalibratedMethod
    from tactilevision.photometric.storage import save_method
    from tactilevision.reconstruct import build_reconstructor
    from tactilevision.recording import read_recording

    source = read_recording(recording)
    with console.progress_bar("calibrating the light"):
        made = build_reconstructor(source, method)
    console.warn([*source.warnings, *made.warnings])
    if not isinstance(made.method, CalibratedMethod):
        raise InputError("is not made from ball presses", where="--method", value=method)
    path = save_method(made.method, out)
    console.say(f"wrote {path} and {path.with_suffix('.json')}")
    console.say(
        *(f"  {name}: {value}" for name, value in made.method.card.items() if not isinstance(value, dict | list))
    )
