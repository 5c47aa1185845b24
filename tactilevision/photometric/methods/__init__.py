"""Photometric methods, one a file: colour change to slope."""
