"""Light calibrated on contacts of unknown shape: `moments.py` what each asks, `self_calibration.py` the law."""
