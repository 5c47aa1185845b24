"""What is missing from the model: the search for effects, and what stays open."""
