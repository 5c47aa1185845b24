"""The finite-element table of the flat punch: P/(E w) and the profile around it."""
