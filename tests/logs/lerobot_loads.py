"""Opens a data set with LeRobot's own loader and prints what it finds: python lerobot_loads.py ROOT.

With a second argument, CAMERA, native depth is read instead, in metres, which takes LeRobot 0.6 or newer.
"""

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


def read_native(root: str, camera: str) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    found, key = LeRobotDataset("drawn/tactile", root=root, video_backend="pyav", depth_output_unit="m"), camera
    assert found.meta.depth_keys == [key], found.meta.depth_keys
    frames = [found[number] for number in range(len(found))]
    masks = [np.asarray(one["observation.tactile.depth_valid"]).astype(int) for one in frames]
    stats = {name: np.asarray(value).tolist() for name, value in found.meta.stats[key].items()}
    depth_m = [np.asarray(one[key], float).tolist() for one in frames]
    print(json.dumps({"depth_m": depth_m, "valid": [one.tolist() for one in masks], "stats": stats}))


if __name__ == "__main__":
    read_native(*sys.argv[1:]) if len(sys.argv) > 2 else main(sys.argv[1])
