"""`tactilevision train RECORDING`: ball presses into a photometric method with its card."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tactilevision.cli import console, source as sources
from tactilevision.errors import InputError

if TYPE_CHECKING:
    from tactilevision.certificate.depth.certified_faces import Certified
    from tactilevision.photometric.method import ReferencedMethod
    from tactilevision.reconstruct import Reconstructor
    from tactilevision.recording import Recording


def train(
    recording: Annotated[
        Path, typer.Argument(help="A recording, or a folder of ball presses and flats, gs_sdk's too.")
    ],
    method: Annotated[str, typer.Option(help="polynomial, auto, lookup or network.")] = "auto",
    out: Annotated[
        Path, typer.Option("--out", help="The method's file; its card and figure lie beside it.")
    ] = Path("method.npz"),
    licence: Annotated[str, typer.Option(help="Of the method's file, for its card.")] = "not stated",
    guide: Annotated[
        bool,
        typer.Option("--guide", help="First draw the balls' circles on a page; writes a profile, too."),
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the guide's page; 0: any free one.")] = 0,
    sensor: sources.SensorOption = None,
    reference: sources.ReferenceOption = None,
    mm_per_px: sources.ScaleOption = None,
    ball_radius_mm: sources.BallOption = None,
) -> None:
    """Calibrate a photometric method, to be used later with --method FILE.

    Its card says how far it is off; a figure shows balls held out, and flat steps that the recording's own presses
    certify, by depth and by contact size.
    """
    from tactilevision.photometric import PHOTOMETRIC
    from tactilevision.photometric.card import provenance
    from tactilevision.reconstruct import calibrate_light

    if method not in PHOTOMETRIC:
        raise InputError(
            "no photometric method of that name",
            where="--method",
            value=method,
            remedy="Known are " + ", ".join(PHOTOMETRIC) + ".",
        )
    chosen = sources.Choice(sensor, reference, None, mm_per_px)
    if guide:
        _guide(recording, chosen, ball_radius_mm, method=method, port=port)
    source = _read(recording, chosen, ball_radius_mm)
    if not source.balls:
        raise InputError(
            "no ball presses to train on",
            where=recording / "reference" / "ball",
            remedy="Press a ball twenty times, all over. In a bare folder --ball-radius-mm states the radius.",
        )
    with console.progress_bar("calibrating the light"):
        made = calibrate_light(source, method)
    console.warn([*source.warnings, *made.warnings])
    assert made.referenced is not None
    data = f"{source.name}: {len(source.balls)} ball presses, {len(source.flats)} flats"
    known, certified = _certified(source, made)
    kept = _with_walls(source, made, _with_lamps(source, made, made.referenced), certified)
    if getattr(kept, "walls", None) is not None:
        known["flat_steps_walls"] = "as read before these faces taught the walls' law"
    card = made.referenced.card.extended(known | provenance(data, licence=licence))
    _save(kept.with_card(card), out, network=method == "network")
    shown = {name: value for name, value in card.to_json().items() if not isinstance(value, dict | list)}
    console.say(*(f"  {name}: {f'{v:.4g}' if isinstance(v, float) else v}" for name, v in shown.items()))
    if guide:
        _save_profile(source, made, out)


def _read(path: Path, chosen: sources.Choice, ball_radius_mm: float | None) -> Recording:
    from tactilevision.recording import layout, read_recording

    if chosen == sources.Choice() and ((path / layout.SETTINGS).is_file() or not path.exists()):
        return read_recording(path)  # one without frames serves
    return sources.open_balls(path, chosen, ball_radius_mm)


def _guide(path: Path, chosen: sources.Choice, ball_radius_mm: float | None, *, method: str, port: int) -> None:
    """Serve the page until a person is done; the table of balls is then as drawn."""
    from tactilevision.profile.guide import Guide, Session
    from tactilevision.profile.guide.labels import start_table
    from tactilevision.runs import output_lock

    start_table(path, ball_radius_mm)
    with console.progress_bar("looking for balls"):
        session = Session(
            _read(path, chosen, ball_radius_mm), method="polynomial" if method == "network" else method
        )
    with output_lock(session.table, file=True), Guide(session, port=port) as page:
        console.say(f"draw the circles at {page.address}", "Ctrl-C ends without writing them")
        page.wait()
    console.say(f"wrote {session.table}")


def _save_profile(source: Recording, made: Reconstructor, out: Path) -> None:
    """The sensor's profile beside the method: light alone, no E and nu."""
    from tactilevision.profile.contents import SUFFIX
    from tactilevision.profile.make import make_profile
    from tactilevision.profile.write import write_profile

    try:
        with console.progress_bar("making the profile"):
            write_profile(make_profile(source, made), out.with_suffix(SUFFIX))
    except InputError as fault:  # the method stands without it
        console.warn([f"no profile: {fault}"])
        return
    console.say(f"wrote {out.with_suffix(SUFFIX)}, for --sensor")


def _certified(source: Recording, made: Reconstructor) -> tuple[dict[str, Any], tuple[Certified, ...]]:
    """What the recording's own certified presses say of the method, for its card, and they; doubts are told."""
    from tactilevision.certificate.depth.depth_scale import scale_warning
    from tactilevision.certificate.step_validation import flat_steps
    from tactilevision.uncertainty.ball_validation import told

    with console.progress_bar("certifying flat steps"):
        steps, why, certified = flat_steps(source, made)
    doubt = scale_warning([(s.found_mm, s.true_mm) for s in steps], [ball.ball_radius_mm for ball in source.balls])
    console.warn([doubt] if doubt else [])
    known: Mapping[str, Any] = told("flat_steps", steps) if steps else {"flat_steps": why}
    return ({**known, "doubt_of_scale": doubt} if doubt else dict(known)), certified


def _with_lamps(source: Recording, made: Reconstructor, method: ReferencedMethod) -> ReferencedMethod:
    from tactilevision.reconstruct.lamps import with_lamps

    with console.progress_bar("looking for the lamps"):
        return with_lamps(source, made, method)


def _with_walls(
    source: Recording, made: Reconstructor, method: ReferencedMethod, certified: tuple[Certified, ...]
) -> ReferencedMethod:
    """The method with what certified faces teach of walls, shadows left and, where frames show them, undone."""
    from tactilevision.certificate.depth.certified_faces import read_faces
    from tactilevision.certificate.depth.wall_lessons import teach_walls, with_walls
    from tactilevision.reconstruct.shadows_seen import with_shadows

    if not certified:
        return method
    with console.progress_bar("learning walls"):
        teach_walls(made, read_faces(source, made, certified=certified))
        if with_shadows(source, made).shadows is not None:
            teach_walls(made, read_faces(source, made, certified=certified))
    return with_walls(method, made.walls)


def _save(method: ReferencedMethod, out: Path, *, network: bool) -> None:
    """The method's file, and its card and figure beside it."""
    from tactilevision.photometric import save_method

    path = save_method(method, out)
    also: tuple[str, ...] = (".onnx", ".json") if network else (".json",)
    if method.card.other.get("held_out_balls"):
        from tactilevision.plots.depth_report import draw_depth_report
        from tactilevision.plots.style import save_figure

        save_figure(draw_depth_report(method.card.other), path.with_suffix(".png"))
        also += (".png",)
    console.say("wrote " + ", ".join(str(path.with_suffix(suffix)) for suffix in (".npz", *also)))
