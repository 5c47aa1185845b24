"""How many std part what is hidden from what a straight law, beside other effects or not, does instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.others_curves import hidden, noise, protocol
from benchmarks.others_curves.law import Array, slope_N_per_mm

NU_STD = 0.005  # of Poisson's ratio, as it is stated
SEEN = 8.0  # std above which a hidden effect is to be found; of two, each beside the other
TOLD_APART = 3.0  # std: effects that are nearer are to be told as a set
MEMORIES_S = (0.5, 2.0, 8.0)  # that a relaxation may have
ONE_WAY = (
    "backing_compliance",
    "edge_fillet",
    "lateral_boundary",
    "adhesion",
    "viscoelasticity",
    "recovery",
    "mullins",
)

Truth = list[tuple[Array, Array, Array]]  # of each press force and slope of the sound gel, and what is hidden


class StraightLaw:
    """One modulus, one slope of P/w over w a radius, nu as well known as it is stated, under the true noise.

    `nu_std` of either sign: the side of nu on which the force's derivative by it is taken.
    """

    def __init__(
        self, plan: protocol.Protocol, reader: noise.Reader, nu: float, truth: Truth, *, nu_std: float = NU_STD
    ) -> None:
        radii = sorted({press.radius_mm for press in plan.presses})
        columns, self._roots = list[Array](), list[Array]()
        for press, (force, slope, error) in zip(plan.presses, truth, strict=True):
            own = np.diag(reader.force_N**2 + (slope * reader.depth_mm) ** 2)
            own = own + reader.gain**2 * np.outer(force, force) + reader.zero_mm**2 * np.outer(slope, slope)
            self._roots.append(np.asarray(np.linalg.cholesky(own)))
            which = np.eye(len(radii))[radii.index(press.radius_mm)]
            k, moved = (slope_N_per_mm(1.0, n, press.radius_mm, plan.thickness_mm) for n in (nu, nu + nu_std))
            parts = [force, *(np.outer(force * press.depth_mm, which)).T, (moved / k - 1) * force, error]
            columns.append(np.column_stack(parts))
        self._plain = np.vstack(columns)
        self._ends = np.cumsum([force.size for force, _, _ in truth])[:-1]

    def leaves(self, *beside: Array) -> tuple[float, Array]:
        """Std, and N (N,), that are left of what is hidden beside any share of others (N,)."""
        read, table = self._tables(*beside)
        best = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=1e-9)[0]
        return float(np.linalg.norm(table[:, -1] - table[:, :-1] @ best)), read[:, -1] - read[:, :-1] @ best

    @property
    def off_E(self) -> float:
        """Share by which what is hidden moves E of the best straight law."""
        table = self._tables()[1]
        return float(np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=1e-9)[0][0])

    def apart(self, other: Array, *, least: float, most: float) -> float:
        """Std that are left of what is hidden beside the best share of another (N,) from `least` to `most`."""
        _, table = self._tables(other)
        share = float(np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=1e-9)[0][0])
        target, law = table[:, -1] - np.clip(share, least, most) * table[:, 0], table[:, 1:-1]
        return float(np.linalg.norm(target - law @ np.linalg.lstsq(law, target, rcond=1e-9)[0]))

    def _tables(self, *beside: Array) -> tuple[Array, Array]:
        """Others, law and what is hidden as columns, in N and white (with what is known of nu as a last row)."""
        read = np.column_stack([*beside, self._plain])
        parts = zip(self._roots, np.split(read, self._ends), strict=True)
        prior = np.zeros(read.shape[1])
        prior[-2] = 1.0
        return read, np.vstack([*(np.linalg.solve(root, own) for root, own in parts), prior])


def without(gel: hidden.Gel, key: str) -> Iterator[hidden.Gel]:
    """The gel with what else is hidden, if anything is."""
    if others := {k: v for k, v in gel.sizes.items() if k != key}:
        yield replace(gel, sizes=others)


def near(law: StraightLaw, gel: hidden.Gel, errors_N: Callable[[hidden.Gel], Array]) -> list[str]:
    """What else, no larger than it is ever drawn, looks like what is hidden; `errors_N` (N,) of another gel."""
    return [
        key for key, (_, largest) in hidden.SINGLE.items() if key not in gel.sizes
        and any(
            law.apart(errors_N(other), least=-share * (key not in ONE_WAY), most=share) < TOLD_APART
            for other in _instead(gel, key)
            for share in [largest / other.sizes[key]]
        )
    ]  # fmt: skip


def _instead(gel: hidden.Gel, key: str) -> Iterator[hidden.Gel]:
    """Gels with another effect in place of what is hidden, of small and large size and of any memory."""
    for tau_s in MEMORIES_S if key == "viscoelasticity" else (gel.tau_s,):
        for size in hidden.SINGLE[key]:
            yield replace(gel, sizes={key: size}, tau_s=tau_s)
