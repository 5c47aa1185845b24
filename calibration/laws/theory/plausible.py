"""Is it a gel? What Young's modulus and Poisson's ratio the pads of such sensors can have at all."""

from __future__ import annotations

from tactilevision.records import Estimate, Gel, Pair

# From the softest casting gels (Shore 000, some 5 kPa) to silicone of Shore A 80, 9.4 MPa by Gent's relation
# E = .0981 (56 + 7.62336 S) / (.137505 (254 - 2.54 S)) MPa (A. N. Gent, Rubber Chem. Technol. 31, 1958, 896)
GEL_MODULUS_MPA: Pair = (0.005, 10.0)
FLAG = "modulus_outside_gels"
# Rubber lies at .45 to .5; from .3 on the tables of finite elements know a gel; below it are foam and cork
LEAST_POISSON_RATIO = 0.3
NU_FLAG = "poisson_ratio_outside_gels"


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


def stated_outside_gels(gel: Gel) -> str:
    """A sentence where the nu that is stated, with twice its std, is that of no gel; else empty."""
    nu = gel.poisson_ratio
    if nu is None or nu + 2 * (gel.poisson_ratio_std or 0.0) >= LEAST_POISSON_RATIO:
        return ""
    return (
        f"E rests on nu = {nu:g}, which [sensor.gel] states; rubbers and gels have 0.45 to 0.5: at rubber's nu "
        "the same forces give a far smaller E. State the gel's own, or leave poisson_ratio out"
    )


def apart_from_stated(modulus: Estimate, gel: Gel) -> str:
    """A sentence where the E of recording.toml, with twice its std, lies outside of the interval found."""
    stated, half = gel.youngs_modulus_MPa, 2 * (gel.youngs_modulus_std_MPa or 0.0)
    if stated is None or modulus.interval95 is None:
        return ""
    low, high = modulus.interval95
    if stated + half >= low and stated - half <= high:
        return ""
    return (
        f"E lies in {low:.3g} to {high:.3g} MPa, apart from the {stated:.3g} MPa that [sensor.gel] states, which "
        "takes no part in the fit: check its unit, the thickness and the radii"
    )
