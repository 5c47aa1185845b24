"""Force on the gel from the shape of its surface: compliance, inverse, standard deviations."""
