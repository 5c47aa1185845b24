"""Runs that are killed, starved of disk, or whose input changes: what is left, and what a second run makes of it.

`python -m benchmarks.faults --kills 200` prints a table; docs/explanation/trust.md quotes one.
"""
