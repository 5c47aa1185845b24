"""A press: its track, the certified depth, the force, and Poisson's ratio from the rise."""
