"""The programs that a gel is exported to: versions, contact law, units and the text that each reads.

To add one, write its text as a function of `Values` and list it in PROGRAMS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactilevision.errors import InputError, check_known
from tactilevision.export.laws import LawName
from tactilevision.mechanics.material import CARDS, neo_hooke
from tactilevision.records.constants import KILO
from tactilevision.records.measured import Material

MEGA = 1e6  # Pa in one MPa
RUN, READ = "verified by running", "checked as text"
TETRAHEDRA = 0.49  # Poisson's ratio beyond which linear tetrahedra lock
HYBRID = 0.4999  # Poisson's ratio up to which elements with a pressure of their own are sound
FACETS = 40  # of Drake's mesh of a round indenter over its radius: 1 % of the force


@dataclass(frozen=True, slots=True)
class Values:
    """What a program's text is made of: SI units, but `solid`, whose moduli are in MPa.

    `law` holds the fitted values, empty without a law. `radius_m` is the indenter's, `taxel_m` the pitch of
    taxels. Friction and density are None where nobody stated them.
    """

    solid: Material
    law: Mapping[str, float]
    thickness_m: float
    radius_m: float
    taxel_m: float
    friction: float | None
    density_kg_m3: float | None

    @property
    def per_taxel(self) -> float:
        """Return the spring constant of one taxel, N/m."""
        return self.law["per_depth"] * self.taxel_m**2

    def known(self, line: str, value: float | None) -> str:
        """Return a line with its value, or a comment that nobody stated it."""
        return line.format(f"{value:.6g}") if value is not None else "# not stated: " + line.format("...")


Row = tuple[str, float, str, float]  # name, value, unit, power of E to which it is proportional


@dataclass(frozen=True, slots=True)
class Program:
    """A program: its `versions`, newest first, the contact `law` (None: the solid alone) and what it reads."""

    title: str
    versions: tuple[str, ...]
    law: LawName | None
    checked: str
    file: str
    largest_nu: float
    rows: Callable[[Values], tuple[Row, ...]]
    text: Callable[[Values], str]


def _offset(v: Values) -> Row:
    return "surface_offset", v.law["offset"], "m", 0


def _soft(v: Values) -> tuple[Row, ...]:
    """Return the rows of a solid in Pa."""
    return (
        ("solid.youngs_modulus", v.solid.youngs_modulus_MPa * MEGA, "Pa", 1),
        ("solid.poisson_ratio", v.solid.poisson_ratio, "1", 0),
    )


def _mujoco_rows(v: Values) -> tuple[Row, ...]:
    s = v.law["stiffness"]
    shape = (("dmin", "1"), ("dmax", "1"), ("width", "m"), ("midpoint", "1"), ("power", "1"))
    return (
        ("solref.stiffness", s, "1/s^2", 1),
        ("solref.damping", 2 * np.sqrt(s), "1/s", 0.5),
        *((f"solimp.{name}", v.law[name], unit, 0) for name, unit in shape),
        ("mass", v.law["mass"], "kg", 0),
        *_soft(v),
    )


def _mujoco(v: Values) -> str:
    law, solid = v.law, v.solid
    solimp = " ".join(f"{law[name]:.6g}" for name in ("dmin", "dmax", "width", "midpoint", "power"))
    friction = "" if v.friction is None else f' friction="{v.friction:g} 0.005 0.0001"'
    density = "not stated" if v.density_kg_m3 is None else f"{v.density_kg_m3:g} kg/m^3"
    return f"""<mujoco>
  <!-- Give the pad's geom class="gel". solref is for a body of {law["mass"]:g} kg that presses on a fixed pad: its
       mass to the contact is 1/body_invweight0[0]. For n times the mass divide the first number by n, the second
       by the root of n.
       Damping is critical: a choice, not the gel's. Density: {density}. -->
  <default>
    <default class="gel">
      <geom priority="1" solref="{-law["stiffness"]:.6g} {-2 * np.sqrt(law["stiffness"]):.6g}"
            solimp="{solimp}"{friction}/>
    </default>
  </default>
  <!-- The solid, for a flexcomp of dim="3" (checked as text):
       <elasticity young="{solid.youngs_modulus_MPa * MEGA:.6g}" poisson="{solid.poisson_ratio:.6g}"/> -->
