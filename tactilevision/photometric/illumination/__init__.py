"""The light: drift since the reference, colour change, camera response."""
