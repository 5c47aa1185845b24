"""What a press adds at random where its data do not tell: the size of gain and zero on a usual rig."""

from __future__ import annotations

TYPICAL_GAIN = 0.005  # relative force from press to press; centre of the weak prior, which fades with repeats
TYPICAL_ZERO_MM = 0.004  # mm: scatter of a press's zero of depth; centre of the weak prior likewise
TYPICAL_FORCE_N = 0.005  # N: noise of one force reading where none is stated; as the sample recordings state it
