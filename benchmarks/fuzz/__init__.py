"""Mutants of every input file, thrown at the functions that the commands call: `make fuzz READER=... MINUTES=...`.

Each reader has small valid files that the library itself writes. Mutants come from hypothesis, which knows the
form of the file, and from bytes, guided by coverage where atheris is installed. A child process judges them.
"""
