"""What is missing from the model: the search for effects, and what it leaves open."""
