"""The per-frame path on a GPU, through torch: the same reading and the same surface, to rounding error.

Nothing here is loaded before a GPU has been seen (`device.py`).
"""
