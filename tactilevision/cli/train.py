"""Commands `train` and `calibrate-sensor`: a photometric method, and a sensor profile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactilevision.cli import console, options, source as sources
from tactilevision.errors import InputError, check_known
from tactilevision.files.runs import output_lock
from tactilevision.force.calibrated import check_gel, material_of, read_calibration
from tactilevision.heightmap.ball_validation import told
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.card import provenance
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.method import CalibratedMethod
from tactilevision.photometric.storage import save_method
from tactilevision.pipeline import calibrate_each
from tactilevision.plots.style import save_figure
from tactilevision.plots.validation import draw_depth_report
from tactilevision.press.certified_faces import Certified, DepthScale, read_certified, scale_warning, with_scatter
from tactilevision.press.step_validation import flat_steps
from tactilevision.profile.ball_guide import Guide, Session, start_table
from tactilevision.profile.model import Profile
from tactilevision.profile.sensor import make_profile
from tactilevision.profile.storage import SUFFIX, check_name, read_profile, write_profile
from tactilevision.recording.model import Recording
from tactilevision.sensors import usual_gel


def train(given: options.Train) -> None:
    """Calibrate a photometric method for --method FILE."""
    check_known(given.method, PHOTOMETRIC, what="no photometric method of that name", where="--method")
    chosen = sources.Choice(given.sensor, given.reference, None, given.mm_per_px)
    if given.guide:
        _guide(given.recording, chosen, given.ball_radius_mm, method=given.method, port=given.port)
    source = sources.open_balls(given.recording, chosen, given.ball_radius_mm)
    if not source.balls:
        remedy = "Press a ball at twenty places. For a bare folder state the radius with --ball-radius-mm."
        where = given.recording / "reference" / "ball"
        raise InputError("no ball presses to train on", where=where, remedy=remedy)
    with console.progress_bar("calibrating the light:") as progress:
        made = build_reconstructor(source, given.method, progress=progress)
    console.warn([*source.warnings, *made.warnings])
    kept = _trained(source, made, given.licence)
    _save(kept, given.out, network=given.method == "network")
    shown = {name: value for name, value in kept.card.to_json().items() if not isinstance(value, dict | list)}
    console.say(*(f"  {name}: {f'{v:.4g}' if isinstance(v, float) else v}" for name, v in shown.items()))
    if given.guide:
        _save_profile(source, made, given.out)
    console.hand_over(kept.card.to_json(), given.json)


def _guide(path: Path, chosen: sources.Choice, ball_radius_mm: float | None, *, method: str, port: int) -> None:
    """Serve the page until the person has finished and the table of balls is written."""
    start_table(path, ball_radius_mm)
    with console.progress_bar("looking for balls"):
        presses = sources.open_balls(path, chosen, ball_radius_mm)
        session = Session(presses, method="polynomial" if method == "network" else method)
    with output_lock(session.table, file=True), Guide(session, port=port) as page:
        console.say(f"mark the circles at {page.address}", "Ctrl-C ends without writing them")
        page.wait()
    console.say(f"wrote {session.table}")


def _trained(source: Recording, made: Reconstructor, licence: str) -> CalibratedMethod:
    """Return the method with its card, and with the walls' law of the recording's own certified presses."""
    kept, (known, certified) = made.referenced, _certified(source, made)
    assert kept is not None
    if certified:
        with console.progress_bar("learning walls"):
            kept = replace(kept, walls=sources.taught(source, made, certified)[0].taught)
    if kept.walls is not None:
        known["flat_steps_walls"] = "as read before the walls' law was fitted to these faces"
    data = f"{source.name}: {len(source.balls)} ball presses, {len(source.flats)} flats"
    return replace(kept, card=kept.card.extended(known | provenance(data, licence=licence)))


def _save_profile(source: Recording, made: Reconstructor, out: Path) -> None:
    """Write the sensor's profile, without E and nu, next to the method."""
    try:
        with console.progress_bar("making the profile"):
            write_profile(make_profile(source, made), out.with_suffix(SUFFIX))
    except InputError as fault:  # the method is written without it
        console.warn([f"no profile: {fault}"])
        return
    console.say(f"wrote {out.with_suffix(SUFFIX)}, for --sensor")


def _certified(source: Recording, made: Reconstructor) -> tuple[dict[str, Any], tuple[Certified, ...]]:
    """Return the errors on the recording's certified presses, for the card, and these presses; print doubts."""
    with console.progress_bar("certifying flat steps"):
        steps, why, certified = flat_steps(source, made)
    doubt = scale_warning([(s.found_mm, s.true_mm) for s in steps], [ball.ball_radius_mm for ball in source.balls])
    console.warn([doubt] if doubt else [])
    known: Mapping[str, Any] = told("flat_steps", steps) if steps else {"flat_steps": why}
    return ({**known, "doubt_of_scale": doubt} if doubt else dict(known)), certified


