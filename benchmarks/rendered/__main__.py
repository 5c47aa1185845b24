"""Gel as a path tracer draws it: python -m benchmarks.rendered --out FOLDER --kind balls steps --seed 1."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.rendered.camera import build_camera
from benchmarks.rendered.compare import keep, report
from benchmarks.rendered.cut import cut
from benchmarks.rendered.families import draw_rig
from benchmarks.rendered.judge import report as judge
from benchmarks.rendered.nu_of_steps import report as nu_of_steps
from benchmarks.rendered.path_tracer import Transport
from benchmarks.rendered.read import report as read
from benchmarks.rendered.record import write_rendered_recording
from benchmarks.rendered.sets import write_set
from benchmarks.rendered.taught import report as taught

CACHE = Path(tempfile.gettempdir()) / "tactilevision-rendered"


def main(arguments: Sequence[str] = ()) -> None:
    """Render what is asked for."""
    options = _options().parse_args(list(arguments))
    if options.keep is not None:
        keep(options.keep, options.seed, options.cache)
        return
    if options.judge:
        judge(options.judge)
        return
    if options.taught:
        taught(options.taught)
        return
    if options.nu:
        nu_of_steps(options.nu)
        return
    if options.read:
        read(options.read, results=options.results)
        return
    if options.compare:
        report(range(options.seed, options.seed + 3), options.cache)
        return
    if options.out is None:
        raise SystemExit("--out says where to write; --compare needs none")
    if options.cut is not None:
        cut(options.cut, options.out)
        return
    _render(options)


def _render(options: argparse.Namespace) -> None:
    """A recording or a set of frames into options.out, with the time that each part took."""
    transport: Transport = "unshadowed" if options.no_shadows else "path"
    camera = build_camera(
        draw_rig(options.family, options.seed), options.cache, transport=transport, samples=options.samples
    )
    start = time.perf_counter()
    kinds = set(options.kind)

    def progress(what: object, of: object = "") -> None:
        print(f"{time.perf_counter() - start:7.1f} s  {what} {of}", flush=True)

    if "recording" in kinds:
        write_rendered_recording(
            options.out, camera, presses=options.presses, balls=options.balls, progress=progress
        )
    else:
        write_set(
            options.out,
            camera,
            balls=options.balls,
            steps=options.steps if "steps" in kinds else 0,
            progress=progress,
        )


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.rendered", description=__doc__)
    parser.add_argument("--out", type=Path, help="folder of the recording")
    parser.add_argument("--kind", nargs="+", choices=("balls", "steps", "recording"), default=["balls", "steps"])
    parser.add_argument("--family", choices=("train", "bench"), default="train", help="which lamps and inks")
    parser.add_argument("--seed", type=int, default=1, help="of lamps, ink, camera, gel and presses")
    parser.add_argument("--no-shadows", action="store_true", help="direct light that reaches every place")
    parser.add_argument("--samples", type=int, default=16, help="light paths per pixel and lamp")
    parser.add_argument("--steps", type=int, default=8, help="frames of flat punches")
    parser.add_argument("--presses", type=int, default=3, help="good presses of each indenter in a recording")
    parser.add_argument("--compare", action="store_true", help="the simulator's shadows beside Mitsuba's")
    parser.add_argument("--judge", type=Path, nargs="+", help="sets whose height maps are held against the truth")
    parser.add_argument(
        "--taught", type=Path, nargs="+", help="sets of which half the faces teach the other half's walls"
    )
    parser.add_argument("--nu", type=Path, nargs="+", help="sets whose steps tell nu, by picture and by truth")
    parser.add_argument("--read", type=Path, nargs="+", help="recordings calibrated and held against the truth")
    parser.add_argument(
        "--results", type=Path, help="with --read: keeps calibrations; those of the same sources are not made anew"
    )
    parser.add_argument("--cut", type=Path, help="rendered recording whose good presses become a sample")
    parser.add_argument("--keep", type=Path, help="npz for one rig and step of that comparison, for the tests")
    parser.add_argument("--balls", type=int, default=24, help="reference pictures of balls")
    parser.add_argument("--cache", type=Path, default=CACHE, help="keeps what was rendered")
    return parser


if __name__ == "__main__":
    main(sys.argv[1:])
