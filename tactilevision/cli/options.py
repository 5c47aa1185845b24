"""What each command takes: records whose fields are typer's parameters, so that help imports no command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from tactilevision.cli.shared_options import (
    PROGRAMS,
    BallOption,
    ClusterOption,
    Lengths,
    Numbers,
    Options,
    OutOption,
    PriorOption,
    Private,
    Range,
    Recordings,
    ScaleOption,
    Seed,
    SensorOption,
    ShapeName,
    Size,
    WithFigures,
    WithFrames,
    WithJson,
    WithLight,
    WithPictures,
    WithSearch,
    WithSensor,
    WorkersOption,
)

# Height maps and forces


class Depth(WithFrames, WithJson, runs="depth.depth", locks="out"):
    """Turn frames into height maps: depth/NAME.tiff in mm (float32, NaN where invalid), and depth.csv."""

    path: Annotated[Path, typer.Argument(help="A recording, video, frame, folder of frames, or a tree of these.")]
    out: OutOption = Path("depth_out")
    calibration: Annotated[
        Path | None,
        typer.Option(exists=True, dir_okay=False, help="Correct faces by calibration.json of this recording."),
    ] = None
    form: Annotated[
        Literal["tiff", "zarr"], typer.Option("--format", help="Write one TIFF a frame, or one Zarr store.")
    ] = "tiff"
    with_std: Annotated[bool, typer.Option("--std", help="Also write the depths' std, into depth_std/.")] = False
    workers: WorkersOption = None
    cluster: ClusterOption = None
    device: Annotated[
        str | None,
        typer.Option(
            metavar="cpu|cuda|auto", help="Read frames in batches with torch; auto: on a GPU if there is one."
        ),
    ] = None
    pictures: Annotated[int, typer.Option(min=0, help="Draw so many of the deepest.")] = 3


class View(WithLight, runs="view.view", locks="out"):
    """Draw a height map: from above with contours, cut, in perspective, its normals, and over its frame."""

    path: Annotated[
        Path, typer.Argument(help="A depth TIFF, what `depth` wrote, or a recording, video, frame or folder.")
    ]
    out: OutOption = Path("view_out")
    frame: Annotated[str | None, typer.Option(help="Show this frame; by default the deepest of a few.")] = None
    minus: Annotated[str | None, typer.Option(help="Also draw the difference to this frame or TIFF.")] = None
    film: Annotated[str | None, typer.Option(help="Film a press, FIRST:LAST or `all` to MP4 or GIF.")] = None
    export: Annotated[
        list[str] | None, typer.Option(help="Also write tiff, npz, zarr, ply or vtk (repeatable).")
    ] = None
    terms: Annotated[bool, typer.Option("--terms", help="Also draw the largest term of the deviation.")] = False
    html: Annotated[bool, typer.Option("--html", help="Also write a page with a surface to turn.")] = False
    window: Annotated[
        bool, typer.Option("--window", help="Open a window: frames, profiles by mouse, surface.")
    ] = False


class Force(WithFrames, WithJson, runs="force.force", locks="out"):
    """Turn frames into maps of traction on the gel (MPa) and resultants (N), with figures."""

    path: Annotated[Path, typer.Argument(help="A recording, a video, or a folder of frames.")]
    calibration: Annotated[
        Path | None, typer.Option(help="Take E and nu from calibration.json; by default of the profile.")
    ] = None
    out: OutOption = Path("force_out")
    form: Annotated[Literal["npz", "zarr"], typer.Option("--format", help="Write tractions like this.")] = "npz"
    workers: WorkersOption = None
    cluster: ClusterOption = None
    pictures: Annotated[int, typer.Option(min=0, help="Draw so many of the strongest.")] = 3
    diagnosis: Annotated[
        bool,
        typer.Option("--diagnosis/--no-diagnosis", help="Find the cause of a difference from the F/T sensor."),
    ] = True


class Live(WithFrames, WithJson, runs="live.live"):
    """Read frames live: depth, contact and wrench, rate and latency. Frames are dropped, never queued."""

    camera: Annotated[
        str, typer.Option(help="Read a camera's number, a video, or a folder.", metavar="0|VIDEO|FOLDER")
    ] = "0"
    indenter: Annotated[str | None, typer.Option(help="Look for the face of this indenter.")] = None
    form: Annotated[
        Literal["mjpeg", "raw"] | None, typer.Option("--format", help="Choose the format of the camera's frames.")
    ] = None
    rate: Annotated[float, typer.Option(min=0.1, help="Play at so many frames a second.")] = 30
    every: Annotated[bool, typer.Option("--every", help="Drop no frame of a video or folder.")] = False
    frames: Annotated[int | None, typer.Option(min=1, help="Stop after so many frames.")] = None
    seconds: Annotated[float | None, typer.Option(min=0.1, help="Stop after so many seconds.")] = None
    preview: Annotated[int | None, typer.Option(min=0, max=65535, help="Port of a page; 0: a free one.")] = None
    foxglove: Annotated[bool, typer.Option("--foxglove", help="Serve Foxglove: pictures, maps, wrench.")] = False
    mcap: Annotated[Path | None, typer.Option(help="Write the same to this MCAP file.")] = None
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write live.csv and patches.csv into this folder.")
    ] = None


# Young's modulus and Poisson's ratio


class Calibrate(WithPictures, WithJson, runs="calibrate.calibrate", locks="out"):
    """Certify each press, then fit Young's modulus and Poisson's ratio; writes tables, JSON and a report.

    Of several recordings the newest one's result stands in OUT itself, each older one's in a folder of its own;
    history.csv says whether the gel has changed.
    """

    recordings: Annotated[
        list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one sensor, or folders of them.")
    ]
    out: OutOption = Path("calibration_out")
    law: Annotated[
        Literal["default", "paper"],
        typer.Option(help="Fit from first principles at the true a/h, or by the published route (paper)."),
    ] = "default"
    prior: PriorOption = True
    test: Annotated[bool, typer.Option("--test/--no-test", help="Test whether the law explains the data.")] = True
    cluster: ClusterOption = None


class Passport(WithFigures, WithJson, runs="calibrate.passport", locks="out"):
    """Follow a gel over weeks: E and nu with their dates, the change, and when to recalibrate.

    Recordings that are in the ledger already are not calibrated again.
    """

    recordings: Annotated[
        list[Path],
        typer.Argument(metavar="RECORDING...", help="Recordings of one sensor in order of time, or folders."),
    ]
    out: OutOption = Path("passport_out")
    ledger: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Keep entries of all sensors in this SQLite file, and go on from them."),
    ] = None
    tolerance: Annotated[
        float, typer.Option(min=0.1, max=100, help="Tolerate this error of E by ageing, percent.")
    ] = 5.0


class Plan(WithJson, runs="plan.plan"):
    """Forecast E, nu and c from a design, and find the fewest presses that reach a goal.

    Give --radius, --heights and --thickness, or a RECORDING that states them.
    """

    recording: Annotated[Path | None, typer.Argument(help="Its files state gel, indenters and noise.")] = None
    radius: Lengths = None
    heights: Lengths = None
    thickness: Size = None
    thickness_std: Size = None
    pad_radius: Size = None
    edge_radius: Size = None
    height_std: Size = None
    modulus: Range = None
    poisson_ratio: Range = None
    poisson_ratio_std: Annotated[float | None, typer.Option(help="State the std of nu.")] = None
    lubricated: Annotated[bool, typer.Option("--lubricated", help="Plan for lubricated presses.")] = False
    repeats: Annotated[int | None, typer.Option(help="Plan so many a height; by default as recorded.")] = None
    depth_noise: Annotated[float | None, typer.Option(help="State the std of a press's depth, mm.")] = None
    force_noise: Annotated[float | None, typer.Option(help="State the std of a press's force, N.")] = None
    gain_noise: Annotated[float | None, typer.Option(help="State the std of a press's force, percent.")] = None
    within: Annotated[float, typer.Option(help="Reach this half width of E's 95 % interval, percent.")] = 3.0
    within_nu: Annotated[float | None, typer.Option(help="Also reach this half width of nu.")] = None
    within_c: Annotated[float | None, typer.Option(help="Also reach this half width of c, percent.")] = None


class ExportMaterial(WithJson, runs="material.export_material", locks="out"):
    """Write a calibrated gel's parameters for a simulator or finite-element program, with their errors."""

    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="The calibration.json of `calibrate`.")
    ]
    to: Annotated[str, typer.Option(metavar="PROGRAM", help=f"Name it, or PROGRAM==VERSION: {PROGRAMS}.")]
    out: OutOption = Path("material")
    shape: Annotated[ShapeName, typer.Option(help="Fit the contact law to this shape.")] = "ball"
    radius_mm: Annotated[float, typer.Option(help="Radius of the shape in mm.")] = 4.0
    length_mm: Annotated[float, typer.Option(help="Length of a ridge in mm.")] = 10.0
    depths_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Fit from one depth to another, in mm; by default .05 to .2 thicknesses."),
    ] = None
    friction: Annotated[float | None, typer.Option(help="State the coefficient of friction.")] = None
    density: Annotated[float | None, typer.Option(help="State the gel's density in kg/m³.")] = None
    mass: Annotated[float, typer.Option(help="Mass of the pressing body in kg, for MuJoCo.")] = 0.1
    taxel_mm: Annotated[float, typer.Option(help="Distance of taxels in mm, for Genesis and Isaac.")] = 0.25
    largest_nu: Annotated[
        float | None, typer.Option(help="Bound Poisson's ratio of the solid; E is then that of this ratio.")
    ] = None


