"""Commands `calibrate` and `passport`: E and nu from presses, and over weeks."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

from calibration.report.figures import FigureChoice
from calibration.report.passport_report import passport_lines
from calibration.report.report import summary
from calibration.result.result import in_words
from tactilevision.batch.tree import find_recordings
from tactilevision.cli import console, options
from tactilevision.files.runs import output_lock
from tactilevision.pipeline import calibrate_each
from tactilevision.result_folders import write_calibrations, write_passport


def calibrate(given: options.Calibrate) -> None:
    """Certify each press, then fit Young's modulus and Poisson's ratio; writes tables, JSON and a report."""
    paths = [path for one in given.recordings for path in find_recordings(one)]
    law, choice = given.law, FigureChoice(given.form, given.pictures)
    how: dict[str, Any] = {"prior": given.prior, "test": given.test, "cluster": given.cluster}
    outcomes = calibrate_each(paths, law=law, listener=console, **how)
    for row in write_calibrations(outcomes, given.out, law=law, choice=choice, listener=console):
        moved = "has changed" if row.moved else "no significant change"
        console.say(f"{row.date} {row.recording}: stiffness {100 * row.change:+.1f} % since the first, {moved}")
    latest = outcomes[-1]
    for one in outcomes:
        said = one.result.warnings if one.result is not None else ()
        of = "" if one is latest else f"{one.certified.recording.name}: "
        console.warn([f"{of}{line.removeprefix(of)}" for line in said if line not in one.certified.warnings])
    if latest.result is not None:
        console.say(*summary(latest.result))
    else:
        console.say(*in_words(latest.certified.points))
    console.say(f"wrote {given.out / 'report.html'}, and the tables and figures next to it")
    console.hand_over(latest.content, given.json)
    if latest.fault is not None:
        raise latest.fault


def passport(given: options.Passport) -> None:
    """Follow a gel over weeks: E and nu with their dates, the change, and when to recalibrate."""
    out, ledger = given.out, given.ledger
    with output_lock(ledger, file=True) if ledger is not None else nullcontext():
        found = write_passport(
            given.recordings,
            out,
            ledger=ledger,
            tolerance=given.tolerance / 100,
            choice=FigureChoice(given.form),
            listener=console,
        )
    recordings = "1 recording" if len(found.entries) == 1 else f"{len(found.entries)} recordings"
    console.say(f"{found.sensor}: {recordings}", *passport_lines(found))
    console.warn(found.warnings)
    console.say(f"wrote {out / 'passport.html'} and passport.json" + (f"; {ledger}" if ledger is not None else ""))
    console.hand_over(found.as_json(), given.json)
