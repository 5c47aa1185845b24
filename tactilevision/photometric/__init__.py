"""Frames to slopes: photometric stereo with coloured lights."""
