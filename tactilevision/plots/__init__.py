"""Figures: the only room that imports matplotlib. Each function draws one Figure and touches no global state."""
