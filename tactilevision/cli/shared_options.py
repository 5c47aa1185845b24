"""What several commands take: options, and the records that each command's record is made of."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, dataclass_transform

import typer

from tactilevision.cli import console

FigureFormat = Literal["png", "svg", "pdf"]  # plots.style.FORMS, which is slow to import
ShapeName = Literal["ball", "flat", "ridge"]  # export.shapes.ShapeName, which is slow to import
PROGRAMS = "newton, genesis, mujoco, drake, isaac, abaqus, calculix, febio"  # of export.programs, likewise
Recordings = Annotated[list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one sensor.")]
Numbers = Annotated[str | None, typer.Option(metavar="LIST", help="List numbers, with commas between.")]
Lengths = Annotated[str | None, typer.Option(metavar="LIST", help="List lengths in mm, with commas between.")]
Range = Annotated[str | None, typer.Option(metavar="VALUE", help="Give a guess, or two ends of a range: .1,.4.")]
Size = Annotated[float | None, typer.Option(help="State a length in mm; by default as the recording does.")]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="Write the results into this folder.")]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Use so many processes; by default one a core.")]
SensorOption = Annotated[
    str | None,
    typer.Option(
        help="Use a profile (.tvs) of `calibrate-sensor`; for a bare folder, name a sensor or a TOML file of one."
    ),
]
BallOption = Annotated[
    float | None,
    typer.Option(min=0.01, max=1000, help="State the radius of all balls, for ball presses without a table."),
]
PriorOption = Annotated[
    bool,
    typer.Option(
        "--prior/--no-prior", help="Restrict Poisson's ratio to that of elastomers, where nothing is stated."
    ),
]
Private = Annotated[
    list[Path] | None,
    typer.Option("--effect", metavar="FILE.py", help="Offer an effect of your own; the file is run."),
]
Seed = Annotated[int, typer.Option(min=0, max=10**9, help="Set the seed of the bootstrap and the permutations.")]


def _reached(context: typer.Context, address: str | None) -> str | None:
    """Return the address after its scheduler has answered, except while a shell completes a line."""
    if address is not None and not context.resilient_parsing:
        from tactilevision.cluster import connect

        connect.check_cluster(address)
    return address


ClusterOption = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        metavar="ADDRESS",
        callback=_reached,
        help="Use a Dask cluster: tls://HOST:PORT, or its scheduler file. It may run any program here.",
    ),
]


def check_scale(mm_per_px: float | None) -> float | None:
    """Return the value of --mm-per-px. Raises InputError for an implausible one."""
    if mm_per_px is not None:
        from tactilevision import sensors

        sensors.check_scale(mm_per_px, where="--mm-per-px")
    return mm_per_px


ScaleOption = Annotated[
    float | None,
    typer.Option(
        "--mm-per-px",
        callback=check_scale,
        help="State the scale of the (rectified) frames or the depth TIFF. That of a bare folder is else guessed.",
    ),
]

# What several commands take


@dataclass_transform(frozen_default=True, kw_only_default=True)
class Record:
    """Base that makes a frozen record of each class below it.

    `runs`: module and name of the command; `locks`: the option that names what is locked against other runs, a
    folder, or a file where " file" follows.
    """

    function: ClassVar[str]
    results: ClassVar[str]

    def __init_subclass__(cls, *, runs: str = "", locks: str = "") -> None:
        dataclass(frozen=True, kw_only=True)(cls)
        cls.function, cls.results = runs, locks


class Options(Record):
    """What every command takes."""

    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", callback=console.be_quiet, help="Print warnings alone.")
    ] = False


class WithJson(Options):
    """What a command takes whose result a program may read."""

    json: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            callback=console.to_program,
            help="Also write the result to this file as JSON; - prints it instead.",
        ),
    ] = None


class WithFigures(Options):
    """What a command takes that writes figures."""

    form: Annotated[
        FigureFormat,
        typer.Option(
            "--format", help="Also write each figure in this form. PNG is always written, and used in the report."
        ),
    ] = "png"


class WithPictures(WithFigures):
    """What a command takes that draws presses."""

    pictures: Annotated[
        Literal["all", "few", "none"],
        typer.Option("--pictures", help="Draw all presses, or a few: the rejected and the worst ones."),
    ] = "few"


class WithSensor(Options):
    """Sensor, untouched gel and scale of frames."""

    sensor: SensorOption = None
    reference: Annotated[
        Path | None,
        typer.Option(
            help="Take this frame of the untouched gel, or a folder of them. "
            "By default of a bare folder: the first."
        ),
    ] = None
    mm_per_px: ScaleOption = None


class WithLight(WithSensor):
    """Sensor, untouched gel, light and scale of frames."""

    method: Annotated[
        str | None,
        typer.Option(
            help="Use polynomial, auto, lookup, network, or a file of `train`. "
            "By default it is the best available."
        ),
    ] = None


class WithFrames(WithLight):
    """What a command takes that reads frames by a light that must be fit."""

    even_so: Annotated[
        bool, typer.Option("--even-so", help="Continue although the light's calibration fails its own balls.")
    ] = False


class WithSearch(Options):
    """What an analysis of a model takes."""

    prior: PriorOption = True
    seed: Seed = 0
    time_limit: Annotated[
        float | None,
        typer.Option(
            "--time-limit", min=1, metavar="SECONDS", help="End after so long with the best answer so far."
        ),
    ] = None
