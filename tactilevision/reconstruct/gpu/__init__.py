"""The per-frame path on a GPU, through torch: the same reading and the same surface, to rounding error.

`Reconstructor.use("cuda")` loads it. To 1280x960 no frame is read sooner there (benchmarks/gpu.py).
"""
