"""What gets worse without an optional stage? One stage is switched off at a time, on identical data.

    python -m benchmarks.ablation [SUITE...] [--folder RECORDING...] [--lights N] [--sets SET...] [--stage WORD]

lights    balls and faces while all lamps are 7 % up or down, and under six kinds of drift with uneven stray light
          (light_drift.py): seeds 5400 to 5400 + N - 1
faces     faces of the good presses of simulated recordings, at their touches
presses   nu, E, c and clock of simulated recordings, presses tracked once
whole     the same, presses tracked anew
contacts  balls of real sets, the light calibrated on contacts of unknown shape

Each line: rms (of shares and counts the mean) with all stages, without one, and their ratio (difference) with the
90 % interval of a paired bootstrap. `benchmarks.mistakes` does the same for detectors of mistakes.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks import light_drift
from benchmarks.light_kinds import KINDS, drawn_gel, drifted, uneven
from benchmarks.own_contacts import FOLDS, KINDS as SENSORS, direction_errors, seen
from benchmarks.real_frames import REAL, ROOT, SETS, real_balls
from tactilevision.heightmap import deviation, reconstructor as reconstructing, self_calibration, walls
from tactilevision.heightmap.build import build_reconstructor
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric import drift
from tactilevision.photometric.storage import load_network
from tactilevision.press import bevel_contact, certification, clock
from tactilevision.recording.model import Recording
from tactilevision.recording.pictures import read_frame
from tactilevision.recording.read import read_recording
from tactilevision.records.measured import Bytes, Floats

FIRST_LIGHT = 5400
SAMPLES = ("gelslim3", "hidden_shadow")
FACE_MM = 1.5  # radius of the middle of a face
BOOTSTRAPS = 2000

Figures = Mapping[str, Floats]  # errors by figure, in one order whatever is switched off
Press = tuple[Bytes, Any, Any, float, str]  # picture, true depth, distance from the axis, contact radius, kind


@dataclass(frozen=True, slots=True)
class Stage:
    """An optional stage; `changes` (module or class, attribute, value) switch it off."""

    name: str
    changes: tuple[tuple[Any, str, Any], ...] = ()

    def off(self) -> ExitStack:
        """Switch it off until the end of a block."""
        stack = ExitStack()
        for owner, name, value in self.changes:
            stack.enter_context(mock.patch.object(owner, name, value))
        return stack


def _nothing(*given: Any, **named: Any) -> None:
    return None


def _no_list(*given: Any, **named: Any) -> list[Any]:
    return []


def _zero(first: Any, *given: Any, **named: Any) -> Any:
    return np.zeros_like(first)


WALLS = Stage("walls", ((reconstructing, "restore_windows", _no_list),))
MISFIT = Stage("misfit limit of walls", ((walls, "MAX_MISFIT", (np.inf, np.inf)),))
EDGE_FALL = Stage("finite strain at the edge of walls", ((walls, "EDGE_FALL", 0.0),))
GRIDS = Stage("two-grid Poisson", ((Reconstructor, "grids", None),))
DRIFT = Stage("model of the drift, robust gains left", ((drift, "MIN_DRIFT", np.inf),))


def _without(term: int) -> Callable[..., Any]:
    """Return the variances by walls without those of the steep edge (0) or of the cast shadow (1)."""
    plain = deviation.wall_variances

    def without(*given: Any, **named: Any) -> Any:
        found = plain(*given, **named)
        found[term] = 0
        return found

    return without


TERMS = {
    "zero plane": ("zero_variance", lambda zero, shape: np.float32(0.0)),
    "steep edge": ("wall_variances", _without(0)),
    "cast shadow": ("wall_variances", _without(1)),
}
STAGES = {
    "lights": (
        DRIFT,
        Stage("slopes outside contacts in the drift", ((drift, "likely_slopes", _nothing),)),
        GRIDS,
        WALLS,
        EDGE_FALL,
        *(Stage(f"deviation's {name}", ((deviation, *term),)) for name, term in TERMS.items()),
        Stage("deviation's illumination", ((deviation.DepthError, "_light", _nothing),)),
    ),
    "faces": (WALLS, MISFIT, EDGE_FALL, GRIDS, DRIFT),
    "presses": (
        Stage(
            "picture channel of the bevel's touch",
            ((bevel_contact, "find_in_pictures", lambda signals, onsets, **named: [None] * len(signals)),),
        ),
        Stage("fading memories of the clock", ((clock, "_MIN_GAIN", np.inf),)),
        Stage("travel scale", ((certification, "apply_travel_scale", lambda all_, events, **named: events),)),
        Stage("depth scale", ((certification, "find_depth_scale", _nothing),)),
    ),
    "whole": (WALLS, MISFIT, GRIDS, DRIFT),
    "contacts": (
        Stage("axes of round contacts", ((self_calibration, "round_equations", _nothing),)),
        Stage("reweighted equations", ((self_calibration, "MAX_ITERATIONS", 1),)),
    ),
}


# Lights.


@lru_cache
def _light(seed: int) -> dict[str, tuple[Reconstructor, list[Press]]]:
    """Return a reader and presses while all lamps are up or down alike, and under six kinds of drift."""
    rng = np.random.default_rng([seed, 1])
    plain, found = light_drift._camera(seed, rng), dict[str, tuple[Reconstructor, list[Press]]]()
    for name, camera in (("alike", plain), ("six kinds", uneven(plain, rng))):
        reader, pictures = light_drift._calibrated(camera, rng), list[Press]()
        for what, leans in KINDS if name == "six kinds" else 3 * KINDS[:1]:
            for kind, centre, contact, press in light_drift._presses(drawn_gel(light_drift.FACE_MM, 3.0, rng)):
                if rng.random() < 0.5:
                    continue
                if name == "alike":
                    light = camera.ideal(press) * np.float32(rng.choice([0.93, 1.07]))
                else:
                    light = drifted(camera, press, what, leans=leans, rng=rng)
                place = press.depth_mm(camera.grid), camera.grid.distance(centre)
                pictures.append((camera.expose(light, rng), *place, contact, kind))
        found[name] = reader, pictures
    return found


def lights(options: argparse.Namespace) -> Iterator[Figures]:
    """Yield relative errors of balls and steps, errors of the gel outside (um), shares within one deviation."""
    for seed in range(FIRST_LIGHT, FIRST_LIGHT + options.lights):
        for drifting, (reader, pictures) in _light(seed).items():
            fresh = replace(reader)  # without what it has cached
            rows: dict[str, list[float]] = {}
            for rgb, true, r, contact, kind in pictures:
                height = fresh.rectified_map(rgb)
                assert height.std_mm is not None
                middle, off = r < (0.15 if kind == "balls" else 0.85 * contact), height.depth_mm - true
                outside, what = (r > 1.15 * contact) & (r < contact + 4), f"{drifting}, {kind}"
                rms_um = 1e3 * float(np.sqrt(np.mean(off[outside] ** 2)))
                rows.setdefault(f"{what}, peak", []).append(float(off[middle].mean() / true[middle].mean()))
                rows.setdefault(f"{what}, gel outside, um", []).append(rms_um)
                for name, part in (("under", r < 0.9 * contact), ("outside", outside)):
                    share = float(np.mean(np.abs(off[part]) < height.std_mm[part]))
                    rows.setdefault(f"{what}, share within 1 sigma {name}", []).append(share)
            yield {name: np.array(one) for name, one in rows.items()}


# Recordings.


@lru_cache
def _read(folder: Path) -> tuple[Recording, Reconstructor, dict[str, Any]]:
    recording = read_recording(folder)
    reader = build_reconstructor(recording, "polynomial" if recording.balls else None)
    return recording, reader, tomllib.loads((folder / "truth.toml").read_text())


@lru_cache
def _picture(folder: Path, index: int) -> Bytes:
    recording, reader, _ = _read(folder)
    return reader.rectified(read_frame(recording, index))


def faces(options: argparse.Namespace) -> Iterator[Figures]:
    """Yield the relative errors of each recording's faces, read at their touches."""
    for number, folder in enumerate(options.folder):
        recording, reader, truth = _read(folder)
        fresh, off, times = replace(reader), [], recording.frame_times_s
        for press in (one for one in truth["press"] if one["good"]):
            after = int(np.searchsorted(times, press["touch_time_s"]))
            read = [_face_mm(fresh, folder, k, press) for k in (after - 1, after)]
            at = float(np.interp(press["touch_time_s"], times[after - 1 : after + 1], read))
            off.append(at / press["depth_mm"] - 1)
        yield {f"face, {number}, {folder.name}": np.array(off), "face, all": np.array(off)}


