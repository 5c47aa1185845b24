"""The camera's and the force sensor's clocks, aligned."""
