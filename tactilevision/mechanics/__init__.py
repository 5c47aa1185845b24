"""Mechanics of the gel: a bonded elastic layer and bodies pressed into it, without pictures or fits."""
