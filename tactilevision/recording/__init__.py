"""Recordings on disk: the only room that knows the names and columns of their files (docs/format.md)."""

from tactilevision.recording.frames import iter_frames, read_frame
from tactilevision.recording.images import read_image
from tactilevision.recording.model import BadFrame, BallPress, Recording, StageSeries
from tactilevision.recording.need import require
from tactilevision.recording.read import read_recording

__all__ = [
    "BadFrame",
    "BallPress",
    "Recording",
    "StageSeries",
    "iter_frames",
    "read_frame",
    "read_image",
    "read_recording",
    "require",
]
