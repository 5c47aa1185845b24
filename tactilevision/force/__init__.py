"""From the shape of the gel's surface to the force on it: compliance, inverse, and their standard deviations."""
