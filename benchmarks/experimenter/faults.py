"""Twenty kinds of fault, each by a formula of its own: what is read of a depth and of a force, noise apart.

A fault takes the scene, the number of a press and its sizes; it returns the depth (n,) and the force (n,) that
are read. Sizes are drawn log-evenly within their ranges; those in EITHER_WAY have a sign drawn as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.experimenter.design import Gel
from benchmarks.others_curves.law import Array, slope_N_per_mm
from benchmarks.others_curves.protocol import Press, Protocol

Sizes = Mapping[str, float]
EITHER_WAY = ("force_N", "thinner", "force_N_per_mm", "gain", "creep", "clock_rate")
FINE = 12  # steps of memory between two samples


@dataclass(frozen=True, slots=True)
class Scene:
    """Gel and presses, and the times at which the first begins and the last ends, s."""

    gel: Gel
    plan: Protocol

    @property
    def begin_s(self) -> float:
        """When the first press begins."""
        return float(self.plan.presses[0].time_s[0])

    @property
    def session_s(self) -> float:
        """From the first press to the end of the last."""
        return float(self.plan.presses[-1].time_s[-1]) - self.begin_s

    def sound(self, k: int) -> tuple[Press, Array, Array, Array]:
        """Press k: itself, its times since the session began, its depths and forces without any fault (n,)."""
        press = self.plan.presses[k]
        force = self.gel.force_N(press, press.depth_mm)
        return press, press.time_s - self.begin_s, press.depth_mm, force


Fault = Callable[[Scene, int, Sizes], tuple[Array, Array]]


def contact_late(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """The touch is seen after it happened, so that every depth reads too small."""
    _, _, w, force = scene.sound(k)
    return w - size["depth_mm"], force


def force_not_tared(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A zero of the force that is there in air as well."""
    _, _, w, force = scene.sound(k)
    return w, force + size["force_N"]


