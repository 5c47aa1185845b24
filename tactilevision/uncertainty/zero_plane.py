"""The term of the zero plane: where depth 0 lies is read off the untouched gel, and no better than it is flat.

    variance = std_0^2 + (std_x X)^2 + (std_y Y)^2      X and Y from -1 to 1 over the picture

std_0 of the plane at the picture's centre and std_x, std_y of its tilt are those of the fit
(integration/zero_plane.py), with errors that hang together over a tenth of the picture. Vanishes where untouched
blocks all lie in one plane. What offset and tilt have in common is left out: it is none where they lie evenly.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactilevision.integration.zero_plane import ZeroPlane


def zero_variance(zero: ZeroPlane, shape: tuple[int, ...]) -> npt.NDArray[np.float32]:
    """Variance (H, W) mm² by the plane `zero` over a picture of this `shape`."""
    sides = zip(zero.tilt_std_mm, shape[::-1], strict=True)
    x, y = ((std * np.linspace(-1, 1, count)) ** 2 for std, count in sides)
    return np.asarray(y[:, None] + (x + zero.std_mm**2), dtype=np.float32)
