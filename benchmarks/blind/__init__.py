"""A blind test of the diagnosis: recordings made by formulas of their own, with effects hidden in them.

Nothing of calibration is imported but by the analysts (analyst.py); the truth is opened by the scorer alone.
"""