class Validate(WithFigures, WithJson, runs="simulate.validate", locks="out"):
    """Compare with finite elements at the measured forces and depths, for each friction and law.

    Says where the error follows the depth. Cases beyond the shipped table are solved on the spot, which takes
    some seconds each.
    """

    path: Annotated[
        Path,
        typer.Argument(metavar="PATH", help="A recording (frames, points or curves), or what calibrate wrote."),
    ]
    out: OutOption = Path("validation_out")
    calibration: Annotated[
        Path | None, typer.Option(help="Take E and nu from calibration.json; by default of PATH.")
    ] = None


# What a model lacks


class Workbench(Options, runs="workbench.workbench", locks="out"):
    """Find where the model fails, add effects, and see the error fall, in the browser on this machine."""

    recordings: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RECORDING...", help="Recordings of one sensor; none with --state."),
    ] = None
    out: OutOption = Path("workbench_out")
    state: Annotated[
        Path | None,
        typer.Option(
            "--state", metavar="FOLDER", help="Continue the analysis in a folder that workbench or compare wrote."
        ),
    ] = None
    private: Private = None
    prior: PriorOption = True
    seed: Seed = 0
    port: Annotated[int, typer.Option(help="Serve the page on this port (0: any).")] = 0
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True
    framed: Annotated[bool, typer.Option("--framed", help="Let a notebook on this machine frame the page.")] = (
        False
    )


