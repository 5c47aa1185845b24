"""Measured proofs: each module is run by itself with python -m benchmarks.NAME, or all by python -m benchmarks."""
