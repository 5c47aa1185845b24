"""GelSight Mini: three lights round a square gel, 320 by 240 px as its software streams it.

Scale about 0.0634 mm/px at that size (0.0317 at 640 by 480) by the maker's software; measure it where depth
matters. On two measured sensors red comes from above, green from the right, blue from below. Source: GelSight
Inc., gsrobotics.
"""

from tactilevision.records.rig import Sensor

GELSIGHT_MINI = Sensor(kind="gelsight_mini", width_px=320, height_px=240, mm_per_px=(0.0634, 0.0634))
