"""Recordings on disk: the only room that knows the names and columns of their files (docs/format.md)."""

from tactilevision.recording.ball_folder import read_ball_folder
from tactilevision.recording.folder import list_references, read_folder
from tactilevision.recording.frames import iter_frames, read_flats, read_frame, read_reference
from tactilevision.recording.images import decode_image, read_image
from tactilevision.recording.model import BadFrame, BallPress, Recording, StageSeries
from tactilevision.recording.need import faults_of_flats, faults_of_reference, is_bare, require
from tactilevision.recording.read import read_recording
from tactilevision.recording.write import write_image, write_maps, write_recording, write_settings
from tactilevision.recording.write_tables import (
    write_balls,
    write_curves,
    write_forces,
    write_frame_table,
    write_points,
    write_presses,
    write_stage,
    write_table,
)

__all__ = [
    "BadFrame",
    "BallPress",
    "Recording",
    "StageSeries",
    "decode_image",
    "faults_of_flats",
    "faults_of_reference",
    "is_bare",
    "iter_frames",
    "list_references",
    "read_ball_folder",
    "read_flats",
    "read_folder",
    "read_frame",
    "read_image",
    "read_recording",
    "read_reference",
    "require",
    "write_balls",
    "write_curves",
    "write_forces",
    "write_frame_table",
    "write_image",
    "write_maps",
    "write_points",
    "write_presses",
    "write_recording",
    "write_settings",
    "write_stage",
    "write_table",
]