class Diagnose(WithSearch, WithPictures, WithJson, runs="analysis.diagnose", locks="out"):
    """Find out what is missing from the model: which effect, how sure, and what to measure next."""

    recordings: Recordings
    out: OutOption = Path("diagnosis_out")
    known: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            metavar="KEY|FILE.py",
            help="Put an effect into the model from the start: a key, or the file of one of your own.",
        ),
    ] = None
    private: Private = None
    apply: Annotated[bool, typer.Option("--apply", help="Write calibration.json with the effects found.")] = False
    workers: WorkersOption = None
    cluster: ClusterOption = None


class Compare(WithSearch, WithPictures, WithJson, runs="analysis.compare", locks="out"):
    """Add effects one after the other and watch the error, on held-out presses, next to the repeatability."""

    recordings: Recordings
    out: OutOption = Path("comparison_out")
    chosen: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            metavar="KEY|FILE.py",
            help="Add effects in the order given, by key, or by the file of one of your own, which is run.",
        ),
    ] = None
    left_out: Annotated[
        list[str] | None, typer.Option("--leave-out", metavar="PRESS", help="Do not fit this press (repeatable).")
    ] = None


class Steps(WithPictures, WithJson, runs="analysis.steps", locks="folder"):
    """List the steps of an analysis; undo and redo them. The folder's results follow.

    With an effect of your own among the steps that stay, name its file again.
    """

    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="What diagnose or compare wrote.")]
    undo: Annotated[bool, typer.Option("--undo", help="Undo the last step.")] = False
    redo: Annotated[bool, typer.Option("--redo", help="Redo the step that was undone last.")] = False
    private: Private = None


