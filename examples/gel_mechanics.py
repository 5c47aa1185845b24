"""The gel as a solid: how stiff a punch finds it, how depth and friction bend the line, a material card."""

import numpy as np

from tactilevision import Material
from tactilevision.mechanics.export import write_material
from tactilevision.mechanics.flat_contact import FlatContact
from tactilevision.mechanics.kappa import kappa
from tactilevision.mechanics.punch_curve import punch_curve


def main() -> None:
    gel, radius_mm, thickness_mm = Material(0.1981, 0.4797), 2.5, 3.0
    factor = kappa(gel.poisson_ratio, radius_mm / thickness_mm)
    slope = 2 * radius_mm * gel.youngs_modulus_MPa * factor / (1 - gel.poisson_ratio**2)
    print(f"kappa = {factor:.4f}: a first slope of {slope:.3f} N/mm, no friction, sharp edge")
    for friction in (0.3, float("inf")):
        curve = punch_curve(FlatContact(radius_mm, 0.05, thickness_mm, friction), gel, 0.3)
        forces = curve.force_at(np.array([0.1, 0.2, 0.3]))
        told = ", ".join(f"{force:.3f}" for force in forces)
        print(f"friction {friction:g} ({curve.source}): {told} N at .1, .2, .3 mm")
    write_material("gel.inp", gel)
    print("wrote gel.inp (Abaqus: *HYPERELASTIC, NEO HOOKE)")


if __name__ == "__main__":
    main()
