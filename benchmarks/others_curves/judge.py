"""What is said of a recording, as plain numbers; and how often, with exact intervals."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.others_curves.recording import make
from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured, Observations
from tactilevision.recording import read_recording

SEED = 7
LEVELS = (0.01, 0.05, 0.10)
SEEN = 8.0  # std above which a hidden effect is to be found

Row = dict[str, Any]


def look(kind: str, seed: int, *, rich: bool = False, screen: bool = False, count: int = 0) -> Row:
    """Make one recording, look at it, and only then open the truth.

    A screen tests the straight law alone, so it is given one; a curve that theory allows is the search's business.
    """
    with tempfile.TemporaryDirectory() as folder:
        made = make(Path(folder), kind, seed, rich=rich, straight=screen, count=count)
        recording = read_recording(Path(folder))
        data = observe_curves(Measured(recording, curves=recording.curves))
    begin = time.process_time()
    try:
        said = _screened(data) if screen else _diagnosed(data)
    except Exception as fault:  # whatever is raised is a finding, and the rest goes on
        said = {"verdict": "RAISED", "failed": f"{type(fault).__name__}: {fault}"}
    return (
        {"seed": seed, "rich": rich, "screen": screen, "count": count}
        | asdict(made)
        | said
        | {"cpu_s": time.process_time() - begin}
    )


def _diagnosed(data: Observations) -> Row:
    from calibration.tasks.diagnose import diagnose

    found = diagnose(data, np.random.default_rng(SEED))
    modulus, before = found.after.youngs_modulus, found.before.youngs_modulus
    plain = found.alternative_explanation
    return {
        "verdict": found.verdict,
        "named": [effect.key for effect in found.effects],
        "set": list(found.candidates),
        "E_MPa": modulus.value,
        "interval_MPa": modulus.interval95,
        "interval_before_MPa": before.interval95,
        "left": [[c.key, c.p_adjusted] for c in found.covariates[:3]],
        "screen_p": [[s.key, s.p_adjusted] for s in found.score_test[:3]],
        "odd": list(found.odd.presses),
        "wanders": [list(one) for one in found.odd.wanders],
        "plain": None if plain is None else plain.key,
        "flags": list(found.flags),
        "held_out_over_floor": found.errors.held_out_after / max(found.errors.floor, 1e-12),
    }


def _screened(data: Observations) -> Row:
    from calibration.diagnosis.score_test import score_test
    from calibration.effects import EFFECTS
    from calibration.inputs.checks import clear_of_touch, usable
    from calibration.tasks.compare import base_fit, base_model

    data = clear_of_touch(usable(data))
    fitted = base_fit(base_model(data), data)
    found = score_test(fitted, list(EFFECTS.values()), rng=np.random.default_rng(SEED), of_rig=True)
    return {
        "verdict": "SCREENED",
        "screen_p": [[s.key, s.p_adjusted] for s in found.effects[:3]],
        "left": [[s.key, s.p_adjusted] for s in (*found.covariates, *found.others) if s.p_adjusted < 1],
        "family_p": found.family_p,
    }


def exact(hits: int, total: int, *, level: float = 0.95) -> tuple[float, float]:
    """The exact interval of a share (Clopper, Pearson, Biometrika 26 (1934) 404)."""
    from scipy.stats import beta

    low = 0.0 if hits == 0 else float(beta.ppf((1 - level) / 2, hits, total - hits + 1))
    high = 1.0 if hits == total else float(beta.ppf((1 + level) / 2, hits + 1, total - hits))
    return low, high


def share(what: str, hits: Sequence[bool]) -> str:
    """One line of the report."""
    if not hits:
        return f"{what:52s} -"
    low, high = exact(sum(hits), len(hits))
    said = f"{sum(hits):4d} of {len(hits):4d} = {100 * np.mean(hits):5.1f} %"
    return f"{what:52s} {said} ({100 * low:.1f} to {100 * high:.1f})"


def report(rows: Sequence[Row]) -> str:
    """The figures of all rows."""
    full, screened = [r for r in rows if not r["screen"]], [r for r in rows if r["screen"]]
    lines = [_of_screen(screened)] if screened else []
    if clean := [r for r in full if r["kind"] == "clean"]:
        lines += [
            share("clean: anything but ADEQUATE", [r["verdict"] != "ADEQUATE" for r in clean]),
            share("clean: UNKNOWN", [r["verdict"] == "UNKNOWN" for r in clean]),
        ]
        for kind in sorted({r["noise"] for r in clean}):
            mine = [r["verdict"] != "ADEQUATE" for r in clean if r["noise"] == kind]
            lines.append(share(f"  noise {kind}", mine))
    for kind in ("single", "pair"):
        loud = [r for r in full if r["kind"] == kind and r["strength"] >= SEEN]
        hidden = [set(r["sizes"]) for r in loud]
        within = [h <= set(r.get("set", ())) for h, r in zip(hidden, loud, strict=True)]
        first = [r.get("named", [])[:1] for r in loud]
        wrong = [
            r["verdict"] == "IDENTIFIED" and not set(r["named"]) <= h for r, h in zip(loud, hidden, strict=True)
        ]
        lines += (
            [
                share(f"{kind} above {SEEN:.0f} sigma: truth in the set", within),
                share(f"{kind}: first", [bool(set(f) & h) for f, h in zip(first, hidden, strict=True)]),
                share(f"{kind}: confidently wrong", wrong),
                share(f"{kind}: UNKNOWN", [r["verdict"] == "UNKNOWN" for r in loud]),
            ]
            if loud
            else []
        )
    if outside := [r for r in full if r["kind"] == "outside"]:
        matters = [r for r in outside if r["strength"] >= SEEN and not _holds(r, "interval_before_MPa")]
        lines += [
            share("outside: UNKNOWN", [r["verdict"] == "UNKNOWN" for r in outside]),
            share("outside: wrongly named", [r["verdict"] in ("IDENTIFIED", "AMBIGUOUS") for r in outside]),
            share("outside, E of the plain law off: UNKNOWN", [r["verdict"] == "UNKNOWN" for r in matters]),
        ]
    if full:
        lines += [
            share("E's interval holds the truth", [_holds(r, "interval_MPa") for r in full]),
            share("raised", [r["verdict"] == "RAISED" for r in full]),
            f"processor time: median {np.median([r['cpu_s'] for r in full]):.1f} s, "
            f"longest {max(r['cpu_s'] for r in full):.0f} s",
        ]
    return "\n".join(lines)


def _holds(row: Row, name: str) -> bool:
    interval = row.get(name)
    return interval is not None and interval[0] <= row["modulus_MPa"] <= interval[1]


def _of_screen(rows: Sequence[Row]) -> str:
    smallest = [row["family_p"] for row in rows if "family_p" in row]
    return "\n".join(share(f"screen: p <= {level}", [p <= level for p in smallest]) for level in LEVELS)
