"""Write a material card for finite-element programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactilevision.errors import InputError
from tactilevision.files.writing import write_json, write_text
from tactilevision.records.measured import Material

# Material cards for finite element programs, in mm, N, MPa.
#
# Small-strain E and nu become a compressible neo-Hooke solid, W = C10 (I1bar - 3) + U(J), with C10 = E/(4 (1 +
# nu)) and K = E/(3 (1 - 2 nu)). Abaqus and CalculiX have U = (J - 1)^2/D1 with D1 = 2/K; FEBio's uncoupled
# Mooney-Rivlin has U = K/2 (ln J)^2, the same to second order in J - 1. They differ only at a large change of
# volume, which a gel with nu above .45 does not have.
#
# Sources: Abaqus Theory Guide 4.6.1; CalculiX CrunchiX manual, *HYPERELASTIC; FEBio User Manual, Mooney-Rivlin.

CARDS = {
    ".inp": "** {about}\n*MATERIAL, NAME=GEL\n*HYPERELASTIC, NEO HOOKE\n{c10:.9g}, {d1:.9g}\n",
    ".ccx": "** {about}\n*MATERIAL, NAME=GEL\n*HYPERELASTIC,NEO HOOKE\n{c10:.9g}, {d1:.9g}\n",
    ".feb": "<!-- {about} -->\n"
    "<Material>\n"
    '  <material id="1" name="gel" type="Mooney-Rivlin">\n'
    "    <c1>{c10:.9g}</c1>\n    <c2>0</c2>\n    <k>{bulk:.9g}</k>\n"
    "  </material>\n</Material>\n",
}


def neo_hooke(material: Material) -> tuple[float, float]:
    """Return (C10 in MPa, D1 in 1/MPa) of W = C10 (I1bar - 3) + (J - 1)^2 / D1 with the same small-strain moduli.

    C10 = mu/2 = E / (4 (1 + nu)),  D1 = 2/K = 6 (1 - 2 nu)/E. Source: Abaqus Theory Guide, section 4.6.1.
    """
    return material.shear_modulus_MPa / 2, 2 / material.bulk_modulus_MPa


def material_record(material: Material) -> dict[str, Any]:
    """Return the material as plain numbers for JSON: E, nu, their covariance, and all that follows from them."""
    c10, d1 = neo_hooke(material)
    return {
        "youngs_modulus_MPa": material.youngs_modulus_MPa,
        "poisson_ratio": material.poisson_ratio,
        "covariance": None if material.covariance is None else material.covariance.tolist(),
        "shear_modulus_MPa": material.shear_modulus_MPa,
        "bulk_modulus_MPa": material.bulk_modulus_MPa,
        "neo_hooke": {"C10_MPa": c10, "D1_per_MPa": d1},
    }


def write_material(path: Path | str, material: Material) -> None:
    """Write the card whose suffix `path` has: .inp Abaqus, .ccx CalculiX, .feb FEBio, .json plain numbers."""
    suffix = Path(path).suffix.lower()
    if suffix == ".json":
        write_json(path, material_record(material))
        return
    if suffix not in CARDS:
        raise InputError(
            "no material card has this suffix",
            where=path,
            value=suffix,
            remedy=f"Choose one of {', '.join([*CARDS, '.json'])}.",
        )
    c10, d1 = neo_hooke(material)
    about = f"units: mm, N, MPa; E = {material.youngs_modulus_MPa:.6g} MPa, nu = {material.poisson_ratio:.6g}"
    write_text(path, CARDS[suffix].format(about=about, c10=c10, d1=d1, bulk=material.bulk_modulus_MPa))
