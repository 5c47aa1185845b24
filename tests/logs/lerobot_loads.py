"""Opens a data set with LeRobot's own loader and prints what it finds: python lerobot_loads.py ROOT."""

from __future__ import annotations

import json
import sys

import numpy as np


def main(root: str) -> None:
    from lerobot.datasets.compute_stats import aggregate_stats
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    found = LeRobotDataset("drawn/tactile", root=root, video_backend="pyav")
    frames = [found[number] for number in range(len(found))]
    aggregate_stats([found.meta.stats, found.meta.stats])  # which checks their shapes
    told = {
        key: [list(value.shape), str(value.dtype)] if hasattr(value, "shape") else [type(value).__name__]
        for key, value in frames[4].items()
    }
    depth = np.stack([np.asarray(one["observation.tactile.depth_mm"]) for one in frames])
    wrench = np.stack([np.asarray(one["observation.tactile.wrench"]) for one in frames])
    print(
        json.dumps(
            {
                "kinds": told,
                "deepest": np.nanmax(depth, axis=(1, 2)).tolist(),
                "pressing": wrench[:, 2].tolist(),
                "contact": [bool(one["observation.tactile.contact"]) for one in frames],
                "flags": frames[0]["observation.tactile.flags"],
                "stats": sorted(found.meta.stats["observation.tactile.depth_mm"]),
            }
        )
    )


if __name__ == "__main__":
    main(sys.argv[1])
