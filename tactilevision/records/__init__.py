"""Frozen records that the steps hand to each other, units and flags."""
