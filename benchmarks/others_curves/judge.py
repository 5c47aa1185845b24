"""What is said of a recording, as plain numbers; and how often, with exact intervals."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.others_curves.hidden import NAMES
from benchmarks.others_curves.recording import Made, make
from benchmarks.others_curves.strength import SEEN, TOLD_APART
from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured, Observations
from tactilevision.recording.read import read_recording

SEED = 7
LEVELS = (0.01, 0.05, 0.10)
HOLDS = 0.90  # of readings in their 95 % interval: with fewer a force, or a depth, has left it

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
        said = _screened(data) if screen else _diagnosed(data, made)
    except Exception as fault:  # whatever is raised is a finding, and the rest goes on
        said = {"verdict": "RAISED", "failed": f"{type(fault).__name__}: {fault}"}
    return (
        {"seed": seed, "rich": rich, "screen": screen, "count": count}
        | made.told
        | said
        | {"cpu_s": time.process_time() - begin}
    )


def _diagnosed(data: Observations, made: Made) -> Row:
    from calibration.tasks.diagnose import diagnose

    found = diagnose(data, np.random.default_rng(SEED))
    modulus, before = found.material.after.youngs_modulus, found.material.before.youngs_modulus
    return {
        "verdict": found.verdict,
        "named": [effect.key for effect in found.effects],
        "set": list(found.candidates),
        "E_MPa": modulus.value,
        "interval_MPa": modulus.interval95,
        "interval_before_MPa": before.interval95,
        "readings_held": _held(made, found.fits.base.noise.parts(found.fits.base.about.base_N)),
        "left": [[c.key, c.p_adjusted] for c in found.search.covariates[:3]],
        "screen_p": [[s.key, s.p_adjusted] for s in found.search.score_test[:3]],
        "odd": list(found.presses.odd.presses),
        "wanders": [list(one) for one in found.presses.odd.wanders],
        "flags": list(found.flags),
        "held_out_over_floor": found.errors.held_out_after / max(found.errors.floor, 1e-12),
    }


def _held(made: Made, said: Mapping[str, float]) -> float:
    """Of one press's readings in the gel, the share that its 95 % interval holds about the plain law.

    As wide as the noise was `said` to be (samples' in the middle, a press's gain and zero), about a force that is
    off by what that law leaves; as many as the true noise puts there. A depth is read from a force by the same
    slope, so that it holds for both.
    """
    from scipy.special import ndtr

    inside = made.force_N > 0
    force, slope, off = (one[inside] for one in (made.force_N, made.slope_N_per_mm, made.off_N))
    true_N = np.hypot(made.reader.force_N, made.reader.depth_mm * slope)
    told_N = 1e-3 * said["sample_mN"] * true_N / np.median(true_N)
    own = np.sqrt(true_N**2 + (made.reader.gain * force) ** 2 + (made.reader.zero_mm * slope) ** 2)
    gain, zero_mm = said["press_gain_percent"] / 100, said["press_zero_um"] / 1e3
    wide = np.sqrt(told_N**2 + (gain * force) ** 2 + (zero_mm * slope) ** 2)
    return float(np.mean(ndtr((1.96 * wide - off) / own) - ndtr((-1.96 * wide - off) / own)))


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
    of = {kind: [r for r in full if r["kind"] == kind] for kind in ("clean", "single", "pair", "outside")}
    lines = [_of_screen(screened)] if screened else []
    lines += _of_clean(of["clean"]) if of["clean"] else []
    for kind in ("single", "pair"):
        lines += _of_hidden(kind, [r for r in of[kind] if min(r["each"].values()) >= SEEN])
    lines += _of_outside(of["outside"]) if of["outside"] else []
    lines += _of_near([r for r in full if r["kind"] == "near"])
    if full:
        seconds = [r["cpu_s"] for r in full]
        lines += [
            share("E's interval holds the truth", [_holds(r, "interval_MPa") for r in full]),
            share("raised", [r["verdict"] == "RAISED" for r in full]),
            f"processor time: median {np.median(seconds):.1f} s, longest {max(seconds):.0f} s",
        ]
    return "\n".join(lines)


def _of_clean(rows: Sequence[Row]) -> list[str]:
    lines = [
        share("clean: anything but ADEQUATE", [r["verdict"] != "ADEQUATE" for r in rows]),
        share("clean: UNKNOWN", [r["verdict"] == "UNKNOWN" for r in rows]),
    ]
    kinds = sorted({r["noise"] for r in rows})
    cried = {kind: [r["verdict"] != "ADEQUATE" for r in rows if r["noise"] == kind] for kind in kinds}
    return lines + [share(f"  noise {kind}", cried[kind]) for kind in kinds]


def _of_hidden(kind: str, loud: Sequence[Row]) -> list[str]:
    if not loud:
        return []
    hidden = [set(r["sizes"]) for r in loud]
    within = [h <= set(r.get("set", ())) for h, r in zip(hidden, loud, strict=True)]
    first = [bool(set(r.get("named", [])[:1]) & h) for h, r in zip(hidden, loud, strict=True)]
    wrong = [r["verdict"] == "IDENTIFIED" and not set(r["named"]) <= h for h, r in zip(hidden, loud, strict=True)]
    near = [r["verdict"] == "AMBIGUOUS" for r in loud if r["near"]]
    return [
        share(f"{kind} above {SEEN:.0f} sigma: truth in the set", within),
        share(f"{kind}: first", first),
        share(f"{kind}: confidently wrong", wrong),
        share(f"{kind}: UNKNOWN", [r["verdict"] == "UNKNOWN" for r in loud]),
        share(f"{kind}, another within {TOLD_APART:.0f} sigma: AMBIGUOUS", near),
    ]


def _of_near(rows: Sequence[Row]) -> list[str]:
    """Where another effect lies so near that a set is to be told."""
    if not rows:
        return []
    held = [set(r["sizes"]) <= set(r.get("set", ())) for r in rows]
    told = [r["verdict"] == "AMBIGUOUS" for r in rows]
    verdicts = {v: [r["verdict"] == v for r in rows] for v in ("IDENTIFIED", "UNKNOWN", "ADEQUATE")}
    wrong = [one and not h for one, h in zip(verdicts["IDENTIFIED"], held, strict=True)]
    return [
        share(f"another within {TOLD_APART:.0f} sigma: AMBIGUOUS", told),
        share("  with the truth in the set", [t and h for t, h in zip(told, held, strict=True)]),
        share("  truth in the set, whatever the verdict", held),
        *(share(f"  {verdict}", hits) for verdict, hits in verdicts.items()),
        share("  IDENTIFIED, and wrong", wrong),
    ]


def _of_outside(rows: Sequence[Row]) -> list[str]:
    lines = []
    known = [r for r in rows if set(r["sizes"]) <= set(NAMES)]
    rows = [r for r in rows if r not in known]
    lines.append(share("an instrument's error: in the set", [_right(r) for r in known]))
    for name, mine in (("", rows), (", where it matters", [r for r in rows if _matters(r)])):
        named = [r["verdict"] in ("IDENTIFIED", "AMBIGUOUS") for r in mine]
        lines.append(share(f"outside{name}: UNKNOWN", [r["verdict"] == "UNKNOWN" for r in mine]))
        lines.append(share(f"outside{name}: wrongly named", named))
    return lines


def _right(row: Row) -> bool:
    return {NAMES[key] for key in row["sizes"]} <= set(row.get("set", ()))


def _holds(row: Row, name: str) -> bool:
    interval = row.get(name)
    return interval is not None and interval[0] <= row["modulus_MPa"] <= interval[1]


def _matters(row: Row) -> bool:
    """Whether the plain law's E, or a force or a depth that is read by it, leaves its 95 % interval."""
    return not _holds(row, "interval_before_MPa") or row.get("readings_held", 1.0) < HOLDS


def _of_screen(rows: Sequence[Row]) -> str:
    smallest = [row["family_p"] for row in rows if "family_p" in row]
    return "\n".join(share(f"screen: p <= {level}", [p <= level for p in smallest]) for level in LEVELS)
