"""Logs of robots and data sets of learning, read into recordings; depth and force written back. Extra `logs`."""