class NewEffect(Options, runs="analysis.new_effect"):
    """Write a template of an effect of your own, for --effect."""

    path: Annotated[Path, typer.Argument(help="Python file to write.")]
    key: Annotated[str, typer.Option(help="Name the effect.")] = "my_effect"


# Sensors


class CalibrateSensor(WithLight, WithJson, runs="train.calibrate_sensor", locks="out file"):
    """Write a sensor profile for --sensor FILE.tvs: light, rectification, untouched gel, E and nu."""

    path: Annotated[
        Path, typer.Argument(help="A recording, a folder of ball presses and flats, or one of frames.")
    ]
    out: Annotated[Path, typer.Option("--out", "-o", help="Write FILE.tvs.")] = Path("my_sensor.tvs")
    sensor: Annotated[
        str | None, typer.Option(help="For a bare folder, name the sensor, or a TOML file with a [sensor] table.")
    ] = None
    ball_radius_mm: BallOption = None
    calibration: Annotated[
        Path | None, typer.Option(help="Take E and nu from calibration.json, or else fit them.")
    ] = None
    light_only: Annotated[bool, typer.Option("--light-only", help="Omit E and nu: no force is given.")] = False
    serial: Annotated[str | None, typer.Option(help="State the unit's serial number, where no file does.")] = None


class Train(WithSensor, WithJson, runs="train.train", locks="out file"):
    """Calibrate a photometric method for --method FILE.

    Its card states its errors; a figure shows held-out balls, and flat steps certified by the recording's own
    presses, by depth and by contact size.
    """

    recording: Annotated[
        Path, typer.Argument(help="A recording, or a folder of ball presses and flats, also of gs_sdk.")
    ]
    method: Annotated[str, typer.Option(help="Choose polynomial, auto, lookup or network.")] = "auto"
    out: Annotated[Path, typer.Option("--out", "-o", help="Write the method here, and its card next to it.")] = (
        Path("method.npz")
    )
    licence: Annotated[str, typer.Option(help="State the file's licence, for its card.")] = "not stated"
    guide: Annotated[
        bool, typer.Option("--guide", help="First mark the balls on a page; also writes a profile.")
    ] = False
    port: Annotated[int, typer.Option(min=0, max=65535, help="Serve the page on this port (0: any).")] = 0
    ball_radius_mm: BallOption = None


# Robot logs and data sets


class ImportLog(WithJson, runs="logs.import_log", locks="out"):
    """Convert a log of ROS 1, ROS 2 or MCAP to a recording: frames, forces and their times. No ROS is needed."""

    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="A .bag, .db3 or .mcap file, or a ROS 2 bag's folder.")
    ]
    out: Annotated[Path, typer.Option("--out", "-o", help="Write the recording into this folder.")]
    frames: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="Read pictures from this topic; by default the only such one."),
    ] = None
    wrench: Annotated[str | None, typer.Option(metavar="TOPIC", help="Read WrenchStamped from here.")] = None
    clock: Annotated[Literal["header", "log"], typer.Option(help="Take times of the headers or of the log.")] = (
        "header"
    )
    sensor: Annotated[str | None, typer.Option(help="Name the kind of sensor, or its profile (.tvs).")] = None
    mm_per_px: ScaleOption = None
    rotation: Annotated[
        str | None, typer.Option(metavar="LIST", help="Give the frame's x, y, z in the wrench's axes.")
    ] = None


