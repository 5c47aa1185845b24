"""A fitted gel as a material card for finite element programs, in mm, N, MPa.

Small-strain E and nu become a compressible neo-Hooke solid, W = C10 (I1bar - 3) + U(J), with
C10 = E/(4 (1 + nu)) and K = E/(3 (1 - 2 nu)). Abaqus and CalculiX take U = (J - 1)^2/D1 with D1 = 2/K; FEBio's
uncoupled Mooney-Rivlin takes U = K/2 (ln J)^2, the same to second order in J - 1: the moduli agree, and only
a large change of volume, which a gel with nu above .45 hardly knows, tells the two apart.

Sources: Abaqus Theory Guide 4.6.1; CalculiX CrunchiX manual, *HYPERELASTIC; FEBio User Manual, Mooney-Rivlin.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactilevision.errors import InputError
from tactilevision.files import write_json, write_text
from tactilevision.mechanics.material import bulk_modulus, neo_hooke, shear_modulus
from tactilevision.records import Material


def abaqus_text(material: Material, *, name: str = "GEL") -> str:
    """Keywords for an Abaqus input file: *HYPERELASTIC, NEO HOOKE with C10 (MPa) and D1 (1/MPa)."""
    return f"** units: mm, N, MPa; {_origin(material)}\n" + _keywords(material, name, "*HYPERELASTIC, NEO HOOKE")


def calculix_text(material: Material, *, name: str = "GEL") -> str:
    """Keywords for CalculiX: Abaqus' form; its names hold 80 characters and its comments begin with **."""
    return f"** units: mm, N, MPa; {_origin(material)}\n" + _keywords(material, name, "*HYPERELASTIC,NEO HOOKE")


def febio_text(material: Material, *, name: str = "gel") -> str:
    """A <Material> section of an FEBio file: uncoupled Mooney-Rivlin with c1 = C10, c2 = 0, k = K."""
    c10, _ = neo_hooke(material.youngs_modulus_MPa, material.poisson_ratio)
    bulk = float(bulk_modulus(material.youngs_modulus_MPa, material.poisson_ratio))
    return (
        f"<!-- units: mm, N, MPa; {_origin(material)} -->\n"
        "<Material>\n"
        f'  <material id="1" name="{_plain(name)}" type="Mooney-Rivlin">\n'
        f"    <c1>{c10:.9g}</c1>\n    <c2>0</c2>\n    <k>{bulk:.9g}</k>\n"
        "  </material>\n</Material>\n"
    )


def material_record(material: Material) -> dict[str, Any]:
    """The material as plain numbers for JSON: E, nu, their covariance, and all that follows from them."""
    E, nu = material.youngs_modulus_MPa, material.poisson_ratio
    c10, d1 = neo_hooke(E, nu)
    return {
        "youngs_modulus_MPa": E,
        "poisson_ratio": nu,
        "covariance": None if material.covariance is None else material.covariance.tolist(),
        "shear_modulus_MPa": float(shear_modulus(E, nu)),
        "bulk_modulus_MPa": float(bulk_modulus(E, nu)),
        "neo_hooke": {"C10_MPa": c10, "D1_per_MPa": d1},
    }


WRITERS = {".inp": abaqus_text, ".ccx": calculix_text, ".feb": febio_text}


def write_material(path: Path | str, material: Material) -> None:
    """Write the card whose suffix `path` has: .inp Abaqus, .ccx CalculiX, .feb FEBio, .json plain numbers."""
    suffix = Path(path).suffix.lower()
    if suffix == ".json":
        write_json(path, material_record(material))
    elif suffix in WRITERS:
        write_text(path, WRITERS[suffix](material))
    else:
        raise InputError(
            "no material card has this suffix",
            where=path,
            value=suffix,
            remedy=f"Choose one of {', '.join([*WRITERS, '.json'])}.",
        )


def _keywords(material: Material, name: str, hyperelastic: str) -> str:
    c10, d1 = neo_hooke(material.youngs_modulus_MPa, material.poisson_ratio)
    return f"*MATERIAL, NAME={_plain(name)}\n{hyperelastic}\n{c10:.9g}, {d1:.9g}\n"


def _origin(material: Material) -> str:
    return f"E = {material.youngs_modulus_MPa:.6g} MPa, nu = {material.poisson_ratio:.6g}"


def _plain(name: str) -> str:
    if not (name.isascii() and name.replace("_", "").replace("-", "").isalnum() and name[0].isalpha()):
        raise InputError(
            "a material's name begins with a letter and holds letters, digits, - and _",
            where="material card",
            value=name,
        )
    return name
