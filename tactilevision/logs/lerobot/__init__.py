"""Data sets of LeRobot, version 3: a tactile camera's stream read; depth, contact and force written beside it."""
