"""The questions asked of a recording, each one call: calibrate, compare, diagnose, validate, history."""
