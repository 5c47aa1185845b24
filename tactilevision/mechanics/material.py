"""Convert the moduli of an isotropic gel, and write a material card for finite-element programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files.writing import write_json, write_text
from tactilevision.records.measured import Floats, Material

# Moduli of an isotropic gel: numbers or arrays that broadcast. Source: Landau, Lifshitz, Theory of Elasticity,
# section 5.


def shear_modulus(youngs_modulus_MPa: npt.ArrayLike, poisson_ratio: npt.ArrayLike) -> Floats:
    """Return mu = E / (2 (1 + nu)), MPa, any shape."""
    return np.asarray(positive("youngs_modulus_MPa", youngs_modulus_MPa) / (2 * (1 + _poisson(poisson_ratio))))


def bulk_modulus(youngs_modulus_MPa: npt.ArrayLike, poisson_ratio: npt.ArrayLike) -> Floats:
    """Return K = E / (3 (1 - 2 nu)), MPa, any shape; nu < .5."""
    nu = _poisson(poisson_ratio)
    if (nu >= 0.5).any():
        raise InputError(
            "the bulk modulus is infinite at nu = .5",
            where="mechanics",
            value=0.5,
            remedy="For a nearly incompressible gel take .4999.",
        )
    return np.asarray(positive("youngs_modulus_MPa", youngs_modulus_MPa) / (3 * (1 - 2 * nu)))


def neo_hooke(youngs_modulus_MPa: float, poisson_ratio: float) -> tuple[float, float]:
    """Return (C10 in MPa, D1 in 1/MPa) of W = C10 (I1bar - 3) + (J - 1)^2 / D1 with the same small-strain moduli.

    C10 = mu/2 = E / (4 (1 + nu)),  D1 = 2/K = 6 (1 - 2 nu)/E. Source: Abaqus Theory Guide, section 4.6.1.
    """
    return (
        float(shear_modulus(youngs_modulus_MPa, poisson_ratio)) / 2,
        2 / float(bulk_modulus(youngs_modulus_MPa, poisson_ratio)),
    )


def positive(name: str, value: npt.ArrayLike) -> Floats:
    """Return `value` as an array of any shape, in its unit; raise InputError if any is not finite and above 0."""
    numbers = np.asarray(value, dtype=float)
    if not (np.isfinite(numbers) & (numbers > 0)).all():
        raise InputError(
            f"{name} is a finite number above 0",
            where="mechanics",
            value=np.min(numbers).item(),
            remedy="Check its unit and its sign.",
        )
    return numbers


def _poisson(value: npt.ArrayLike) -> Floats:
    nu = np.asarray(value, dtype=float)
    if not ((nu >= 0) & (nu <= 0.5)).all():
        raise InputError("Poisson's ratio lies in [0, .5]", where="mechanics", value=np.ravel(nu).tolist())
    return nu


# Material cards for finite element programs, in mm, N, MPa.
#
# Small-strain E and nu become a compressible neo-Hooke solid, W = C10 (I1bar - 3) + U(J), with C10 = E/(4 (1 +
# nu)) and K = E/(3 (1 - 2 nu)). Abaqus and CalculiX have U = (J - 1)^2/D1 with D1 = 2/K; FEBio's uncoupled
# Mooney-Rivlin has U = K/2 (ln J)^2, the same to second order in J - 1. They differ only at a large change of
# volume, which a gel with nu above .45 does not have.
#
# Sources: Abaqus Theory Guide 4.6.1; CalculiX CrunchiX manual, *HYPERELASTIC; FEBio User Manual, Mooney-Rivlin.


def abaqus_text(material: Material, *, name: str = "GEL") -> str:
    """Return the keywords for an Abaqus input file: *HYPERELASTIC, NEO HOOKE with C10 (MPa) and D1 (1/MPa)."""
    return f"** units: mm, N, MPa; {_origin(material)}\n" + _keywords(material, name, "*HYPERELASTIC, NEO HOOKE")


def calculix_text(material: Material, *, name: str = "GEL") -> str:
    """Return the keywords for CalculiX: Abaqus' form.

    Its names hold 80 characters and its comments begin with **.
    """
    return f"** units: mm, N, MPa; {_origin(material)}\n" + _keywords(material, name, "*HYPERELASTIC,NEO HOOKE")


def febio_text(material: Material, *, name: str = "gel") -> str:
    """Return a <Material> section of an FEBio file: uncoupled Mooney-Rivlin with c1 = C10, c2 = 0, k = K."""
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
    """Return the material as plain numbers for JSON: E, nu, their covariance, and all that follows from them."""
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
