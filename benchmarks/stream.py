"""A stream that runs for hours: memory against frames, and how long each frame took.

python -m benchmarks.stream [frames]
A few simulated frames, with and without contact, are repeated; 1.3 million are four hours at 90 a second.
"""

from __future__ import annotations

import resource
import sys

import numpy as np

from benchmarks.vision import calibrated
from tactilevision.live import Stream
from tactilevision.records import Frame, Indenter
from tactilevision.synthetic.gel import Flat
from tactilevision.synthetic.profile import punch_profile
from tactilevision.synthetic.punch import PunchPress

SIZE = (320, 240)
DEPTHS_MM = (0.0, 0.0, 0.05, 0.1, 0.2, 0.4)
WARM = 200  # frames until all buffers are made


def main(frames: int = 1_300_000) -> None:
    camera, reconstructor = calibrated(SIZE, 2, "polynomial")
    profile = punch_profile(0.48, 2.5, 3.0)
    pictures = [
        Frame(camera.picture(PunchPress(profile, w, (1.0, -0.7)) if w else Flat(), np.random.default_rng(i)))
        for i, w in enumerate(DEPTHS_MM)
    ]
    stream = Stream(reconstructor, Indenter("punch", radius_mm=2.5), renew=0.01)
    for number in range(frames):
        stream.take(pictures[number % len(pictures)])
        if number == WARM:
            warm_kB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown_kB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - warm_kB
    print(f"{frames} frames of {SIZE[0]}x{SIZE[1]}: memory grew by {grown_kB} kB after the first {WARM}")
    for edge, count in stream.histogram():
        print(f"  up to {edge:5.1f} ms: {count}")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
