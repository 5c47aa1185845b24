"""Statistics of the new features, as LeRobot keeps them: of each episode, and of all of them together.

NaN, which means not known, is left out. Where all is NaN, the statistics are 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tactilevision.records import Floats

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
MAX_SAMPLED = 256  # pixels of each map that the statistics of depth are taken from, besides its extremes
Stats = dict[str, Floats]


def sampled(depth_mm: Floats) -> Floats:
    """Evenly spaced values (k,) of a map (H, W) in mm, its least and its greatest first."""
    flat = depth_mm.ravel()
    known = flat[np.isfinite(flat)]
    extremes = (known.min(), known.max()) if known.size else (np.nan, np.nan)
    return np.array([*extremes, *flat[:: -(-flat.size // MAX_SAMPLED)]])


def of_depth(samples: Sequence[Floats]) -> Stats:
    """Statistics, mm, of the samples (N, k) of an episode's maps, of shape (1, 1)."""
    every = np.stack(samples)
    found = of_values(every[:, 2:].reshape(-1, 1))
    found |= {"min": of_values(every[:, :1])["min"], "max": of_values(every[:, 1:2])["max"]}
    found = {name: value.reshape(1, 1) for name, value in found.items()}
    return found | {"count": np.array([len(samples)])}


def of_values(values: Floats) -> Stats:
    """Statistics (k,) of the values (N, k) of an episode, in their unit."""
    found: dict[str, list[float]] = {name: [] for name in ("min", "max", "mean", "std", *QUANTILES)}
    for column in np.asarray(values, float).T:
        known = column[np.isfinite(column)]
        known = known if known.size else np.zeros(1)
        told = [known.min(), known.max(), known.mean(), known.std()]
        told += [np.quantile(known, share) for share in QUANTILES.values()]
        for name, value in zip(found, told, strict=True):
            found[name].append(float(value))
    return {name: np.array(column) for name, column in found.items()} | {"count": np.array([len(values)])}


def together(episodes: Sequence[Stats]) -> Stats:
    """Statistics of all episodes from theirs, weighted by their frames, in their unit and shape, as (1,)."""
    counts = np.array([float(one["count"][0]) for one in episodes])

    def mean(name: str) -> Floats:
        return np.asarray(np.average(np.stack([one[name] for one in episodes]), axis=0, weights=counts))

    middle = mean("mean")
    variance = np.average(
        [one["std"] ** 2 + (one["mean"] - middle) ** 2 for one in episodes], axis=0, weights=counts
    )
    found = {"min": np.min([one["min"] for one in episodes], axis=0)}
    found |= {"max": np.max([one["max"] for one in episodes], axis=0), "mean": middle, "std": np.sqrt(variance)}
    return found | {name: mean(name) for name in QUANTILES} | {"count": np.array([int(counts.sum())])}


def as_json(stats: Mapping[str, Stats]) -> dict[str, Any]:
    """Statistics of each feature, in their unit and shape, as (1,) and lists."""
    return {key: {name: value.tolist() for name, value in one.items()} for key, one in stats.items()}
