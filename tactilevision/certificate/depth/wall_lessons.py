"""Certified faces teach the wall's law: maps at their events, held against the depth that the bevel has there.

A face's map says how deep it is read and how much of that its wall hides (certified_faces.py). With the
certified depth beside it, the two numbers of the wall's law come out (integration/taught_walls.py). They belong
to the light, and all later frames of the sensor are read with them; shadows left or undone, each has its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from tactilevision.certificate.depth.certified_faces import CertifiedFace
from tactilevision.certificate.depth.depth_scale import DepthScale
from tactilevision.integration.taught_walls import teach
from tactilevision.photometric.method import CalibratedMethod, ReferencedMethod
from tactilevision.reconstruct import Reconstructor
from tactilevision.records.taught_walls import TaughtWalls, WallLessons


def teach_walls(reader: Reconstructor, faces: Sequence[CertifiedFace]) -> bool:
    """Let certified `faces`, as the reader sees them now, teach its walls.

    The reader keeps to it from then on. False, and what it knew stays, where too few faces show a wall, and where
    what they say is more than walls can be off.
    """
    lesson = teach([one.wall_face for one in faces if one.wall_face is not None])
    if lesson is not None:
        reader.taught = lesson
    return lesson is not None


def with_walls(method: ReferencedMethod, walls: WallLessons) -> ReferencedMethod:
    """The method with what its reader knows of `walls`; itself where that is what it knows already."""
    known = getattr(method, "walls", None) or WallLessons()
    return method if walls == known else replace(cast(CalibratedMethod, method), walls=walls)


def with_scatter(scale: DepthScale | None, walls: TaughtWalls) -> DepthScale | None:
    """The scale of faces that taught their `walls`, too: they scatter no less than faces elsewhere."""
    return None if scale is None else replace(scale, scatter=max(scale.scatter, walls.scatter))
