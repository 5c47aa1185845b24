"""Contact regions, the indenter's footprint and the touch of its bevel, from height maps and pictures."""
