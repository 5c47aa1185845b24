"""Training of a network on random lights; only `train` loads it."""