class ExportLog(WithJson, runs="logs.export_log", locks="out file"):
    """Write depth (Image, 32FC1, metres), force (WrenchStamped) and tractions (PointCloud2, Pa) to a log.

    No ROS is needed.
    """

    path: Annotated[Path, typer.Argument(metavar="RECORDING", help="The recording, which has the frames' times.")]
    out: Annotated[Path, typer.Option("--out", "-o", help="Write FILE.mcap, FILE.bag or a ROS 2 folder.")]
    depth: Annotated[Path | None, typer.Option(help="Take what `tactilevision depth` wrote.")] = None
    force: Annotated[Path | None, typer.Option(help="Take what `tactilevision force` wrote.")] = None
    sensor: SensorOption = None
    frame_id: Annotated[str, typer.Option(help="Name the frame of reference of all messages.")] = "gel_pad"


class Lerobot(WithJson, runs="logs.lerobot", locks="out"):
    """Write a data set with depth, contact and force added; frames are unchanged."""

    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="A data set of LeRobot, version 3.")]
    camera: Annotated[str, typer.Option(metavar="KEY", help="Name it: observation.images.tactile.")]
    sensor: Annotated[Path, typer.Option(help="Use this profile (.tvs) of the sensor.")]
    out: Annotated[Path, typer.Option("--out", "-o", help="Write the data set into this folder.")]
    shrink: Annotated[int, typer.Option(min=1, help="Average depth over so many pixels each way.")] = 4
    depth: Annotated[
        Literal["table", "native"],
        typer.Option(help="Store depth as a column in mm, or as LeRobot's own depth map (0.6 or newer) and mask."),
    ] = "table"


# Simulation


class Simulate(Options, runs="simulate.simulate", locks="out"):
    """Simulate a recording: gel, camera, rig and their faults; a file of the truth says what was put in."""

    out: Annotated[Path, typer.Argument(help="Write the recording into this folder.")]
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same recording.")] = 0
    frames: Annotated[
        Literal["png", "jpeg", "curves", "points"],
        typer.Option(help="Choose the format of the pictures. With curves or points there are none."),
    ] = "png"
    presses: Annotated[int | None, typer.Option(min=1, help="Make so many with each indenter.")] = None
    youngs_modulus: Annotated[float | None, typer.Option(help="Set the true modulus in MPa.")] = None
    poisson_ratio: Annotated[float | None, typer.Option(help="Set the true ratio.")] = None
    faults: Annotated[bool, typer.Option(help="Add one bad press of every kind.")] = True
    markers: Annotated[bool, typer.Option(help="Print markers on the gel.")] = False
    shadows: Annotated[bool, typer.Option(help="Let the lamps, strips of 12 by 2 mm, cast shadows.")] = False


class Tabulate(WithJson, runs="simulate.tabulate", locks="out"):
    """Solve the flat punch over nu, a/h, depth, friction, law and edge radius; writes OUT/punch.npz and its card.

    Each solved case is a file of its own in OUT/cases: a run that is stopped, or killed, goes on where it was.
    Omitted options span what the shipped table does: some 1000 cases of a few seconds each.
    """

    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of cases and table; a second run goes on.")]
    law: Annotated[str | None, typer.Option(metavar="LIST", help="Solve for neo-hooke, hencky.")] = None
    friction: Annotated[
        str | None, typer.Option(metavar="LIST", help="Solve for these coefficients; inf: no slip.")
    ] = None
    poisson_ratio: Numbers = None
    a_over_h: Numbers = None
    edge_over_h: Numbers = None
    workers: WorkersOption = None
    cluster: ClusterOption = None
