"""What `calibrate` and `diagnose` say of a recording, as plain numbers; and how often they are right."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.experimenter.named import NO_ALARM, RIGHT, is_right
from benchmarks.experimenter.recording import TESTABLE, make
from benchmarks.others_curves.judge import share
from calibration.fit.repeats import LEVEL
from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured
from calibration.tasks.calibrate import calibrate
from calibration.tasks.diagnose import diagnose
from tactilevision.errors import InputError
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Estimate

SEED = 7

Row = dict[str, Any]


def look(kind: str, seed: int, *, calibrate_only: bool = False) -> Row:
    """Make one recording, calibrate and diagnose it, and only then open the truth."""
    with tempfile.TemporaryDirectory() as folder:
        made = make(Path(folder), kind, seed)
        recording = read_recording(Path(folder))
    measured = Measured(recording, curves=recording.curves)
    row = asdict(made) | {"calibrate_only": calibrate_only, "calibrate": _timed(lambda: _calibrated(measured))}
    if not calibrate_only:
        row["diagnose"] = _timed(lambda: _diagnosed(measured))
    for said in (row["calibrate"], row.get("diagnose", {})):
        said["covered"] = _covers(said, made.modulus_MPa)
    return row


def _timed(act: Callable[[], Row]) -> Row:
    """Return what is said and the processor time of it, s; a sentence about bad input is a refusal."""
    begin = time.process_time()
    try:
        said = act()
    except InputError as refusal:
        said = {"failed": f"REFUSED {refusal}"}
    except Exception as fault:  # whatever is raised is a finding, and the rest goes on
        said = {"failed": f"RAISED {type(fault).__name__}: {fault}"}
    return said | {"cpu_s": round(time.process_time() - begin, 2)}


def _calibrated(measured: Measured) -> Row:
    result = calibrate(measured)
    return {
        **_modulus(result.youngs_modulus),
        "nu": list(result.poisson_ratio.interval95 or ()),
        "flags": list(result.flags),
        "warnings": list(result.warnings),
        "held_out_over_floor": result.held_out_N / max(result.noise_floor_N, 1e-12),
    }


def _diagnosed(measured: Measured) -> Row:
    found = diagnose(observe_curves(measured), np.random.default_rng(SEED))
    return {
        **_modulus(found.material.after.youngs_modulus),
        "verdict": found.verdict,
        "effects": [effect.key for effect in found.effects],
        "candidates": list(found.candidates),
        "depends_on": [one.key for one in found.search.covariates if one.p_adjusted < LEVEL],
        "flags": list(found.flags),
        "wanders": [name for name, _ in found.presses.odd.wanders],
        "odd": list(found.presses.odd.presses),
    }


def _modulus(E: Estimate) -> Row:
    return {"E_MPa": E.value, "interval_MPa": list(E.interval95 or ())}


def _covers(said: Row, modulus_MPa: float) -> bool:
    return bool(said.get("interval_MPa")) and said["interval_MPa"][0] <= modulus_MPa <= said["interval_MPa"][1]


def said(row: Row) -> set[str]:
    """Return everything that the diagnosis names, as `named.RIGHT` writes it."""
    d = row["diagnose"]
    if "failed" in d:
        return set()
    words = {*d["effects"], *d["candidates"], f"verdict:{d['verdict']}"} | {f"flag:{one}" for one in d["flags"]}
    return words | {f"covariate:{one}" for one in (*d["wanders"], *d["depends_on"])}


def named(row: Row) -> bool:
    """Return whether the cause is identified or in the set."""
    return is_right(row["kind"], said(row), row["sizes"])


def sure_and_wrong(row: Row) -> bool:
    """Return whether one cause is named for certain and it is another."""
    return row["diagnose"].get("verdict") == "IDENTIFIED" and not named(row)


def silent(row: Row) -> bool:
    """Return whether `calibrate` gave an interval without a flag."""
    return bool(row["calibrate"].get("interval_MPa")) and not set(row["calibrate"]["flags"]) - NO_ALARM


def silent_and_wrong(row: Row) -> bool:
    """Return whether `calibrate` gave no flag and an interval that excludes the truth."""
    return silent(row) and not row["calibrate"]["covered"]


def report(rows: Sequence[Row]) -> str:
    """Return the figures of all rows: of faults that can be tested, kind by kind, and of clean recordings."""
    faulty, clean = [r for r in rows if r["kind"] != "clean"], [r for r in rows if r["kind"] == "clean"]
    loud, quiet = ([r for r in faulty if (r["strength"] >= TESTABLE) is above] for above in (True, False))
    lines = [_table(faulty), *_of_quiet(quiet), *_of_faults(loud)] if faulty else []
    lines += _of_clean(clean)
    for name in ("calibrate", "diagnose"):
        mine = [r[name] for r in rows if name in r]
        failed = [one.get("failed", "") for one in mine]
        if mine:
            seconds = [one["cpu_s"] for one in mine]
            lines.append(share(f"{name}: refused", [text.startswith("REFUSED") for text in failed]))
            lines.append(share(f"{name}: raised", [text.startswith("RAISED") for text in failed]))
            lines.append(
                f"{name}: processor time, median {np.median(seconds):.1f} s, longest {max(seconds):.0f} s"
            )
    return "\n".join(lines)


def _of_faults(rows: Sequence[Row]) -> list[str]:
    lines = [
        share(
            f"faults above {TESTABLE:.0f} sigma: calibrate silent and wrong (<= 1 %)",
            [*map(silent_and_wrong, rows)],
        ),
        share("calibrate silent", [silent(r) for r in rows]),
        share("E covered by calibrate", [r["calibrate"]["covered"] for r in rows]),
    ]
    rows = [r for r in rows if "diagnose" in r]
    if not rows:
        return lines
    return [
        *lines,
        share("cause identified or in the set (85 %)", [*map(named, rows)]),
        share("wrong and sure (<= 1 %)", [*map(sure_and_wrong, rows)]),
        share("UNKNOWN", [r["diagnose"].get("verdict") == "UNKNOWN" for r in rows]),
        share("E covered by diagnose (>= 93 %)", [r["diagnose"]["covered"] for r in rows]),
    ]


def _of_clean(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    flags = [set(r["calibrate"].get("flags", ())) for r in rows]
    widths = [_width(r["calibrate"]) for r in rows if r["calibrate"].get("interval_MPa")]
    lines = [
        share("clean: model_insufficient (3 to 7 %)", ["model_insufficient" in one for one in flags]),
        share("clean: routes_contradict (<= 1 %)", ["routes_contradict" in one for one in flags]),
        share("clean: any flag", [bool(one - NO_ALARM) for one in flags]),
        share("clean: E covered by calibrate", [r["calibrate"]["covered"] for r in rows]),
        f"clean: E's interval over E, median {100 * np.median(widths or [np.nan]):.2f} %",
        f"clean: calibrate, median {np.median([r['calibrate']['cpu_s'] for r in rows]):.2f} s",
    ]
    rows = [r for r in rows if "diagnose" in r]
    if not rows:
        return lines
    verdicts = [r["diagnose"].get("verdict", "FAILED") for r in rows]
    widths = [_width(r["diagnose"]) for r in rows if r["diagnose"].get("interval_MPa")]
    tight = [bool(r["stated"]["tolerances"][0]) for r in rows]
    cried = [v != "ADEQUATE" for v in verdicts]
    return [
        *lines,
        share("clean: anything but ADEQUATE (3 to 7 %)", cried),
        share("  with tolerances stated and used", [c for c, t in zip(cried, tight, strict=True) if t]),
        share("clean: UNKNOWN (<= 3 %)", [v == "UNKNOWN" for v in verdicts]),
        share("clean: E covered by diagnose", [r["diagnose"]["covered"] for r in rows]),
        f"clean: E's interval of diagnose over E, median {100 * np.median(widths or [np.nan]):.2f} %",
    ]


def _width(one: Row) -> float:
    low, high = one["interval_MPa"]
    return float(2 * (high - low) / (high + low))


def _of_quiet(rows: Sequence[Row]) -> list[str]:
    """Return a line for each fault that cannot be tested."""
    return [
        f"not testable: {r['kind']} {r['seed']}, {r['strength']:.1f} sigma, E {100 * r['off_E']:+.1f} %, held by: "
        + " ".join(f"{n} {'yes' if r[n]['covered'] else 'no'}" for n in ("calibrate", "diagnose") if n in r)
        for r in rows
    ]


def _table(rows: Sequence[Row]) -> str:
    heads = (
        "testable",
        "sigma",
        "E off %",
        "silent",
        "sil.wrong",
        "cov.cal",
        "named",
        "sure wrong",
        "cov.diag",
        "s",
    )
    lines = ["kind             " + "".join(f"{one:>11s}" for one in heads)]
    for kind in RIGHT:
        mine = [r for r in rows if r["kind"] == kind]
        loud = [r for r in mine if r["strength"] >= TESTABLE]
        full = [r for r in loud if "diagnose" in r]
        if not mine:
            continue
        cells = [f"{len(loud)}/{len(mine)}", _median([r["strength"] for r in loud], "{:.0f}")]
        cells.append(_median([100 * abs(r["off_E"]) for r in loud], "{:.1f}"))
        counts: Sequence[tuple[Callable[[Row], bool], Sequence[Row]]] = (
            (silent, loud),
            (silent_and_wrong, loud),
            (lambda r: r["calibrate"]["covered"], loud),
            (named, full),
            (sure_and_wrong, full),
            (lambda r: r["diagnose"]["covered"], full),
        )
        cells += [str(sum(map(counted, of))) if of else "-" for counted, of in counts]
        cells.append(_median([r["diagnose"]["cpu_s"] for r in full], "{:.0f}"))
        lines.append(f"{kind:17s}" + "".join(f"{one:>11s}" for one in cells))
    return "\n".join(lines)


def _median(values: Sequence[float], form: str) -> str:
    return form.format(np.median(values)) if values else "-"
