"""Finite elements of a punch on a bonded layer."""
