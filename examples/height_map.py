"""
A frame into a height map
=========================

Compute a depth map of one frame, with the standard deviation of every pixel.
The recording holds the sensor, its untouched reference, and ball presses that calibrate the light.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactilevision import HeightMap, build_reconstructor, read_frame, read_recording, write_tiff

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"


def draw(height: HeightMap) -> None:
    """Plot depth and its standard deviation."""
    rows, columns = height.depth_mm.shape
    extent = (0.0, columns * height.mm_per_px[0], rows * height.mm_per_px[1], 0.0)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for axes, field, title in ((left, height.depth_mm, "depth (mm)"), (right, height.std_mm, "std (mm)")):
        shown = axes.imshow(field, extent=extent, cmap="cividis")
        axes.set(title=title, xlabel="x (mm)", ylabel="y (mm)")
        figure.colorbar(shown, ax=axes, shrink=0.85)
    figure.savefig("height_map.png", dpi=150)


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
    print(f"the gel next to it rises to {-1e3 * height.depth_mm.min():.0f} µm above its untouched level")
    print(f"{100 * height.valid.mean():.1f} % of the picture could be read; {height.mm_per_px[0]:.4f} mm a pixel")
    write_tiff("height.tiff", height)
    draw(height)
    print("wrote height.tiff (float32, mm, NaN where it could not be read)")


if __name__ == "__main__":
    main()
