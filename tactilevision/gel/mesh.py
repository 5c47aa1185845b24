"""A gel as a mesh, and the checks that it must pass."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import sparse

from tactilevision.errors import InputError
from tactilevision.gel.condense import Singles, condensed
from tactilevision.gel.elements import EDGES, HEX, Ints, stiffness, table_of, volumes
from tactilevision.records.constants import NU_MAX
from tactilevision.records.measured import Bools, Floats

HEX_FACES = tuple(
    np.moveaxis(np.arange(27).reshape(3, 3, 3), axis, 0)[end].ravel() for axis in range(3) for end in (0, 2)
)
TET_FACES = tuple(
    np.array([*corners, *(4 + EDGES.index(pair) for pair in ((a, b), (a, c), (b, c)))])
    for corners in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    for a, b, c in [corners]
)
CORNERS = {9: (0, 2, 6, 8), 6: (0, 1, 2)}  # of a face, among its nodes


@dataclass(frozen=True)
class GelMesh:
    """A gel as hexahedra of 27 nodes or tetrahedra of 10, in the numbering of gel/elements.py.

    `nodes_mm` (N, 3): x right and y down in the rectified picture from its centre, z into the gel.
    `elements` (E, n); `seen` (F, 9 or 6) the nodes of each face that is touched; `bonded` (N,) the fixed nodes.
    `stiffer` (E,) is the modulus of each element over that of the gel; `poisson_ratio` (E,), NaN where it is the
    gel's. `name` is of the file in errors.

    Raises InputError for elements that are inverted or for a mesh without a seen or a bonded surface.
    """

    nodes_mm: Floats = field(repr=False)
    elements: Ints = field(repr=False)
    seen: Ints = field(repr=False)
    bonded: Bools = field(repr=False)
    stiffer: Floats | None = field(default=None, repr=False)
    poisson_ratio: Floats | None = field(default=None, repr=False)
    name: str = "gel"

    def __post_init__(self) -> None:
        if not len(self.seen):
            raise InputError(
                "the mesh has no seen surface",
                where=self.name,
                remedy="Name the set of the surface that is touched.",
            )
        if not self.bonded.any():
            raise InputError(
                "the mesh has no bonded surface, so nothing holds the gel",
                where=self.name,
                remedy="Name the set of nodes or faces that are fixed to the sensor.",
            )
        low = np.concatenate([volumes(self.nodes_mm[part]).min(axis=1) for part in _chunks(self.elements)])
        if (low <= 0).any():
            worst = int(np.argmin(low))
            raise InputError(
                f"{np.count_nonzero(low <= 0)} of {len(low)} elements are inverted",
                where=self.name,
                value=f"element {worst} about {np.round(self.nodes_mm[self.elements[worst]].mean(axis=0), 3)} mm",
                remedy="Untangle the mesh, or number the nodes of its elements in the order of the format.",
            )

    @cached_property
    def key(self) -> str:
        """Return a hash of all that the stiffness depends on."""
        digest = hashlib.sha256()
        for one in (self.nodes_mm, self.elements, self.seen, self.bonded, self.stiffer, self.poisson_ratio):
            digest.update(b"none" if one is None else np.ascontiguousarray(one).tobytes())
        return digest.hexdigest()

    @property
    def seen_stiffness(self) -> float:
        """Return the modulus of the seen surface over that of the gel, a mean over its elements."""
        if self.stiffer is None:
            return 1.0
        touched = np.isin(self.elements, self.seen).sum(axis=1) >= self.seen.shape[1]
        return float(np.mean(self.stiffer[touched]))

    def compliance(self, loads: sparse.csr_array, *, poisson_ratio: float) -> Singles:
        """Return C (3, n, 3, n), mm/N at modulus 1 MPa, between `loads` (N, n), the nodal shares of unit loads."""
        modulus = np.ones(len(self.elements)) if self.stiffer is None else self.stiffer
        nu = np.full(len(self.elements), poisson_ratio)
        if self.poisson_ratio is not None:
            nu = np.where(np.isnan(self.poisson_ratio), poisson_ratio, np.minimum(self.poisson_ratio, NU_MAX))
        shear, lame = modulus / (2 * (1 + nu)), modulus * nu / ((1 + nu) * (1 - 2 * nu))

        def part(own: Ints) -> Floats:
            return stiffness(self.nodes_mm[self.elements[own]], shear[own], lame[own])

        return condensed(self.elements, self.nodes_mm, self.bonded, stiffness=part, loads=loads)

    @property
    def volume_mm3(self) -> float:
        """Return the volume of the gel."""
        weight = table_of(self.elements.shape[1]).weight
        return float(sum((volumes(self.nodes_mm[part]) @ weight).sum() for part in _chunks(self.elements)))

    def check_closed(self) -> None:
        """Raise InputError where parts touch without sharing nodes, or three elements share a face."""
        faces, counts = np.unique(np.sort(self._corners, axis=1), axis=0, return_counts=True)
        if (counts > 2).any():
            raise InputError(
                f"{np.count_nonzero(counts > 2)} faces belong to three elements or more",
                where=self.name,
                remedy="Merge duplicate elements.",
            )
        outer = np.sort(faces[counts == 1], axis=1)
        rounded = np.round(self.nodes_mm / self._tolerance_mm).astype(np.int64)
        _, same = np.unique(rounded, axis=0, return_inverse=True)
        same = same.ravel()
        _, alike = np.unique(np.sort(same[outer], axis=1), axis=0, return_counts=True)
        if (alike > 1).any():
            raise InputError(
                f"the mesh is open: {np.count_nonzero(alike > 1)} faces lie on each other without sharing nodes",
                where=self.name,
                remedy="Merge coincident nodes (gmsh: Coherence Mesh).",
            )
        loose = sparse.csgraph.connected_components(self._neighbours)[1]
        used = np.unique(self.elements)
        held = np.unique(loose[np.flatnonzero(self.bonded)])
        if not np.isin(np.unique(loose[used]), held).all():
            raise InputError(
                "the mesh is open: a part of it is not connected to the bonded surface",
                where=self.name,
                remedy="Merge coincident nodes, or remove the loose part.",
            )

    @property
    def _corners(self) -> Ints:
        every = HEX_FACES if self.elements.shape[1] == HEX else TET_FACES
        return np.concatenate([self.elements[:, one[list(CORNERS[len(one)])]] for one in every])

    @property
    def _tolerance_mm(self) -> float:
        return float(1e-6 * np.ptp(self.nodes_mm, axis=0).max())

    @property
    def _neighbours(self) -> sparse.csr_array:
        first = np.repeat(self.elements[:, 0], self.elements.shape[1])
        entries = (np.ones(self.elements.size, dtype=bool), (first, self.elements.ravel()))
        return sparse.csr_array(entries, shape=(len(self.nodes_mm),) * 2)


def _chunks(elements: Ints) -> list[Ints]:
    return np.array_split(elements, max(1, len(elements) // 1000))
