"""A stream that runs for hours: memory against frames, and how long each frame took.

python -m benchmarks.stream [frames] [width of a frame in pixels]
A few simulated frames, with and without contact, are repeated, 100,000 unless told; 1.3 million are four hours
at 90 a second.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.vision import calibrated
from tactilevision.records.maps import Frame
from tactilevision.records.rig import Indenter
from tactilevision.robots.live import Stream
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.punch import PunchPress, punch_profile

DEPTHS_MM = (*[0.0] * 40, 0.05, 0.1, 0.2, 0.4, 0.3, 0.05)  # one touch in half a second
WARM = 200  # frames until all buffers are made
REPORTS = 26


def main(frames: int = 100_000, width: int = 320) -> None:
    camera, reconstructor = calibrated((width, 3 * width // 4), 2, "polynomial")
    profile = punch_profile(0.48, 2.5, 3.0)
    pictures = [
        Frame(camera.picture(PunchPress(profile, w, (1.0, -0.7)) if w else Flat(), np.random.default_rng(i)))
        for i, w in enumerate(DEPTHS_MM)
    ]
    stream = Stream(reconstructor, Indenter("punch", radius_mm=2.5), renew=0.01)
    warm_kB, latencies_ms = 0, np.zeros(frames)
    for number in range(frames):
        moment = stream.take(pictures[number % len(pictures)])
        contact, latencies_ms[number] = moment.contact, moment.latency_ms
        if contact != (DEPTHS_MM[number % len(pictures)] > 0):
            raise RuntimeError(f"frame {number} is said to be {'touched' if contact else 'free'}")
        if number == WARM:
            warm_kB = resident_kB()
        if (number + 1) % max(1, frames // REPORTS) == 0:
            print(
                f"{number + 1} frames, {resident_kB()} kB, {time.process_time():.0f} s of the processor",
                flush=True,
            )
    print(f"{frames} frames {width} wide: memory grew by {resident_kB() - warm_kB} kB after the first {WARM}")
    for percent in (5, 50, 95, 99, 100):
        print(f"  {percent:3d} % within {np.percentile(latencies_ms, percent):5.1f} ms")


def resident_kB() -> int:
    """Memory that this process holds now."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:"))


def quick() -> None:
    main(300, 160)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