def _face_mm(reader: Reconstructor, folder: Path, index: int, press: Mapping[str, Any]) -> float:
    """Return the mean depth of a face's middle."""
    height = reader.rectified_map(_picture(folder, index))
    rows, columns = height.depth_mm.shape
    x, y = (
        (np.arange(n) - (n - 1) / 2) * step - centre
        for n, step, centre in zip((columns, rows), height.mm_per_px, press["centre_mm"], strict=True)
    )
    return float(height.depth_mm[np.hypot(x[None, :], y[:, None]) < FACE_MM].mean())


@lru_cache
def _tracks(folder: Path) -> tuple[Any, list[float], list[float]]:
    """Return what the camera saw of each press, and what `_track_all` lists along."""
    recording, reader, _ = _read(folder)
    repeats: list[float] = []
    blocks: list[float] = []
    tracks = certification._track_all(recording, replace(reader), _nothing, repeats, blocks)
    return tracks, repeats, blocks


def presses(options: argparse.Namespace) -> Iterator[Figures]:
    """Yield each recording's errors of nu, E, c (relative but for nu), and the clock's (ms); lost and missed."""
    for folder in options.folder:
        found, judged, truth = _calibrated(folder)
        good = {press["press"]: press["good"] for press in truth["press"]}
        yield {
            "nu": np.array([found["poisson_ratio"] - truth["poisson_ratio"]]),
            "E": np.array([found["youngs_modulus_MPa"] / truth["youngs_modulus_MPa"] - 1]),
            "c": np.array([found["c_N_per_mm"] / truth["c_N_per_mm"] - 1]),
            "clock, ms": 1e3 * np.array([found["clock_offset_s"] - truth["clock_offset_s"]]),
            "good presses lost, share": np.array([float(one and not judged[name]) for name, one in good.items()]),
            "bad presses missed, share": np.array([float(not one and judged[name]) for name, one in good.items()]),
        }


