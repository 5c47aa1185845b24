"""Does anything touch the gel? How deep untouched gel may come out, which a depth is held against.

`HeightMap.std_mm` holds what is not known of the depth's scale, too: a part g of the depth. That makes the depth
of a contact uncertain, but not the contact: a method that knows its scale to no better than a fifth would never
see one at five deviations. So it is taken out, and put on what untouched gel comes out with, which has that scale,

    s^2 = (1 + g)^2 [ max(std^2 - g^2 depth^2, u^2) + r^2 ]

u: the least that untouched gel comes out with there; r: how rough the map itself is where it is shallow, as far as
its method was not told of it (median distance of the shallower half from its median, as a standard deviation).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.records import HeightMap
from tactilevision.robust import frame_mad_std, median
from tactilevision.uncertainty.depth import DepthError

Array = npt.NDArray[np.floating[Any]]
SAMPLED = 4000  # pixels, about, that tell how rough a map is


def untouched_std(
    height: HeightMap,
    error: DepthError | None,
    *,
    every: int = 1,
    places: npt.NDArray[np.intp] | None = None,
    noise_mm: float | None = None,
) -> Array | None:
    """Standard deviation (h, w) in mm of depth where nothing touches, of every `every`th pixel each way.

    Of the pixels at `places` (n,) of the flattened (h, w) alone where they are given, (n,). `error` is that of
    the method which made the map; None: the map's own deviation, which may itself be None. `noise_mm` of the map
    where it is known.
    """

    def wanted(grid: Array) -> Array:
        return grid if places is None else grid.take(places)

    if height.std_mm is None or error is None:
        return None if height.std_mm is None else wanted(height.std_mm[::every, ::every])
    depth, std = (np.asarray(many[::every, ::every], np.float32) for many in (height.depth_mm, height.std_mm))
    gain_square, least = map(wanted, error.in_pixels(depth.shape))
    depth, std = wanted(depth), wanted(std)
    noise_mm = map_noise_mm(height) if noise_mm is None else noise_mm
    square = np.maximum(std * std - gain_square * depth * depth, least)
    return np.asarray((1.0 + np.sqrt(gain_square)) * np.sqrt(square + np.float32(noise_mm**2)))


def map_noise_mm(height: HeightMap) -> float:
    """Standard deviation (mm) of the shallower half of a map (H, W) about its median, out of the median distance.

    0 of nothing.
    """
    step = max(1, int(np.sqrt(height.depth_mm.size / SAMPLED)))
    depth = height.depth_mm[::step, ::step][height.valid[::step, ::step]]
    if not depth.size:
        return 0.0
    shallow = depth[depth <= median(depth)]
    return frame_mad_std(shallow)
