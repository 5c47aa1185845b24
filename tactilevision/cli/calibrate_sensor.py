"""`tactilevision calibrate-sensor PATH`: whatever there is of a sensor into one file, its profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactilevision.cli import console, source

if TYPE_CHECKING:
    from tactilevision.certificate.depth.depth_scale import DepthScale
    from tactilevision.profile.model import Profile
    from tactilevision.reconstruct import Reconstructor
    from tactilevision.recording import Recording


def calibrate_sensor(
    path: Annotated[
        Path, typer.Argument(help="A recording, a folder of ball presses and flats, or one of frames.")
    ],
    out: Annotated[Path, typer.Option("--out", help="The profile's file; its name ends in .tvs.")] = Path(
        "my_sensor.tvs"
    ),
    sensor: Annotated[
        str | None, typer.Option(help="For a bare folder: a sensor's name, or a TOML file with a [sensor] table.")
    ] = None,
    reference: source.ReferenceOption = None,
    method: source.MethodOption = None,
    mm_per_px: source.ScaleOption = None,
    ball_radius_mm: source.BallOption = None,
    calibration: Annotated[
        Path | None, typer.Option(help="calibration.json, with E and nu; made here if left out and if possible.")
    ] = None,
    light_only: Annotated[bool, typer.Option("--light-only", help="Leave E and nu out: depth, no force.")] = False,
    serial: Annotated[str | None, typer.Option(help="The unit's serial number, where no file says it.")] = None,
    json: console.JsonOption = None,
) -> None:
    """Make a sensor profile: light, rectification, untouched gel, E and nu, in one file for --sensor FILE.tvs."""
    from tactilevision.profile.make import make_profile
    from tactilevision.profile.read import read_profile
    from tactilevision.profile.write import check_name, write_profile

    check_name(out)
    chosen = source.Choice(sensor, reference, method, mm_per_px)
    recording = _open(path, chosen, ball_radius_mm, serial)
    with console.progress_bar("calibrating the light"):
        reconstructor = chosen.light(recording)
    console.warn([*recording.warnings, *reconstructor.warnings])
    known = _Known() if light_only else _known(recording, reconstructor, calibration)
    with console.progress_bar("solving the gel"):
        made = make_profile(recording, reconstructor, calibration=known.content, face_laws=known.face_laws)
        write_profile(made, out)
    found = read_profile(out)
    console.say(f"wrote {out}: {found.name}, {found.date}, {out.stat().st_size / 1e6:.1f} MB", *_told(found))
    console.hand_over(_as_json(found), json)


_SHEAR = {
    "markers": "fx and fy from the markers",
    "texture": "fx and fy from the gel's grain",
    "nothing": "fz alone, as nothing on the gel can be followed",
}


@dataclass(frozen=True, slots=True)
class _Known:
    """Content of calibration.json, and how deep certified faces are over how deep they are read."""

    content: dict[str, Any] | None = None
    face_laws: dict[bool, DepthScale | None] = field(default_factory=dict)


def _open(path: Path, chosen: source.Choice, ball_radius_mm: float | None, serial: str | None) -> Recording:
    recording = source.open_balls(path, chosen, ball_radius_mm)
    return recording if serial is None else replace(recording, sensor=replace(recording.sensor, serial=serial))


def _known(recording: Recording, reconstructor: Reconstructor, calibration: Path | None) -> _Known:
    """E, nu and certified faces: of the calibration.json that was named, or of the recording's presses."""
    from tactilevision.certificate.depth.certified_faces import Certified, read_certified
    from tactilevision.force.calibrated import check_gel, material_of, read_calibration

    if calibration is not None:
        content = read_calibration(calibration)
        material_of(content, where=calibration)
        if recording.sensor.gel is not None:
            check_gel(calibration, recording.sensor.gel)
        return _Known(content, _taught(recording, reconstructor, read_certified(calibration)))
    if not (recording.presses and recording.forces is not None and recording.sensor.gel is not None):
        return _Known()
    from tactilevision.cli.calibrate import LawName, calibrate_one
    from tactilevision.cli.measure import take

    outcome = calibrate_one(take([recording.path])[0], LawName.DEFAULT)
    if outcome.result is None:
        console.warn([f"E and nu are left out: {outcome.fault}"])
        return _Known()
    points = outcome.taken.points
    certified = [Certified(one.press, one.time_s, one.depth_mm) for one in points if one.accepted]
    return _Known(outcome.content, _taught(recording, reconstructor, certified, said=outcome.taken.warnings))


