"""Frames as they come: from a camera, or from a video or a folder played as if it were one."""
