"""Slopes to depth: Poisson solvers, borders, the zero plane, steep edges."""