</mujoco>
"""


def _drake_rows(v: Values) -> tuple[Row, ...]:
    modulus = v.law["per_depth"] * v.thickness_m
    return (
        ("hydroelastic_modulus", modulus, "Pa", 1),
        ("slab_thickness", v.thickness_m, "m", 0),
        ("resolution_hint", v.radius_m / FACETS, "m", 0),
        _offset(v),
        *_soft(v),
    )


def _drake(v: Values) -> str:
    modulus = v.law["per_depth"] * v.thickness_m
    friction = v.known("friction = CoulombFriction({0}, {0})", v.friction)
    density = "not stated" if v.density_kg_m3 is None else f"{v.density_kg_m3:g} kg/m^3"
    name = "friction" if v.friction is not None else "CoulombFriction(0.0, 0.0)"
    return f"""# Raise the pad's surface by {v.law["offset"]:.6g} m. Dissipation was not measured.
from pydrake.geometry import (
    AddCompliantHydroelasticPropertiesForHalfSpace, AddContactMaterial, AddRigidHydroelasticProperties,
    ProximityProperties,
)
from pydrake.multibody.plant import CoulombFriction

{friction}
gel = ProximityProperties()  # of a HalfSpace; a compliant box of this thickness acts alike
AddCompliantHydroelasticPropertiesForHalfSpace({v.thickness_m:.6g}, {modulus:.6g}, gel)
AddContactMaterial(0.0, None, {name}, gel)
indenter = ProximityProperties()
AddRigidHydroelasticProperties({v.radius_m / FACETS:.6g}, indenter)  # metres: finer facets, truer force
AddContactMaterial(0.0, None, {name}, indenter)
# The solid, for DeformableBodyConfig (checked as text):
# youngs_modulus {v.solid.youngs_modulus_MPa * MEGA:.6g} Pa, poissons_ratio {v.solid.poisson_ratio:.6g}
# mass_density {density}
"""


def _genesis_rows(v: Values) -> tuple[Row, ...]:
    return (
        ("normal_stiffness", v.per_taxel, "N/m", 1),
        ("normal_exponent", 1.0, "1", 0),
        ("taxel_pitch", v.taxel_m, "m", 0),
        _offset(v),
        *_soft(v),
    )


def _genesis(v: Values) -> str:
    return f"""# Probes lie every {v.taxel_m:.6g} m, raised above the pad's surface by {v.law["offset"]:.6g} m.
KINEMATIC_TAXEL = dict(
    probe_radius=1e-6, normal_stiffness={v.per_taxel:.6g}, normal_exponent=1.0,
    normal_damping=0.0, shear_scalar=0.0, twist_scalar=0.0,  # not measured
)
# The solid (checked as text): gs.materials.FEM.Elastic(**FEM)
FEM = dict(
    E={v.solid.youngs_modulus_MPa * MEGA:.6g}, nu={v.solid.poisson_ratio:.6g}, model="stable_neohookean",
    {v.known("rho={},", v.density_kg_m3)}
    {v.known("friction_mu={},", v.friction)}
)
"""


def _newton_rows(v: Values) -> tuple[Row, ...]:
    lame = v.solid.bulk_modulus_MPa - 2 * v.solid.shear_modulus_MPa / 3
    return (
        ("kh", v.law["per_depth"], "N/m^3", 1),
        _offset(v),
        ("solid.k_mu", v.solid.shear_modulus_MPa * MEGA, "Pa", 1),
        ("solid.k_lambda", lame * MEGA, "Pa", 1),
    )


def _newton(v: Values) -> str:
    (_, kh, *_), _, (_, mu, *_), (_, lame, *_) = _newton_rows(v)
    return f"""# Raise the pad's surface by {v.law["offset"]:.6g} m. Damping was not measured.
