"""
The gel as a solid
==================

Stiffness of a thin gel under a flat punch, the influence of depth and friction, and a material card for Abaqus.
"""

import matplotlib.pyplot as plt
import numpy as np

from tactilevision import FlatContact, Material, kappa, punch_curve, write_material


def main() -> None:
    gel, radius_mm, thickness_mm = Material(0.1981, 0.4797), 2.5, 3.0
    factor = kappa(gel.poisson_ratio, radius_mm / thickness_mm)
    slope = 2 * radius_mm * gel.youngs_modulus_MPa * factor / (1 - gel.poisson_ratio**2)
    print(f"kappa = {factor:.4f}: a first slope of {slope:.3f} N/mm, no friction, sharp edge")
    figure, axes = plt.subplots(figsize=(6.5, 3.6), layout="constrained")
    depth_mm = np.linspace(0, 0.3, 31)
    axes.plot(depth_mm, np.full(31, slope), "k--", label="small strain, frictionless, sharp edge")
    for friction in (0.3, float("inf")):
        curve = punch_curve(FlatContact(radius_mm, 0.05, thickness_mm, friction), gel, 0.3)
        forces = curve.force_at(np.array([0.1, 0.2, 0.3]))
        axes.plot(
            depth_mm[1:],
            curve.force_at(depth_mm[1:]) / depth_mm[1:],
            label=f"finite elements, friction {friction:g}",
        )
        shown = ", ".join(f"{force:.3f}" for force in forces)
        print(f"friction {friction:g} ({curve.source}): {shown} N at .1, .2, .3 mm")
    axes.set(xlabel="depth w (mm)", ylabel="force over depth P/w (N/mm)")
    axes.legend()
    figure.savefig("gel_mechanics.png", dpi=150)
    write_material("gel.inp", gel)
    print("wrote gel.inp (Abaqus: *HYPERELASTIC, NEO HOOKE)")


if __name__ == "__main__":
    main()
