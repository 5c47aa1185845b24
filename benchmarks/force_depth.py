"""Force at large depth: neo-Hooke elements press a flat punch in, the camera looks, the force comes back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.force_cases import View, seen
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.press import press_to_depths
from tactilevision.mechanics.punch_fem.problem import PunchProblem
from tactilevision.records import Floats, Gel, Material

VIEW = View((240, 320), 0.0855, 1)
GEL = Gel(3.0, shape="disc", radius_mm=15.0)
EDGE_MM = 0.15
LIMIT = 0.04


def press_and_look(radius_mm: float, friction: float, poisson_ratio: float, *, depths_mm: Sequence[float],
                   std_mm: float = 0.002) -> Floats:  # fmt: skip
    """Rows: depth, true force, force found, and the same by linear elasticity alone."""
    material = Material(0.2, poisson_ratio)
    punch = RoundedPunch(radius_mm, EDGE_MM, friction)
    press = press_to_depths(PunchProblem(material, punch, GEL.thickness_mm, 15.0), list(depths_mm))
    scale = (VIEW.mm_per_px, VIEW.mm_per_px)
    settings = [ForceSettings(depth_correlation_px=1, large_depth=large) for large in (True, False)]
    fields = [ForceField(GEL, material, scale, view_px=VIEW.shape, settings=one) for one in settings]
    x, y = VIEW.mesh()
    r, rows = np.hypot(x, y), []
    for step in range(len(press.depth_mm)):
        out = np.interp(r, press.r_mm, press.u_r_mm[step]) / r
        u = np.stack([out * x, out * y, -np.interp(r, press.r_mm, press.u_z_mm[step])])
        maps = seen(u, VIEW, std_mm=std_mm, rng=np.random.default_rng(step))
        found = [field(*maps).resultant_N[2] for field in fields]
        rows.append([press.depth_mm[step], press.force_N[step], *found])
    return np.array(rows)


def main() -> None:
    """Print the table."""
    print(
        "large depth: flat punch, neo-Hooke, disc of 15 mm by 3 mm: found/true - 1 in % (linear elasticity alone)"
    )
    for radius, friction, nu in ((1.5, 0.3, 0.48), (2.5, 0.0, 0.48), (2.5, 0.3, 0.45), (2.5, 0.3, 0.48),
                                 (2.5, np.inf, 0.48), (4.0, 0.3, 0.48)):  # fmt: skip
        rows = press_and_look(radius, friction, nu, depths_mm=(0.15, 0.3, 0.45, 0.6))
        off = [f"w/h {w / 3:.2f}: {100 * (a / p - 1):+.1f} ({100 * (b / p - 1):+.1f})" for w, p, a, b in rows]
        print(f"    a {radius} mm, friction {friction}, nu {nu}: " + "   ".join(off))


if __name__ == "__main__":
    main()
