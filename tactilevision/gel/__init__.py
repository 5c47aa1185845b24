"""Gels of any shape: solids and mesh files, their seen surface, and its compliance by finite elements."""
