"""Open and check what others made; write whole files or none."""
