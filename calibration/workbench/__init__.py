"""Graphical `compare`, `diagnose` and `steps` in a browser on this machine."""
