"""Recordings simulated with known truth."""
