"""The term of the zero plane: where depth 0 lies is read off the untouched gel, and no better than it is flat.

    variance = std_0^2      the same everywhere; std_0: of the plane at the picture's centre

std_0 is that of the fit (integration/zero_plane.py), with errors that hang together over a tenth of the picture.
Vanishes where the untouched blocks all lie in one plane. The tilt's own part, away from the centre, is not in it.
"""

from __future__ import annotations

from tactilevision.integration.zero_plane import ZeroPlane


def zero_variance(zero: ZeroPlane) -> float:
    """Variance of every depth by the plane `zero`, mm²."""
    return zero.std_mm**2