def _calibrated(folder: Path) -> tuple[dict[str, float], dict[str, bool], dict[str, Any]]:
    """Return what a calibration finds (NaN for nothing), which presses it accepts, and the truth."""
    from tactilevision.pipeline import CertifiedRecording, calibrate_certified
    from tactilevision.press.poisson_from_rise import with_nu

    recording, reader, truth = _read(folder)
    tracks, repeats, blocks = _tracks(folder)

    def again(recording: Any, reader: Any, progress: Any, into: list[float], steps: list[float]) -> Any:
        into += repeats
        steps += blocks
        return tracks

    fresh = replace(reader)
    with mock.patch.object(certification, "_track_all", again):
        certificate = certification.certify(recording, fresh)
    certificate, nu = with_nu(recording, fresh, certificate=certificate)
    content = calibrate_certified(CertifiedRecording(recording, certificate, fresh, nu), test=False).content
    keys = ("poisson_ratio", "youngs_modulus_MPa", "c_N_per_mm", "clock_offset_s")
    values = ((content.get(key) or {}).get("value") for key in keys)
    found = {key: np.nan if value is None else value for key, value in zip(keys, values, strict=True)}
    return found, {point.press: point.accepted for point in certificate.points}, truth


def whole(options: argparse.Namespace) -> Iterator[Figures]:
    """Yield the figures of `presses`, tracked anew."""
    _tracks.cache_clear()
    return presses(options)


