"""Recordings with known truth: gel, lights, camera, rig.

Shares no formula with what reads them but for the finite elements, which are solved anew for every gel, at a
friction and an edge that the reading is not told.
"""

from tactilevision.synthetic.optics import CameraOptions
from tactilevision.synthetic.options import GelOptions, IndenterOptions, RigOptions, SimulationOptions
from tactilevision.synthetic.rig import Protocol
from tactilevision.synthetic.simulate import simulate

__all__ = [
    "CameraOptions",
    "GelOptions",
    "IndenterOptions",
    "Protocol",
    "RigOptions",
    "SimulationOptions",
    "simulate",
]