def _save(method: CalibratedMethod, out: Path, *, network: bool) -> None:
    """Write the method's file, and its card and figure next to it."""
    path = save_method(method, out)
    also: tuple[str, ...] = (".onnx", ".json") if network else (".json",)
    if method.card.other.get("held_out_balls"):
        save_figure(draw_depth_report(method.card.other), path.with_suffix(".png"))
        also += (".png",)
    console.say("wrote " + ", ".join(str(path.with_suffix(suffix)) for suffix in (".npz", *also)))


def calibrate_sensor(given: options.CalibrateSensor) -> None:
    """Write a sensor profile for --sensor FILE.tvs: light, rectification, untouched gel, E and nu."""
    check_name(given.out)
    chosen = sources.Choice(given.sensor, given.reference, given.method, given.mm_per_px)
    recording = _open(given.path, chosen, given.ball_radius_mm, given.serial)
    with console.progress_bar("calibrating the light:") as progress:
        reconstructor = chosen.light(recording, progress)
    console.warn([*recording.warnings, *reconstructor.warnings])
    content, certified, said = (None, (), ()) if given.light_only else _known(recording, given.calibration)
    with console.progress_bar("solving the gel"):
        face_law = None
        if content is not None:
            reconstructor, face_law = _taught(recording, reconstructor, certified, said=said)
        write_profile(make_profile(recording, reconstructor, calibration=content, face_law=face_law), given.out)
    found = read_profile(given.out)
    size = f"{given.out.stat().st_size / 10**6:.1f} MB"
    console.say(f"wrote {given.out}: {found.name}, {found.date}, {size}", *_contents(found))
    console.hand_over(_as_json(found), given.json)


_SHEAR = {
    "markers": "fx and fy from the markers",
    "texture": "fx and fy from the gel's texture",
    "nothing": "fz alone, as the gel shows no pattern to follow",
}


def _open(path: Path, chosen: sources.Choice, ball_radius_mm: float | None, serial: str | None) -> Recording:
    recording = sources.open_balls(path, chosen, ball_radius_mm)
    return recording if serial is None else replace(recording, sensor=replace(recording.sensor, serial=serial))


def _known(
    recording: Recording, calibration: Path | None
) -> tuple[dict[str, Any] | None, Sequence[Certified], Sequence[str]]:
    """Return a calibration.json, its certified faces and warnings given: of the file, or of the presses."""
    if calibration is not None:
        content = read_calibration(calibration)
        material_of(content, where=calibration)
        if recording.sensor.gel is not None:
            check_gel(calibration, recording.sensor.gel)
        return content, read_certified(calibration), ()
    if not (recording.presses and recording.forces is not None and recording.sensor.gel is not None):
        return None, (), ()
    outcome = calibrate_each([recording.path], test=False, listener=console)[0]
    if outcome.result is None:
        console.warn([f"E and nu are omitted: {outcome.fault}"])
        return None, (), ()
    points = outcome.certified.points
    certified = [Certified(one.press, one.time_s, one.depth_mm) for one in points if one.accepted]
    return outcome.content, certified, outcome.certified.warnings


def _taught(
    recording: Recording, reader: Reconstructor, certified: Sequence[Certified], *, said: Sequence[str] = ()
) -> tuple[Reconstructor, DepthScale | None]:
    """Return the reader with walls as certified faces teach them, and how deep these are over how it reads them.

    `said`: warnings that were given already.
    """
    made, found = sources.taught(recording, reader, certified)
    console.warn([found.doubt] if found.doubt and found.doubt not in said else [])
    if made is reader or made.taught is None:
        return made, found.depth_scale
    return made, with_scatter(found.depth_scale, made.taught)


def _contents(profile: Profile) -> list[str]:
    """Return what the profile holds, and how to add what it lacks."""
    card, gel, material = profile.method.card, profile.sensor.gel, profile.material
    off = card.held_out_direction_error_deg
    balls = f"{card.balls} ball presses" if card.balls else "no ball presses"
    lines = [
        f"  light: {profile.method.name}, {balls}" + (f"; error {off:.1f} deg on held-out balls" if off else "")
    ]
    if gel is None:
        lines.append("  gel: not described; add [sensor.gel] to a TOML file")
    if material is None:
        force = "no force" if usual_gel(profile.sensor) is None else "force only by those of a usual gel, to 50 %"
        lines.append(f"  no E and nu, so {force}: --calibration calibration.json adds them")
    else:
        E, nu = material.youngs_modulus_MPa, material.poisson_ratio
        lines.append(f"  E {E:.4g} MPa, nu {nu:.4g}: force is given; {_SHEAR[profile.followed]}")
    if profile.method.walls is not None:
        lines.append("  the walls' law is fitted to certified faces, and used for any flat face")
    if profile.face_law is not None:
        lines.append("  depths of flat faces follow the certified ones where an indenter is named")
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
        "warnings": list(profile.warnings),
    }