def wrong_thickness(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """The gel is thinner, or thicker, than stated."""
    press, _, w, _ = scene.sound(k)
    return w, scene.gel.force_N(press, w, thickness_mm=scene.gel.thickness_mm * (1 - size["thinner"]))


def guide_pulls(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A cable or a guide that pulls in proportion to the travel from where the force was tared."""
    _, _, w, force = scene.sound(k)
    return w, force + size["force_N_per_mm"] * (w - w[0])


def debonded_zone(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """Softer beyond a line over x, along which a fifth to a half of the presses lie."""
    press, _, w, force = scene.sound(k)
    x0 = np.quantile([p.place_mm[0] for p in scene.plan.presses], 1 - size["share"])
    return w, force * (1 - size["softer"] / (1 + np.exp(-(press.place_mm[0] - x0) / 0.5)))


def poroelastic(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """Drainage under a flat punch: the part q of a step's force fades as g(D t / a^2).

    g(x) = 1.304 exp(-sqrt(x)) - .304 exp(-.254 x), on a half-space. Source: Hu, Zhao, Vlassak, Suo, Appl. Phys.
    Lett. 96 (2010) 121904.
    """
    press, _, w, force = scene.sound(k)
    q, rate = size["drains"], size["diffusivity_mm2_s"] / scene.gel.radius_mm[press.radius_mm] ** 2
    drained = (1 - q) * force + q * remembered(scene, k, lambda t: drainage(rate * t))
    return w, np.where(w > 0, np.maximum(drained, 0.0), force)


def drainage(x: Array) -> Array:
    """g at D t / a^2 of x (n,)."""
    return np.asarray(1.304 * np.exp(-np.sqrt(x)) - 0.304 * np.exp(-0.254 * x))


def warm_up(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A sensor whose zero settles after it was switched on."""
    _, t, w, force = scene.sound(k)
    return w, force - size["force_N"] * np.expm1(-t / size["settles_s"])


def backlash(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """Lost motion: the motor turns back that far before the punch follows."""
    press, _, w, _ = scene.sound(k)
    return w, scene.gel.force_N(press, np.minimum(np.maximum.accumulate(w), w + size["depth_mm"] * _back(press)))


def sensor_creep(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A load cell whose reading creeps by a share of the load, up or down."""
    _, _, w, force = scene.sound(k)
    return w, force + size["creep"] * (force - remembered(scene, k, lambda t: np.exp(-t / size["settles_s"])))


def clock_rate(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """The depth's clock runs at another rate than the force's; both were set when the session began."""
    press, t, _, force = scene.sound(k)
    return np.interp(press.time_s - press.time_s[0] + size["clock_rate"] * t, *press.corners), force


def low_pass(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A filter of first order in the force sensor."""
    _, _, w, force = scene.sound(k)
    return w, force - remembered(scene, k, lambda t: np.exp(-t / size["filter_s"]))


def depth_steps(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A depth that is read in coarse steps."""
    _, _, w, force = scene.sound(k)
    return np.round(w / size["step_mm"]) * size["step_mm"], force


def gain_drift(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A force that drifts in proportion to itself, evenly over the session."""
    _, t, w, force = scene.sound(k)
    return w, force * (1 + size["gain"] * t / scene.session_s)


def slip_stick(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A stage that sticks until its spring is wound up, then jumps: the punch lags by a saw tooth."""
    press, _, w, _ = scene.sound(k)
    travel = np.where(_back(press), w.max() - w, w - w[0])
    lag = size["depth_mm"] * np.mod(travel / size["every_mm"], 1.0)
    return w, scene.gel.force_N(press, np.where(_back(press), w + lag, w - lag))


def permanent_set(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A surface that stays lower by a share of the deepest that its place has seen."""
    press, _, w, _ = scene.sound(k)
    before = [p.depth_mm.max() for p in scene.plan.presses[:k] if p.place_mm == press.place_mm]
    lower = size["stays"] * np.maximum.accumulate(np.maximum(w, max(before, default=0.0)))
    return w, scene.gel.force_N(press, w - lower)


def tilt_soft_frame(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A tilted face, and a frame that gives under the force.

    The whole face touches from w = 2 a theta on (p = (w + 2 theta x) / sqrt(a^2 - x^2) > 0); the edge from
    -a theta on. Between, the power 3/2 joins both in value and slope.
    """
    press, _, w, _ = scene.sound(k)
    edge = scene.gel.radius_mm[press.radius_mm] * size["tilt_rad"]
    toe = 2 * edge * (np.clip((w + edge) / (3 * edge), 0.0, 1.0)) ** 1.5
    force = scene.gel.force_N(press, np.where(w < 2 * edge, toe, w))
    return w + size["give_mm_per_N"] * force, force


def gent(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """Chains that come to their end: J_m / (J_m - J), J = s^2 + 2/s - 3 at the stretch s = 1 - w/h.

    Source: Gent, Rubber Chem. Technol. 69 (1996) 59.
    """
    _, _, w, force = scene.sound(k)
    stretch = 1 - np.maximum(w, 0.0) / scene.gel.thickness_mm
    return w, force / (1 - (stretch**2 + 2 / stretch - 3) / size["J_m"])


def adhesion(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A face that clings on the way out: straight on below the touch, until sqrt(8 pi a^3 E* W) (Kendall 1971)."""
    press, _, w, force = scene.sound(k)
    gel, a = scene.gel, scene.gel.radius_mm[press.radius_mm]
    pull = slope_N_per_mm(gel.modulus_MPa, gel.nu, a, gel.thickness_mm) * np.minimum(w, 0.0)
    most = np.sqrt(8 * np.pi * a**3 * gel.modulus_MPa / (1 - gel.nu**2) * 1e-3 * size["work_J_per_m2"])
    return w, force + np.where(_back(press) & (-pull < most), pull, 0.0)


def noise_grows(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """Nothing but the noise of samples, which `noise_factor` makes larger."""
    _, _, w, force = scene.sound(k)
    return w, force


def noise_factor(press: Press, size: Sizes) -> Array:
    """How much larger than in air the noise is (n,), by the depth."""
    depth = np.maximum(press.depth_mm, 0.0)
    return np.asarray(1 + size.get("noise_grows", 0.0) * depth / depth.max())


def swelling(scene: Scene, k: int, size: Sizes) -> tuple[Array, Array]:
    """A glued gel takes up liquid: thicker by s, its surface higher by s h, its modulus J^(-1/3), J = 1 + s.

    Source: Flory, Rehner, J. Chem. Phys. 11 (1943) 521.
    """
    press, t, w, _ = scene.sound(k)
    s = -size["thicker"] * np.expm1(-t[0] / (size["settles"] * scene.session_s))
    h = round(float(scene.gel.thickness_mm * (1 + s)), 6)
    return w, scene.gel.force_N(press, w + s * scene.gel.thickness_mm, thickness_mm=h) * (1 + s) ** (-1 / 3)


def remembered(scene: Scene, k: int, fades: Callable[[Array], Array]) -> Array:
    """The force that is left of all its changes, each faded since: int fades(t - t') dP(t'), of press k (n,)."""
    press, _, _, _ = scene.sound(k)
    t = press.time_s - press.time_s[0]
    fine = np.interp(np.arange(0, t.size - 1 + 1 / FINE, 1 / FINE), np.arange(t.size), t)
    force = scene.gel.force_N(press, np.interp(fine, *press.corners))
    nodes, weights = np.polynomial.legendre.leggauss(4)
    at = (fine[1:, None] + fine[:-1, None] + nodes * np.diff(fine)[:, None]) / 2
    since = t[:, None, None] - at
    share = np.where(since > 0, fades(np.maximum(since, 0.0)), 0.0) @ (weights / 2)
    return np.asarray(share @ np.diff(force))


def _back(press: Press) -> Array:
    """Which samples (n,) are on the way out, in air or not."""
    return np.asarray(np.arange(press.depth_mm.size) > np.flatnonzero(press.depth_mm >= press.depth_mm.max())[-1])


FAULTS: Mapping[str, tuple[Fault, Mapping[str, tuple[float, float]]]] = {
    "contact_late": (contact_late, {"depth_mm": (0.025, 0.06)}),
    "force_not_tared": (force_not_tared, {"force_N": (0.2, 1.5)}),
    "wrong_thickness": (wrong_thickness, {"thinner": (0.12, 0.3)}),
    "guide_pulls": (guide_pulls, {"force_N_per_mm": (0.1, 0.6)}),
    "debonded_zone": (debonded_zone, {"softer": (0.2, 0.4), "share": (0.2, 0.5)}),
    "poroelastic": (poroelastic, {"drains": (0.05, 0.15), "diffusivity_mm2_s": (0.1, 1.0)}),
    "warm_up": (warm_up, {"force_N": (0.05, 0.2), "settles_s": (120.0, 600.0)}),
    "backlash": (backlash, {"depth_mm": (0.01, 0.04)}),
    "sensor_creep": (sensor_creep, {"creep": (0.01, 0.04), "settles_s": (1.0, 10.0)}),
    "clock_rate": (clock_rate, {"clock_rate": (1e-5, 1e-4)}),
    "low_pass": (low_pass, {"filter_s": (0.02, 0.2)}),
    "depth_steps": (depth_steps, {"step_mm": (0.015, 0.05)}),
    "gain_drift": (gain_drift, {"gain": (0.02, 0.12)}),
    "slip_stick": (slip_stick, {"depth_mm": (0.008, 0.025), "every_mm": (0.06, 0.2)}),
    "permanent_set": (permanent_set, {"stays": (0.02, 0.08)}),
    "tilt_soft_frame": (tilt_soft_frame, {"tilt_rad": (0.004, 0.02), "give_mm_per_N": (3e-3, 15e-3)}),
    "gent": (gent, {"J_m": (0.6, 4.0)}),
    "adhesion": (adhesion, {"work_J_per_m2": (0.05, 1.0)}),
    "noise_grows": (noise_grows, {"noise_grows": (2.0, 8.0)}),
    "swelling": (swelling, {"thicker": (0.003, 0.015), "settles": (0.3, 2.0)}),
}


def draw(rng: np.random.Generator, kind: str) -> dict[str, float]:
    """Return the sizes of a fault; none for "clean"."""
    ranges = FAULTS[kind][1] if kind in FAULTS else {}
    signs = {name: int(rng.choice([-1, 1])) if name in EITHER_WAY else 1 for name in ranges}
    return {n: signs[n] * float(np.exp(rng.uniform(*np.log(span)))) for n, span in ranges.items()}
