"""The wall's law as certified faces of the same sensor teach it.

The depth that the law of steep walls (steep_edges.py) finds hidden is off by a part of itself, which grows with
the depth and differs from sensor to sensor. Its two numbers come from certified faces, by ridge towards no change:

    certified - read = hidden (share + growth (w/w0 - 1)) + noise     records/taught_walls.py

noise: PLACE_STD of the depth, by which faces of one sensor differ from place to place. Presses of one indenter to
one depth mostly share their place, so together they count as one, wherever they were.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactilevision.records.taught_walls import USUAL_MM, TaughtWalls

PLACE_STD = 0.03  # of the depth: faces of one sensor about their law, six of the path tracer; benchmarks.rendered
PRIOR_STD = (0.2, 0.4)  # of share and growth, about today's law: those six sensors
MAX_CHI2 = 9.0  # of the two numbers by that prior: beyond, it is not walls that are off
MIN_COUNT = 3  # faces with a wall; fewer teach nothing
ALIKE_MM = 0.05  # mm: depths of one group within this of its shallowest count as one


@dataclass(frozen=True, slots=True)
class WallFace:
    """A certified face: `read_mm` in its map, and `hidden_mm` and `depth_mm` of its wall there (PunchEdge).

    Faces of one `group`, an indenter's, to one depth count as one.
    """

    group: str
    read_mm: float
    hidden_mm: float
    depth_mm: float
    certified_mm: float


def teach(faces: Sequence[WallFace]) -> TaughtWalls | None:
    """What `faces` say of the wall's law; None for fewer than MIN_COUNT with a wall, or for more than walls do."""
    faces = [one for one in faces if all(0 < mm < np.inf for mm in _lengths_mm(one))]
    if len(faces) < MIN_COUNT:
        return None
    read, hidden, depth, certified = np.array([_lengths_mm(one) for one in faces]).T
    std = PLACE_STD * np.sqrt(_alike(faces))
    terms = np.stack([hidden, hidden * (depth / USUAL_MM - 1.0)]) / (read * std)
    covariance = np.linalg.inv(terms @ terms.T + np.diag(np.array(PRIOR_STD) ** -2.0))
    share, growth = covariance @ terms @ ((certified - read) / (read * std))
    if float(np.sum(np.square(np.array([share, growth]) / PRIOR_STD))) > MAX_CHI2:
        return None
    stated = (float(covariance[0, 0]), float(covariance[1, 1]), float(covariance[0, 1]))
    return TaughtWalls(float(share), float(growth), stated, (float(depth.min()), float(depth.max())), PLACE_STD)


def _lengths_mm(face: WallFace) -> tuple[float, float, float, float]:
    return face.read_mm, face.hidden_mm, face.depth_mm, face.certified_mm


def _alike(faces: Sequence[WallFace]) -> list[int]:
    """How many of the faces count as one with each: of its group, and about as deep; (N,)."""
    begins: dict[int, tuple[str, float]] = {}
    last = ("", -np.inf)  # group and depth of the shallowest that counts as one with the face
    for k in sorted(range(len(faces)), key=lambda k: (faces[k].group, faces[k].certified_mm)):
        group, depth_mm = faces[k].group, faces[k].certified_mm
        last = last if group == last[0] and depth_mm - last[1] <= ALIKE_MM else (group, depth_mm)
        begins[k] = last
    count = Counter(begins.values())
    return [count[begins[k]] for k in range(len(faces))]
