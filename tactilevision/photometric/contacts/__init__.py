"""Light from contacts of unknown shape: `moments.py`, `roundness.py` what each asks; `self_calibration.py`."""
