"""Logs of robots and data sets of learning: read into recordings, and depth and force written back. Extra `logs`."""
