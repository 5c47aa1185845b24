"""A rigid flat punch on a bonded, nearly incompressible gel by finite elements: axisymmetric, finite deformation.

mesh and discretisation say where the unknowns are; kinematics, laws and hencky what the material does; solid and
contact turn both into forces; assembly, newton and march solve; problem, press and results are the way in and out.

    punch = RoundedPunch(radius_mm=2.5, edge_radius_mm=0.05, friction=0.3)
    problem = PunchProblem(Material(0.2, 0.48), punch, thickness_mm=3.0, pad_radius_mm=15.0)
    press = press_to_depths(problem, [0.1, 0.2, 0.3])
    press.force_N, press.u_z_mm, press.pressure_MPa, press.steps
"""

from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.hencky import Hencky
from tactilevision.mechanics.punch_fem.laws import Gent, Law, NeoHooke, Yeoh
from tactilevision.mechanics.punch_fem.mesh import MeshSettings
from tactilevision.mechanics.punch_fem.press import press_to_depths, press_to_forces
from tactilevision.mechanics.punch_fem.problem import GluedFace, PunchProblem
from tactilevision.mechanics.punch_fem.results import PunchSolution

__all__ = [
    "Gent",
    "GluedFace",
    "Hencky",
    "Law",
    "MeshSettings",
    "NeoHooke",
    "PunchProblem",
    "PunchSolution",
    "RoundedPunch",
    "Yeoh",
    "press_to_depths",
    "press_to_forces",
]
