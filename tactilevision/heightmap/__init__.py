"""Slopes to a height map with its deviation and its flags."""
