"""What a ceiling of slopes leaves of a punch's walls: T(m w/S), T(x) = tanh(x)/x, S the ceiling, m w the slope."""

from __future__ import annotations

import numpy as np

from tactilevision.records import Floats

WALLS_PER_MM = 1.5  # slope of a face's walls per mm of depth: a wall's height over two thirds of a millimetre
WALLS_PER_MM_STD = 0.5  # std of it: what pixels and blur leave of a wall


def of_walls(ratio: float, steep: Floats) -> Floats:
    """Share of a depth (N,) that is left where a second ceiling acts, `ratio` times as low as the method's own.

    `steep` (N,) is the walls' slope over the method's own ceiling.
    """
    return np.asarray(read_share(np.hypot(ratio, 1.0) * steep) / read_share(steep))


def read_share(x: Floats) -> Floats:
    """The share tanh(x)/x (N,) that is read of slopes x (N,) times the ceiling."""
    x = np.maximum(x, 1e-9)
    return np.asarray(np.tanh(x) / x)
