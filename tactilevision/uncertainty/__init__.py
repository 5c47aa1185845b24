"""The standard deviation of a depth, term by term."""
