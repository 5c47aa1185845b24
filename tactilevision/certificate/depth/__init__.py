"""The certified depth: pile-up beside the punch, edge profile, scale of depth."""
