"""Is this the gel and the light of the reference? What makes a map doubtful."""
