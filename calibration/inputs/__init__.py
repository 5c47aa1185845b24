"""Observations with their conditions, gathered from recordings and checked."""
