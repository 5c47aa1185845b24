"""The per-frame path on a GPU, through torch: the same reading and the same surface, to rounding error.

`Reconstructor.use("cuda")` loads it. Frames of 640x480 are read no sooner there (benchmarks/gpu.py).
"""
