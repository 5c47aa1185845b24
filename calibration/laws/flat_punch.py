"""Flat-ended cylinder on a bonded layer, with a free curvature of force against depth.

    P = c w (1 + beta w/h),    c = 2 a E kappa(nu, a/h) / (1 - nu^2)

P is the force (N), w the depth (mm), a the radius, h the thickness, E the modulus (MPa); P = 0 where w <= 0. kappa
follows from the integral equation at the true a/h: small strain, no friction, a layer far wider than the punch.
Where a rounded edge is stated the contact starts smaller and grows (tactilevision.mechanics.filleted_punch); c and
beta remain those of the sharp punch. beta takes up large strain and friction; theory gives it no single value, so
it is free, and one a radius, since it depends on a/h.

`bent` adds the quadratic term of finite elements, 1 + beta eps + gamma eps (eps - .2), eps = w/h: beta is then the
slope of the chord up to eps = .2, and gamma, one a radius, lies within the bounds of laws/theory.
Sources: Hayes et al., J. Biomech. 5 (1972) 541; the bracket: Zhang, Zheng, Mak, Med. Eng. Phys. 19 (1997) 57.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from calibration.inputs.observations import Observations
from calibration.laws import theory
from calibration.model.composition import Composable
from calibration.model.dual import chained, moves, value_of
from calibration.model.stages import Parameter, Prior, State
from tactilevision.errors import InputError
from tactilevision.mechanics.filleted_punch import Punch, contacts_and_slopes
from tactilevision.records.constants import NU_MAX, NU_NOMINAL, NU_SILICONE
from tactilevision.records.measured import Bools, Floats, Pair
from tactilevision.records.rig import Gel

SILICONE_NU: Pair = NU_SILICONE
OPEN_NU: Pair = (theory.NU[0], NU_MAX)  # of any gel: the range of the tables, where no bound is to be used
STATED_NU_STD = 0.005  # std of a nu stated without one: half a unit of its last usual digit
# nu for which E is listed where nu is open: all silicones
NU_TABLE: tuple[float, ...] = (*np.round(np.arange(*NU_SILICONE, STATED_NU_STD), 3).tolist(), NU_MAX)
LEAST_MPA = 1e-4  # MPa, least start of E
CHORD = 0.2  # w/h up to which theory's slopes are chords
KEPT = 16  # cached stiffnesses, each of a state and a nu: most steps of a fit change neither

_STIFFNESS: deque[tuple[float, float, tuple[Floats, ...], Floats]] = deque(maxlen=KEPT)


@dataclass(frozen=True, slots=True)
class FlatPunch(Composable):
    """The default law. `free_poisson_ratio` lets nu vary where several radii may determine it.

    `sticking` from 0 (frictionless) to 1 (no slip) adds that share of the surplus stiffness; `bent` adds one gamma
    a radius; `one_depth` gives beta a prior from theory, since presses of one depth do not determine it;
    `poisson_range` is the range of nu where nothing determines it.
    """

    free_poisson_ratio: bool = False
    sticking: float = 0.0
    bent: bool = False
    one_depth: bool = False
    poisson_range: Pair = SILICONE_NU

    key = "flat_punch"

    def parameters(self, data: Observations) -> tuple[Parameter, ...]:
        """Return E, nu, then beta for each radius in rising order, then gamma for each, if bent."""
        modulus = modulus_parameter(starting_modulus(data))
        curvature = betas_by_theory(data) if self.one_depth else betas(data)
        known = (modulus, poisson_parameter(data.gel, self.free_poisson_ratio), *curvature)
        return (*known, *gammas(data)) if self.bent else known

    def apply(self, state: State, values: Floats, data: Observations) -> State:
        """Return the state with c and the force on its own radius and thickness."""
        number = radius_number(data)
        factor = values[0]
        if self.sticking:
            ratios = np.unique(data.presses.radius_mm) / data.gel.thickness_mm
            surplus = (theory.sticking_surplus(values[1], float(r)) * (number == k) for k, r in enumerate(ratios))
            factor = factor * (1 + self.sticking * sum(surplus))
        unit = _per_modulus(state, values[1], max(self.sticking, state.sticking))
        sharp, rounded = factor * unit[0], factor * unit[1]
        depth = np.maximum(state.depth_mm, 0)
        strain = depth / state.thickness_mm
        bracket = 1 + values[2:][number] * strain
        if self.bent:
            gamma = values[2 + (len(values) - 2) // 2 :][number]
            bracket = bracket + gamma * strain * (strain - CHORD)
        return replace(state, stiffness_N_per_mm=sharp, force_N=rounded * depth * bracket)


def _per_modulus(state: State, poisson_ratio: float, sticking: float) -> Floats | list[Floats]:
    """Return force over depth at E = 1 MPa of a sharp edge and of the actual edge, (2, N) in N/mm; cached."""
    shape = (state.depth_mm, state.radius_mm, state.edge_mm, state.thickness_mm, state.factor)
    if moves(poisson_ratio, sticking, *shape):
        return _both(state, poisson_ratio, sticking)
    for nu, sticks, known, table in tuple(reversed(_STIFFNESS)):
        same = (one is other or np.array_equal(one, other) for one, other in zip(known, shape, strict=True))
        if nu == poisson_ratio and sticks == sticking and all(same):
            return table
    table = np.array(_both(state, poisson_ratio, sticking))
    table.setflags(write=False)
    copies = tuple(a.copy() if a.flags.writeable else a for a in shape)  # an effect may reuse its arrays
    _STIFFNESS.append((poisson_ratio, sticking, copies, table))
    return table


def _both(state: State, poisson_ratio: float, sticking: float) -> list[Floats]:
    rounded = on_its_edge(state, poisson_ratio, sticking=sticking)
    unit = partial(theory.punch_stiffness, 1.0, poisson_ratio)
    sharp = state.factor * unit(radius_mm=state.radius_mm, thickness_mm=state.thickness_mm)
    if rounded is state:
        return [sharp, sharp]
    return [sharp, rounded.factor * unit(radius_mm=rounded.radius_mm, thickness_mm=rounded.thickness_mm)]


def on_its_edge(state: State, poisson_ratio: float, *, sticking: float = 0.0) -> State:
    """Return the state with the contact's radius instead of the punch's where the edge is rounded.

    Its share of the force enters `factor`. Samples (N,) without a finite radius or thickness are not changed.
    """
    given = (state.radius_mm, state.edge_mm, state.thickness_mm, poisson_ratio, sticking)
    radii, edges, layers, nu, sticks = (value_of(one) for one in given)
    left = (edges > 0) & np.isfinite(radii) & np.isfinite(layers)
    if not left.any():
        return state
    met, depth = np.array([radii, np.ones(radii.size)]), value_of(state.depth_mm)
    moved = [(order, one) for order, one in enumerate((state.depth_mm, *given)) if moves(one)]
    slopes = np.zeros((len(moved), *met.shape))
    for row, (order, _) in zip(slopes, moved, strict=True):
        row[0] = order == 1  # where the edge is sharp the contact's radius is the punch's
    kinds = list[tuple[Bools, Punch]]()
    while left.any():  # few kinds of punch: quicker than sorting all samples
        k = int(np.argmax(left))
        mine = left & (radii == radii[k]) & (edges == edges[k]) & (layers == layers[k])
        left &= ~mine
        kinds.append((mine, (float(radii[k]), float(edges[k]), float(layers[k]), float(nu), float(sticks))))
    depths, punches = [depth[mine] for mine, _ in kinds], [punch for _, punch in kinds]
    found = contacts_and_slopes(depths, punches, along=[order for order, _ in moved])
    for (mine, _), (there, change) in zip(kinds, found, strict=True):
        met[:, mine], slopes[:, :, mine] = there, change
    radius, share = met
    if moved:
        radius, share = (
            chained(met[k], [(row[k], one) for row, (_, one) in zip(slopes, moved, strict=True)]) for k in (0, 1)
        )
    return replace(state, radius_mm=radius, factor=state.factor * share)


def betas(data: Observations) -> tuple[Parameter, ...]:
    """Return one beta a radius, named after it where there are several."""
    radii = np.unique(data.presses.radius_mm)
    names = ["beta"] if radii.size == 1 else [f"beta[{radius:g}]" for radius in radii]
    start, meaning = theory.THEORY_BETA, "curvature of P/w against w/h"
    return tuple(Parameter(name, "1", start, (-3, 12), meaning, 1.0) for name in names)


def betas_by_theory(data: Observations) -> tuple[Parameter, ...]:
    """Return the same with a prior from theory: its range, from neo-Hooke to sticking Hencky, as 95 %.

    Without friction only where all presses are lubricated. Raises InputError outside the a/h of that range.
    """
    held = []
    for free, radius in zip(betas(data), np.unique(data.presses.radius_mm), strict=True):
        known = theory.beta_range(SILICONE_NU, float(radius) / data.gel.thickness_mm)
        if known is None:
            raise InputError(
                "presses of one depth need the curvature from theory, which is not known at this a/h",
                where=f"radius {radius:g} mm",
                value=float(radius) / data.gel.thickness_mm,
                remedy="Press to two depths at least, one twice the other.",
            )
        low, high = known if np.all(data.presses.lubricated == 1) else (theory.RUBBING, known[1])
        prior = Prior((low + high) / 2, (high - low) / 4, "finite elements")
        held.append(replace(free, default=prior.mean, prior=prior))
    return tuple(held)


def gammas(data: Observations) -> tuple[Parameter, ...]:
    """Return one gamma a radius, within the range of theory, with a prior about 0."""
    gel, table = data.gel, []
    nu = theory.nominal_nu(gel)
    for radius in np.unique(data.presses.radius_mm):
        mine = data.radius_mm == radius
        deepest = float(np.max(data.depth_mm[mine])) / gel.thickness_mm
        low, high = theory.bend_range(round(nu, 3), round(float(radius) / gel.thickness_mm, 3), round(deepest, 3))
        table.append(Parameter(f"bend[{radius:g}]", "1", 0.0, (low, high), "bend of P/w against w/h", 1.0,
                               Prior(0.0, (high - low) / 2, "finite elements")))  # fmt: skip
    return tuple(table)


@lru_cache(maxsize=KEPT)
def radius_number(data: Observations) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the index of each sample's radius (N,), in rising order."""
    return np.unique(data.presses.radius_mm, return_inverse=True)[1][data.press]


