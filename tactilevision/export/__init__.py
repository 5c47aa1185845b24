"""Parameters of other programs that reproduce the gel: contact laws fitted to the layer, and solid materials."""
