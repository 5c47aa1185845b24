"""Where the indenter is, and when its bevel touches: read from height maps and pictures."""
