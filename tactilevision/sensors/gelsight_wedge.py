"""GelSight Wedge: mirror and camera in a wedge; the gel is a trapezoid in the raw picture until it is warped.

About 11 px per mm after the warp (`rectification.maps_from_corners`); 320 by 240 px is the size taken there.
Source: Wang, She, Romero, Adelson, "GelSight Wedge", ICRA 2021.
"""

from tactilevision.records.rig import Sensor

GELSIGHT_WEDGE = Sensor(kind="gelsight_wedge", width_px=320, height_px=240, mm_per_px=(0.0909, 0.0909))
