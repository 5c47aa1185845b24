"""Sensor profiles: one file that holds a calibrated sensor, and the reader of its frames."""
