"""Ball presses: detection, samples, consistency, cross-validation."""
