"""What the free sides of a gel add to the compliance of its surface, by three-dimensional finite elements."""
