"""How the gel's surface moved along itself between two frames: by its markers, or by the texture of its ink."""
