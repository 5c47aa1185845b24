"""Frames one at a time, as a control loop has them: contact or not, how deep, where, and how long it took."""

from itertools import islice
from pathlib import Path

from tactilevision import build_reconstructor, iter_frames, read_recording
from tactilevision.live import Stream
from tactilevision.recording import BadFrame

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"


def main() -> None:
    recording = read_recording(SAMPLE)
    stream = Stream(build_reconstructor(recording), recording.indenters["A1"])
    for frame in islice(iter_frames(recording), 40):
        if isinstance(frame, BadFrame):
            print(f"{frame.name}: passed over, {frame.why}")
            continue
        seen = stream.take(frame)
        place = seen.footprint.centre_mm if seen.footprint else None
        where = f" at ({place[0]:+.2f}, {place[1]:+.2f}) mm" if place else ""
        print(f"{frame.name}: {f'contact, {seen.peak_mm:.3f} mm deep' if seen.contact else 'free'}{where}")
    print("latency in ms: " + ", ".join(f"{count} below {edge:g}" for edge, count in stream.histogram() if count))


if __name__ == "__main__":
    main()
