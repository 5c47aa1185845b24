"""A model: a contact law and effects, composed in stages, with parameters."""
