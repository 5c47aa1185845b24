"""Is it a gel? What Young's modulus the pads of such sensors can have at all."""

from __future__ import annotations

from tactilevision.records import Estimate, Pair

# From the softest casting gels (Shore 000, some 5 kPa) to silicone of Shore A 80, 9.4 MPa by Gent's relation
# E = .0981 (56 + 7.62336 S) / (.137505 (254 - 2.54 S)) MPa (A. N. Gent, Rubber Chem. Technol. 31, 1958, 896)
GEL_MODULUS_MPA: Pair = (0.005, 10.0)
FLAG = "modulus_outside_gels"


def outside_gels(modulus: Estimate) -> str:
    """A sentence where E, or all of its interval where it has no value, is that of no gel; else empty."""
    low, high = modulus.interval95 or (modulus.value, modulus.value)
    if modulus.value is not None:
        low = high = modulus.value
    if low is None or high is None or (low <= GEL_MODULUS_MPA[1] and high >= GEL_MODULUS_MPA[0]):
        return ""
    found = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    return (
        f"E = {found} MPa is that of no gel ({GEL_MODULUS_MPA[0]:g} to {GEL_MODULUS_MPA[1]:g} MPa): are forces "
        "in N, and depths, radii and thickness in mm?"
    )