# Real sets.


@lru_cache
def _contacts(name: str) -> Any:
    reference, pictures, mm_per_px = real_balls(name)
    network = load_network(ROOT / "models" / f"{SENSORS[name]}.onnx", reference).law.at
    return *seen(reference, pictures, mm_per_px), network


def contacts(options: argparse.Namespace) -> Iterator[Figures]:
    """Yield each held-out ball's direction error (degrees) by the light of other frames' contacts."""
    for name in options.sets:
        found, samples, network = _contacts(name)
        for prior, words in ((network, "with network"), (None, "without")):
            slopes = []
            for fold in range(FOLDS):
                others = [one for k, one in enumerate(found) if k % FOLDS != fold and one is not None]
                law = self_calibration.calibrate_on_contacts(others, prior)
                here = [one for one in samples if one.press[0] % FOLDS == fold]
                slopes += [
                    (one.slopes * np.nan if law is None else law.at(one.change, one.place), one) for one in here
                ]
            turned = direction_errors([one for one, _ in slopes], [one for _, one in slopes])
            yield {f"direction, {name}, {words}": np.array([np.median(one) for one in turned])}


SUITES: dict[str, Callable[[argparse.Namespace], Iterator[Figures]]] = {
    one.__name__: one for one in (lights, faces, presses, whole, contacts)
}


def measured(suite: str, options: argparse.Namespace) -> dict[str, Floats]:
    """Return the errors of a suite, joined over its data."""
    joined: dict[str, list[Floats]] = {}
    for figures in SUITES[suite](options):
        for name, values in figures.items():
            joined.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in joined.items()}


def compared(before: Floats, after: Floats, *, share: bool) -> str:
    """Return both figures, and their paired ratio, of shares their difference, with its 90 % interval."""
    draws = np.random.default_rng(0).integers(0, len(before), (BOOTSTRAPS, len(before)))

    def figure(values: Floats) -> Any:
        return values.mean(axis=-1) if share else np.sqrt(np.mean(values**2, axis=-1))

    def change(a: Any, b: Any) -> Any:
        return b - a if share else b / np.maximum(a, 1e-12)

    low, high = np.quantile(change(figure(before[draws]), figure(after[draws])), [0.05, 0.95])
    a, b = figure(before), figure(after)
    what = "difference" if share else "ratio"
    return f"{a:.4g}, {b:.4g} without; {what} {change(a, b):.3f} [{low:.3f}, {high:.3f}]"


def main(arguments: Sequence[str] = ()) -> None:
    """Print the table of each suite."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablation")
    parser.add_argument("suite", nargs="*", default=list(SUITES))
    samples = [ROOT / "sample_frames" / one for one in SAMPLES]
    parser.add_argument("--folder", type=Path, nargs="+", default=samples)
    parser.add_argument("--lights", type=int, default=2)
    parser.add_argument("--sets", nargs="+", default=list(SETS) if REAL.is_dir() else [])
    parser.add_argument("--stage", default="")
    options = parser.parse_args(arguments)
    for suite in options.suite:
        before = measured(suite, options)
        print(f"{suite}: " + "; ".join(f"{name} {len(values)}" for name, values in before.items()), flush=True)
        for stage in (one for one in STAGES[suite] if options.stage in one.name):
            with stage.off():
                after = measured(suite, options)
            print(f"  without {stage.name}", flush=True)
            for name, values in before.items():
                if not np.array_equal(values, after[name], equal_nan=True):
                    print(f"    {name}: {compared(values, after[name], share='share' in name)}", flush=True)


def quick() -> None:
    main(["faces", "--folder", str(ROOT / "sample_frames" / "gelslim3"), "--stage", "misfit"])


if __name__ == "__main__":
    main(sys.argv[1:])
