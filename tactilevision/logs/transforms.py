"""How one frame of reference is turned against another, out of a log's transforms that never change.

A message of /tf or /tf_static says how a frame lies in its parent: v_parent = R v_child, R of a unit quaternion.
Frames whose R changes within the log are joints that moved; no way leads through them. Joints that stood still all
along count as fixed: their wrench was turned so in that log.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from tactilevision.errors import InputError
from tactilevision.logs.log import Log
from tactilevision.logs.messages import decode_transforms
from tactilevision.records import Floats

TOPICS = ("/tf", "/tf_static")
FIXED_RAD = 2e-3  # a joint that stands still is read to a tenth of a degree; this is less than a force's noise
UNIT = 1e-3  # by which a quaternion's length may miss 1: those of 32 bits miss it by less


@dataclass(slots=True)
class _Tree:
    parents: dict[str, tuple[str, Rotation]] = field(default_factory=dict)
    moving: set[str] = field(default_factory=set)

    def add(self, child: str, parent: str, turn: Rotation) -> None:
        known = self.parents.setdefault(child, (parent, turn))
        if known[0] != parent or (known[1].inv() * turn).magnitude() > FIXED_RAD:
            self.moving.add(child)

    def way_up(self, frame: str) -> dict[str, Rotation]:
        """How `frame` is turned in each frame that it is fixed to, itself the first."""
        ways = {frame: Rotation.identity()}
        while frame in self.parents and frame not in self.moving:
            turned, (frame, turn) = ways[frame], self.parents[frame]
            if frame in ways:
                break
            ways[frame] = turn * turned
        return ways


def fixed_rotation(log: Log, of: str, into: str) -> Floats | None:
    """R (3, 3), dimensionless, with v_into = R v_of; None where no fixed way leads from one frame to the other.

    Raises InputError where a quaternion is none.
    """
    tree = _Tree()
    for message in log.messages(TOPICS):
        for child, parent, quaternion in decode_transforms(message, log.path):
            if not abs(float(np.linalg.norm(quaternion)) - 1.0) < UNIT:
                where = f"{log.path}, {message.topic}"
                raise InputError(
                    f"the transform of {child!r} is no rotation", where=where, value=quaternion.tolist()
                )
            tree.add(child, parent, Rotation.from_quat(quaternion))
    theirs, ours = tree.way_up(_bare(of)), tree.way_up(_bare(into))
    shared = next((frame for frame in theirs if frame in ours), None)
    return None if shared is None else np.asarray((ours[shared].inv() * theirs[shared]).as_matrix())


def _bare(frame: str) -> str:
    """ROS 1 began names with a slash; transforms have none."""
    return frame.lstrip("/")
