"""
A sensor of your own
====================

Rectify a raw picture, determine its scale along x and y, and write both to a file.
A plate of dots at a known spacing is pressed into the gel (simulated here, with lens distortion). Without
distortion, the four corners of a rectangle of known size suffice.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactilevision import find_grid, rectify, save_rectification, sensor_from_corners, sensor_from_grid

ROWS, COLUMNS, SPACING_MM = 7, 9, 2.0


def picture_of_the_plate() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return a simulated picture of 560 by 400 px; yours comes from the camera, red first."""
    y, x = np.mgrid[:400, :560].astype(float)
    u, v = (x - 275) / 280, (y - 205) / 200
    swell = 1 + 0.12 * (u**2 + v**2)
    across, down = 10.5 * u * swell, 7.9 * v * swell  # mm on the gel
    ink = np.zeros_like(x)
    for i in range(ROWS):
        for j in range(COLUMNS):
            away = np.hypot(across - SPACING_MM * (j - COLUMNS // 2), down - SPACING_MM * (i - ROWS // 2))
            ink = np.maximum(ink, 0.5 * (1 - np.tanh((away - 0.4) / 0.06)))
    lit = np.stack([100 + 60 * u, 110 - 40 * v, 105 + 30 * u], axis=-1)
    return np.asarray(lit * (1 - 0.6 * ink[..., None]), np.uint8)


def main() -> None:
    raw = picture_of_the_plate()
    sensor = sensor_from_grid(find_grid(raw, ROWS, columns=COLUMNS), SPACING_MM)
    x, y = sensor.mm_per_px
    print(f"grid: {sensor.width_px} by {sensor.height_px} px straightened, {x:.4f} by {y:.4f} mm a pixel")
    rectified = rectify(sensor, raw)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    left.imshow(raw)
    left.set(title="raw picture of the plate (px)")
    right.imshow(rectified, extent=(0, x * sensor.width_px, y * sensor.height_px, 0))
    right.set(title="rectified (mm)")
    figure.savefig("custom_sensor.png", dpi=150)

    save_rectification(sensor, "maps.npz")
    Path("sensor.toml").write_text(
        f'[sensor]\nkind = "custom"\nwidth_px = {sensor.width_px}\nheight_px = {sensor.height_px}\n'
        f'mm_per_px = [{x:.6f}, {y:.6f}]\nrectification = "maps.npz"\n'
    )
    print("wrote maps.npz and sensor.toml: the [sensor] of recording.toml, or depth --sensor sensor.toml")

    corners = sensor_from_corners([(48, 52), (512, 70), (508, 350), (52, 338)], (18.0, 12.0))
    print(f"corners: {corners.width_px} by {corners.height_px} px, {corners.mm_per_px[0]:.4f} mm a pixel along x")


if __name__ == "__main__":
    main()
