"""What presses measured, made ready for a fit: its checks, its conditions, its shared tolerances."""
