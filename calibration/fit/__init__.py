"""The fit: weighted least squares, identifiability, tolerances, alternative fits."""
