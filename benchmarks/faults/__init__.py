"""Runs that are killed, interrupted, starved of disk, or whose input changes: what is left, and what a second run makes.

`python -m benchmarks.faults --kills 200` prints a table; docs/explanation/trust.md quotes one.
"""
