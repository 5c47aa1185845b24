"""What several effects share: memory kernels, and effects from a user's own file."""
