"""Cameras, live streams, robot logs and data sets."""
