"""DIGIT: a low-cost fingertip, 240 by 320 px upright, three lights below the gel.

About 16 mm by 19 mm of gel fill the picture. The camera views the gel at an angle, so the scale is a mean; measure
it where depth matters. The network of this library takes pictures as digit-interface returns them: red from the
upper right, green from the upper left, blue from below.
Source: Lambeta et al., IEEE RA-L 5 (2020).
"""

from tactilevision.records.rig import Sensor

DIGIT = Sensor(kind="digit", width_px=240, height_px=320, mm_per_px=(0.0640, 0.0600))
