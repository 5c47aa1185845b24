"""
A control loop, one frame at a time
===================================

A stream reads frames as a camera delivers them and reports contact, depth and place.
"""

from itertools import islice
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactilevision import BadFrame, Stream, build_reconstructor, iter_frames, read_recording

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"


def draw(names: list[str], peaks_mm: list[float]) -> None:
    """Plot the greatest depth of every frame; 0 if nothing touches."""
    figure, axes = plt.subplots(figsize=(7, 3.2), layout="constrained")
    axes.plot(range(len(names)), peaks_mm, "o-", color="#00429d")
    axes.set(xlabel="frame", ylabel="greatest depth (mm)", title="What the stream says of each frame")
    figure.savefig("live_loop.png", dpi=150)


def main() -> None:
    recording = read_recording(SAMPLE)
    stream = Stream(build_reconstructor(recording), recording.indenters["A1"])
    names: list[str] = []
    peaks_mm: list[float] = []
    latencies_ms: list[float] = []
    for frame in islice(iter_frames(recording), 40):
        if isinstance(frame, BadFrame):
            print(f"{frame.name}: passed over, {frame.why}")
            continue
        seen = stream.take(frame)
        names.append(frame.name)
        peaks_mm.append(seen.peak_mm)
        latencies_ms.append(seen.latency_ms)
        place = seen.footprint.centre_mm if seen.footprint else None
        where = f" at ({place[0]:+.2f}, {place[1]:+.2f}) mm" if place else ""
        print(f"{frame.name}: {f'contact, {seen.peak_mm:.3f} mm deep' if seen.contact else 'free'}{where}")
    draw(names, peaks_mm)
    print(f"latency: {np.median(latencies_ms):.1f} ms, 95 % below {np.percentile(latencies_ms, 95):.1f} ms")


if __name__ == "__main__":
    main()
