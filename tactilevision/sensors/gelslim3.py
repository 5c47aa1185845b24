"""GelSlim 3.0: Raspberry-Pi camera behind a mirror, blue light from the top, green left, red lower right.

Stream 427 by 320 px at 90 frames a second. The raw picture is strongly distorted: a rectification belongs to each
finger. Scale about 0.0634 mm/px after it (a lens of 27.4 mm fills the width; 0.10577, found in public code,
is wrong). Source: Taylor, Dong, Rodriguez, "GelSlim 3.0", ICRA 2022.
"""

from tactilevision.records.rig import Sensor

GELSLIM3 = Sensor(kind="gelslim3", width_px=427, height_px=320, mm_per_px=(0.0634, 0.0634))
GELSLIM3_MARKERS = Sensor(
    kind="gelslim3_markers", width_px=427, height_px=320, mm_per_px=(0.0634, 0.0634), has_markers=True
)
