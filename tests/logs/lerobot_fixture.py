"""How LeRobot itself wrote tests/data/lerobot_v3: run by hand, with LeRobot 0.4.4, in two steps.

    python lerobot_fixture.py draw frames.npy         # with this library and the tests' lamp room
    python lerobot_fixture.py write frames.npy OUT    # with LeRobot

Two episodes of six and four frames: free gel, then a ball. The gripper's camera is kept as pictures.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

LENGTHS, RATE_HZ = (6, 4), 10
TACTILE, WRIST = "observation.images.tactile", "observation.images.wrist"


def draw(path: str) -> None:
    sys.path.insert(0, str(Path(__file__).parents[1] / "profile"))
    from lamp_sensor import free, pressed

    shown = [
        [free(seed) for seed in range(3)] + [pressed(seed, 1.5) for seed in range(count - 3)] for count in LENGTHS
    ]
    np.save(path, np.concatenate([np.stack(one) for one in shown]))


def write(path: str, out: str) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    frames = np.load(path)
    camera = {"dtype": "video", "shape": frames.shape[1:], "names": ["height", "width", "channels"]}
    features = {
        TACTILE: camera,
        WRIST: camera | {"dtype": "image", "shape": (12, 16, 3)},
        "observation.state": {"dtype": "float32", "shape": (2,), "names": ["gripper", "height"]},
        "action": {"dtype": "float32", "shape": (2,), "names": ["gripper", "height"]},
    }
    made = LeRobotDataset.create("drawn/tactile", RATE_HZ, features, root=out, vcodec="h264")
    number = 0
    for length in LENGTHS:
        for step in range(length):
            state = np.array([step, number], np.float32)
            small = np.full((12, 16, 3), 10 * number, np.uint8)
            made.add_frame(
                {
                    TACTILE: frames[number],
                    WRIST: small,
                    "observation.state": state,
                    "action": state,
                    "task": "press",
                }
            )
            number += 1
        made.save_episode()
    made.finalize()


if __name__ == "__main__":
    if sys.argv[1] == "draw":
        draw(sys.argv[2])
    else:
        write(sys.argv[2], sys.argv[3])