def poisson_parameter(gel: Gel, free: bool) -> Parameter:
    """Return nu with a prior where it is stated, else free in the tables' range, or fixed."""
    bounds = OPEN_NU if free else (NU_NOMINAL, NU_NOMINAL)
    nu = Parameter("poisson_ratio", "1", NU_NOMINAL, bounds, "Poisson's ratio of the gel", 0.01)
    mean, std = gel.poisson_ratio, gel.poisson_ratio_std
    if mean is None:
        return nu
    if std == 0:
        return replace(nu, default=mean, bounds=(mean, mean), meaning="Poisson's ratio, as stated")
    prior = Prior(mean, STATED_NU_STD if std is None else std, "recording.toml")
    return replace(nu, default=min(mean, NU_MAX), bounds=(0, NU_MAX), meaning="Poisson's ratio", prior=prior)


def modulus_parameter(start_MPa: float) -> Parameter:
    """Return Young's modulus with a start of the right size."""
    start = max(start_MPa, LEAST_MPA)
    return Parameter("youngs_modulus_MPa", "MPa", start, (1e-5, 10000), "Young's modulus of the gel", start)


def starting_modulus(data: Observations) -> float:
    """Return E in MPa from the median of P/w, as a start of fits."""
    deep = data.depth_mm > 0.5 * np.max(data.depth_mm)
    per_depth = float(np.median(data.normal_N[deep] / data.depth_mm[deep]))
    radius, thickness = float(np.median(data.radius_mm)), data.gel.thickness_mm
    unit = theory.punch_stiffness(1.0, NU_NOMINAL, radius_mm=np.array([radius]), thickness_mm=thickness)[0]
    return max(per_depth / float(unit) / 1.1, LEAST_MPA)
