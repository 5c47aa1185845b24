"""One frame of a recording into a height map, and what the map says of its own error.

The sensor, its untouched reference and the balls that its light is calibrated on all stand in the recording.
"""

from pathlib import Path

import numpy as np

from tactilevision import build_reconstructor, read_frame, read_recording, write_tiff

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"


def main() -> None:
    recording = read_recording(SAMPLE)
    reconstructor = build_reconstructor(recording)
    held = next(press for press in recording.presses if press.indenter == "A3")
    index = int(np.searchsorted(recording.frame_times_s, held.end_s)) - 12
    height = reconstructor.height_map(read_frame(recording, index))

    deepest = np.unravel_index(np.argmax(height.depth_mm), height.depth_mm.shape)
    assert height.std_mm is not None
    depth, std = height.depth_mm[deepest], height.std_mm[deepest]
    print(f"frame {height.name}: {depth:.3f} ± {std:.3f} mm deep at its deepest")
    print(f"the gel beside rises to {-1e3 * height.depth_mm.min():.0f} µm above its untouched level")
    print(f"{100 * height.valid.mean():.1f} % of the picture could be read; {height.mm_per_px[0]:.4f} mm a pixel")
    write_tiff("height.tiff", height)
    print("wrote height.tiff (float32, mm, NaN where it could not be read)")


if __name__ == "__main__":
    main()
