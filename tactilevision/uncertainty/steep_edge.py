"""The term of restored edges: what lies inside one stands on a step that a law carried through.

    variance(x, y) = sum over edges of std_e^2      within the edge's radius; 0 outside

std_e: of the step, from the fit of the law to the slopes beside it (integration/steep_edges.py).
Vanishes where no edge was restored, and with the error of the fit. Assumes round edges of a rigid flat face.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactilevision.integration.circular_edges import window_of
from tactilevision.integration.punch_edge import PunchEdge
from tactilevision.records import Pair

Picture = npt.NDArray[np.float32]


def add_edge_variance(variance_mm2: Picture, edges: Sequence[PunchEdge], *, mm_per_point: Pair) -> None:
    """Add the `edges`' part to `variance_mm2` (h, w) mm², in place.

    Its points lie `mm_per_point` (x, y) mm apart.
    """
    for edge in edges:
        window, x, y = window_of(
            variance_mm2.shape, edge.centre_mm, mm_per_px=mm_per_point, outer_mm=edge.radius_mm
        )
        variance_mm2[window] += np.float32(edge.std_mm**2) * (x * x + y * y < edge.radius_mm**2)
