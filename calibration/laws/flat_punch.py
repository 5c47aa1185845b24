"""Flat-ended cylinder on a bonded layer, with a free curvature of force against depth.

    P = c w (1 + beta w/h),    c = 2 a E kappa(nu, a/h) / (1 - nu^2)

P force (N), w depth (mm), a radius, h thickness, E (MPa). kappa from the integral equation at the true a/h:
small strain, frictionless, layer far wider than the punch. Where the edge is stated to be rounded, the contact
begins smaller and grows (tactilevision.mechanics.filleted_punch); c and beta stay the sharp punch's.
beta holds what large strain and friction add. Theory gives it no single value, so it is free; as it changes with
a/h, each radius has its own.
No force where w <= 0. Source: Hayes et al., J. Biomech. 5 (1972) 541; the form of the bracket: Zhang, Zheng, Mak,
Med. Eng. Phys. 19 (1997) 57.

`bent`: the bracket as finite elements have it, 1 + beta eps + gamma eps (eps - .2), eps = w/h: beta stays the
slope of the chord up to w/h = .2, and gamma, one a radius, lies between the bounds of laws/theory.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws.theory import RUBBING, bend_range, beta_range, punch_stiffness, sticking_surplus
from calibration.model.composition import Composable
from calibration.model.stages import Parameter, Prior, State
from tactilevision.errors import InputError
from tactilevision.mechanics.filleted_punch import rounded_contact
from tactilevision.records.measured import Floats, Pair
from tactilevision.records.rig import Gel

SILICONE_NU: Pair = (0.45, 0.4999)  # of all silicones: the range where nothing states nu
OPEN_NU: Pair = (0.3, 0.4999)  # of any gel: the range of the tables, where no bound is to be used
# Poisson's ratios for which E is listed where nu is open: all silicones, in steps of .005
NU_TABLE: tuple[float, ...] = (*np.round(np.arange(0.45, 0.4999, 0.005), 3).tolist(), SILICONE_NU[1])
NOMINAL_NU = 0.48  # where nothing states nu: within SILICONE_NU; what E would be at others is in NU_TABLE
CHORD = 0.2  # w/h up to which theory's slopes are chords
KEPT = 16  # states, each at some nu, of which the stiffness is kept: most steps of a fit move neither
STATED_NU_STD = 0.005  # a nu stated without a std is taken to be good to its last usual digit

_STIFFNESS: deque[tuple[float, float, tuple[Floats, ...], Floats]] = deque(maxlen=KEPT)


@dataclass(frozen=True, slots=True)
class FlatPunch(Composable):
    """The default law. `free_poisson_ratio` lets nu vary where several radii may fix it.

    `sticking` from 0 (frictionless) to 1 (the gel sticks to the face) adds that share of the surplus stiffness;
    `bent` adds one gamma a radius; `one_depth` holds beta by theory, since such presses tell nothing of it.
    `poisson_range`: where nothing fixes nu, it lies there.
    """

    free_poisson_ratio: bool = False
    sticking: float = 0.0
    bent: bool = False
    one_depth: bool = False
    poisson_range: Pair = SILICONE_NU

    @property
    def key(self) -> str:
        """The name in the catalogue."""
        return "flat_punch"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """E, nu, then beta for each radius in rising order, then gamma for each, if bent."""
        modulus = Parameter(
            "youngs_modulus_MPa",
            "MPa",
            starting_modulus(data),
            (1e-5, 1e4),
            "Young's modulus of the gel",
            starting_modulus(data),
        )
        curvature = betas_of_theory(data) if self.one_depth else betas(data)
        known = (modulus, poisson_parameter(data.gel, self.free_poisson_ratio), *curvature)
        return (*known, *bends(data)) if self.bent else known

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """c and the force on the state's own radius and thickness."""
        climbing = max(self.sticking, state.sticking)
        sharp, begun = values[0] * _per_modulus(state, float(values[1]), climbing)
        if self.sticking:
            ratios = np.unique(data.presses.radius_mm) / data.gel.thickness_mm
            surplus = np.array([sticking_surplus(values[1], float(r)) for r in ratios])
            stuck = 1 + self.sticking * surplus[radius_number(data)]
            sharp, begun = stuck * sharp, stuck * begun
        number = radius_number(data)
        depth = np.maximum(state.depth_mm, 0)
        strain = depth / state.thickness_mm
        bracket = 1 + values[2:][number] * strain
        if self.bent:
            gamma = values[2 + values[2:].size // 2 :][number]
            bracket = bracket + gamma * strain * (strain - CHORD)
        return replace(state, stiffness_N_per_mm=sharp, force_N=begun * depth * bracket)


def _per_modulus(state: State, poisson_ratio: float, sticking: float) -> Floats:
    """Force over depth at E = 1 MPa, of a sharp edge and of the edge as it is, (2, N) in N/mm; kept for the last
    few states.
    """
    shape = (state.depth_mm, state.radius_mm, state.edge_mm, state.thickness_mm, state.factor)
    for nu, sticks, known, found in tuple(reversed(_STIFFNESS)):
        if nu == poisson_ratio and sticks == sticking and all(map(_same, known, shape)):
            return found
    found = np.array(
        [
            where.factor
            * punch_stiffness(1.0, poisson_ratio, radius_mm=where.radius_mm, thickness_mm=where.thickness_mm)
            for where in (state, on_its_edge(state, poisson_ratio, sticking=sticking))
        ]
    )
    found.setflags(write=False)
    # an effect may write into its own arrays again
    own = tuple(one.copy() if one.flags.writeable else one for one in shape)
    _STIFFNESS.append((poisson_ratio, sticking, own, found))
    return found


def _same(one: Floats, other: Floats) -> bool:
    return one is other or np.array_equal(one, other)


def on_its_edge(state: State, poisson_ratio: float, *, sticking: float = 0.0) -> State:
    """The contact's radius in place of the punch's where the edge is rounded, its share of force in `factor`.

    Samples (N,) whose punch or thickness is not a number are left as they are: their force is none either.
    """
    left = (state.edge_mm > 0) & np.isfinite(state.radius_mm) & np.isfinite(state.thickness_mm)
    if not left.any():
        return state
    radius, share = state.radius_mm.copy(), state.factor.copy()
    while left.any():  # kinds of punch are few: quicker than to sort all samples
        k = int(np.argmax(left))
        outer, edge, thickness = (float(one[k]) for one in (state.radius_mm, state.edge_mm, state.thickness_mm))
        mine = left & (state.radius_mm == outer) & (state.edge_mm == edge) & (state.thickness_mm == thickness)
        left &= ~mine
        radius[mine], met = rounded_contact(
            state.depth_mm[mine],
            outer,
            edge_mm=edge,
            thickness_mm=thickness,
            poisson_ratio=poisson_ratio,
            sticking=sticking,
        )
        share[mine] *= met
    return replace(state, radius_mm=radius, factor=share)


def betas(data: Observations) -> tuple[Parameter, ...]:
    """One beta a radius, named by it where there are several."""
    radii = np.unique(data.presses.radius_mm)
    names = ["beta"] if radii.size == 1 else [f"beta[{radius:g}]" for radius in radii]
    return tuple(Parameter(n, "1", 0.85, (-3.0, 12.0), "curvature of P/w against w/h", 1.0) for n in names)


def betas_of_theory(data: Observations) -> tuple[Parameter, ...]:
    """The same, held by what laws from neo-Hooke to sticking Hencky have there, without friction if lubricated.

    That range is taken for 95 %. Raises InputError where a/h is too far from the ratios that it is known for.
    """
    held = []
    for plain, radius in zip(betas(data), np.unique(data.presses.radius_mm), strict=True):
        known = beta_range(SILICONE_NU, float(radius) / data.gel.thickness_mm)
        if known is None:
            raise InputError(
                "presses of one depth need theory's curvature, which is not known at this a/h",
                where=f"radius {radius:g} mm",
                value=float(radius) / data.gel.thickness_mm,
                remedy="Press to two depths at least, one twice the other.",
            )
        low, high = known if np.all(data.presses.lubricated == 1) else (RUBBING, known[1])
        prior = Prior((low + high) / 2, (high - low) / 4, "finite elements")
        held.append(replace(plain, default=prior.mean, prior=prior))
    return tuple(held)


def bends(data: Observations) -> tuple[Parameter, ...]:
    """One gamma a radius, between what theory allows there; a straight bracket is what is usual."""
    gel, table = data.gel, []
    nu = NOMINAL_NU if gel.poisson_ratio is None else gel.poisson_ratio
    for radius in np.unique(data.presses.radius_mm):
        mine = data.radius_mm == radius
        deepest = float(np.max(data.depth_mm[mine])) / gel.thickness_mm
        low, high = bend_range(round(nu, 3), round(float(radius) / gel.thickness_mm, 3), 0.0, round(deepest, 3))
        table.append(Parameter(f"bend[{radius:g}]", "1", 0.0, (low, high), "bend of P/w against w/h", 1.0,
                               Prior(0.0, (high - low) / 2, "finite elements")))  # fmt: skip
    return tuple(table)


@lru_cache(maxsize=KEPT)
def radius_number(data: Observations) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Which radius, in rising order, each sample (N,) belongs to."""
    return np.unique(data.presses.radius_mm, return_inverse=True)[1][data.press]


def elastomer_bound(used: bool) -> Pair | None:
    """What holds nu where nothing is stated of it; None where that is not wanted."""
    return SILICONE_NU if used else None


def poisson_parameter(gel: Gel, free: bool) -> Parameter:
    """nu with what is known of it: a prior where one is stated, else free in the silicones' range or held."""
    if gel.poisson_ratio is not None:
        mean, std = gel.poisson_ratio, gel.poisson_ratio_std
        if std == 0:
            return Parameter("poisson_ratio", "1", mean, (mean, mean), "Poisson's ratio, as stated", 0.01)
        spread = STATED_NU_STD if std is None else std
        return Parameter(
            "poisson_ratio",
            "1",
            min(mean, 0.4999),
            (0.0, 0.4999),
            "Poisson's ratio",
            0.01,
            Prior(mean, spread, "recording.toml"),
        )
    bounds = OPEN_NU if free else (NOMINAL_NU, NOMINAL_NU)
    return Parameter("poisson_ratio", "1", NOMINAL_NU, bounds, "Poisson's ratio of the gel", 0.01)


def starting_modulus(data: Observations) -> float:
    """E of the right size: from the median of P/w, for a start."""
    deep = data.depth_mm > 0.5 * np.max(data.depth_mm)
    per_depth = float(np.median(data.normal_N[deep] / data.depth_mm[deep]))
    radius, thickness = float(np.median(data.radius_mm)), data.gel.thickness_mm
    unit = float(
        punch_stiffness(1.0, NOMINAL_NU, radius_mm=np.array([radius]), thickness_mm=np.array([thickness]))[0]
    )
    return max(per_depth / unit / 1.1, 1e-4)