# The pressures of both shapes balance: give the indenter is_hydroelastic=True and kh={100 * kh:.6g}.
# SolverMuJoCo scales stiffness by mass: check its force.
GEL = dict(
    is_hydroelastic=True, kh={kh:.6g},
    {v.known("mu={},", v.friction)}
    {v.known("density={},", v.density_kg_m3)}
)
# The solid, for add_soft_grid (checked as text):
SOLID = dict(k_mu={mu:.6g}, k_lambda={lame:.6g})
"""


def _isaac_rows(v: Values) -> tuple[Row, ...]:
    return (
        ("normal_contact_stiffness", v.per_taxel, "N/m", 1),
        ("taxel_pitch", v.taxel_m, "m", 0),
        _offset(v),
        *_soft(v),
    )


def _isaac(v: Values) -> str:
    return f"""# Fields of VisuoTactileSensorCfg. Choose tactile_array_size for points every {v.taxel_m:.6g} m.
# Raise the elastomer's surface by {v.law["offset"]:.6g} m. tangential_stiffness was not measured.
TACTILE = dict(
    normal_contact_stiffness={v.per_taxel:.6g},
    {v.known("friction_coefficient={},", v.friction)}
)
# The solid, for DeformableBodyMaterialCfg:
SOLID = dict(
    youngs_modulus={v.solid.youngs_modulus_MPa * MEGA:.6g}, poissons_ratio={v.solid.poisson_ratio:.6g},
    {v.known("density={},", v.density_kg_m3)}
    {v.known("dynamic_friction={},", v.friction)}
)
"""


def _hooke_rows(v: Values) -> tuple[Row, ...]:
    c10, d1 = neo_hooke(v.solid)
    return ("C10", c10, "MPa", 1), ("D1", d1, "1/MPa", -1)


def _febio_rows(v: Values) -> tuple[Row, ...]:
    return ("c1", neo_hooke(v.solid)[0], "MPa", 1), ("k", v.solid.bulk_modulus_MPa, "MPa", 1)


def _card(suffix: str) -> Callable[[Values], str]:
    """Return the text of a finite-element program's material card."""

    def card(v: Values) -> str:
        c10, d1 = neo_hooke(v.solid)
        about = (
            f"units: mm, N, MPa, t/mm3; E = {v.solid.youngs_modulus_MPa:.6g} MPa, nu = {v.solid.poisson_ratio:.6g}"
        )
        text = CARDS[suffix].format(about=about, c10=c10, d1=d1, bulk=v.solid.bulk_modulus_MPa)
        if v.density_kg_m3 is None:
            return text
        density = v.density_kg_m3 / KILO**4  # t/mm3
        if suffix == ".feb":
            return text.replace("    <c1>", f"    <density>{density:.6g}</density>\n    <c1>")
        return text + f"*DENSITY\n{density:.6g},\n"

    return card


PROGRAMS: Mapping[str, Program] = {
    "newton": Program("Newton", ("1.8",), "pressure", READ, "gel.newton.py", TETRAHEDRA, _newton_rows, _newton),
    "genesis": Program("Genesis", ("1.4",), "taxels", RUN, "gel.genesis.py", TETRAHEDRA, _genesis_rows, _genesis),
    "mujoco": Program("MuJoCo", ("4.0",), "point", RUN, "gel.xml", TETRAHEDRA, _mujoco_rows, _mujoco),
    "drake": Program("Drake", ("1.51",), "pressure", RUN, "gel.drake.py", TETRAHEDRA, _drake_rows, _drake),
    "isaac": Program("Isaac Lab", ("2.3",), "taxels", READ, "gel.isaac.py", TETRAHEDRA, _isaac_rows, _isaac),
    "abaqus": Program("Abaqus", ("2024",), None, READ, "gel.inp", HYBRID, _hooke_rows, _card(".inp")),
    "calculix": Program("CalculiX", ("2.20",), None, RUN, "gel.inp", 0.495, _hooke_rows, _card(".ccx")),
    "febio": Program("FEBio", ("4.0",), None, READ, "gel.feb", HYBRID, _febio_rows, _card(".feb")),
}


def find_program(named: str) -> tuple[Program, str]:
    """Return the program and its version of "drake" or "drake==1.51". Raises InputError for unknown ones."""
    key, _, version = named.partition("==")
    check_known(key, PROGRAMS, what="there is no such program", where="--to")
    program: Any = PROGRAMS[key]
    if version and version not in program.versions:
        raise InputError(
            f"the contact law of this version of {program.title} was not read",
            where="--to",
            value=version,
            remedy=f"Known are {', '.join(program.versions)}; compare the law before you use it elsewhere.",
        )
    return program, version or program.versions[0]
