"""The contact event: when the gel meets the bevel, and the travel that orders events."""