def _taught(
    recording: Recording, reconstructor: Reconstructor, certified: Any, *, said: Sequence[str] = ()
) -> dict[bool, DepthScale | None]:
    """Lets certified faces teach the walls; then, how deep these faces are over how deep they are read.

    With cast shadows left (False) and undone (True). `said`: warnings that were given already.
    """
    from tactilevision.reconstruct.shadows_seen import leave, undo_by

    found, doubt = _face_law(recording, reconstructor, certified)
    console.warn([doubt] if doubt and doubt not in said else [])
    light = reconstructor.shadows
    if light is None:
        return {False: found}
    leave(reconstructor)
    plain, _ = _face_law(recording, reconstructor, certified)
    undo_by(reconstructor, light.lamps)
    return {False: plain, True: found}


def _face_law(recording: Recording, reader: Reconstructor, certified: Any) -> tuple[DepthScale | None, str]:
    """The law of the faces' depth with walls as they teach them, shadows as they are read now; its doubt."""
    from tactilevision.certificate.depth.certified_faces import read_faces
    from tactilevision.certificate.depth.face_depth import face_depth_correction
    from tactilevision.certificate.depth.wall_lessons import teach_walls, with_scatter

    faces = read_faces(recording, reader, certified=certified)
    taught = teach_walls(reader, faces)
    found = face_depth_correction(recording, faces, walls=reader.taught)
    same = reader.taught if taught else None
    return found.depth_scale if same is None else with_scatter(found.depth_scale, same), found.doubt


def _told(profile: Profile) -> list[str]:
    """What the profile holds, and what it does not, with what would add it."""
    card, gel, material = profile.method.card, profile.sensor.gel, profile.material
    off = card.held_out_direction_error_deg
    balls = f"{card.balls} ball presses" if card.balls else "no ball presses"
    lines = [
        f"  light: {profile.method.name}, {balls}" + (f"; {off:.1f} deg off on balls left out" if off else "")
    ]
    if gel is None:
        lines.append("  gel: not described; [sensor.gel] of a TOML file adds it")
    if material is None:
        lines.append("  no E and nu, so no force: --calibration calibration.json adds them")
    else:
        E, nu = material.youngs_modulus_MPa, material.poisson_ratio
        lines.append(f"  E {E:.4g} MPa, nu {nu:.4g}: force is given; {_SHEAR[profile.followed]}")
    if profile.lamps is not None:
        lines.append("  the lamps cast shadows: `depth` and `force` undo them, `live` does not")
    elif (told := profile.told_lamps) is not None and not told.doubtful:
        lines.append("  balls tell the lamps: `depth` and `force` undo shadows that frames show, `live` does not")
    if getattr(profile.method, "walls", None) is not None:
        lines.append("  certified faces taught the walls' law: any flat face gains from it")
    if profile.face_law is not None:
        lines.append("  flat faces are as deep as certified ones, where an indenter is looked for")
    return lines


def _as_json(profile: Profile) -> dict[str, Any]:
    material = profile.material
    return {
        "kind": profile.sensor.kind,
        "serial": profile.sensor.serial,
        "date": profile.date,
        "source": profile.source,
        "method": profile.method.name,
        "youngs_modulus_MPa": None if material is None else material.youngs_modulus_MPa,
        "poisson_ratio": None if material is None else material.poisson_ratio,
        "face_law": profile.face_law is not None,
        "lamps": profile.lamps is not None,
        "warnings": list(profile.warnings),
    }
