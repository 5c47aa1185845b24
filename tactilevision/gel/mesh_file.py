"""Reads a gel's mesh from gmsh .msh, Abaqus .inp or VTK files, by meshio (extra `mesh`).

Elements are tetrahedra (4 or 10 nodes) or hexahedra (8, 20 or 27); faces and lines in the file only name sets. A
set is a physical group of gmsh, a node or element set of Abaqus, or a point array of VTK that is not 0 on it. The
seen surface consists of the outer faces whose nodes all belong to its set.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from tactilevision.errors import InputError, library
from tactilevision.gel.elements import EDGES, HEX, TET, Ints, volumes
from tactilevision.gel.mesh import CORNERS, HEX_FACES, TET_FACES, GelMesh
from tactilevision.records.constants import MICRO
from tactilevision.records.measured import Bools, Floats

MM = {"mm": 1.0, "m": 1e3, "inch": 25.4}  # in each unit of a mesh
SMALLEST_MM = 1.0  # mm of a gel's largest side: a smaller mesh is in another unit
OTHER_THICKNESS = 0.25  # of the stated one: a mesh that differs by more is another gel, or in another unit
SOLIDS = {"tetra": 4, "tetra10": 10, "hexahedron": 8, "hexahedron20": 20, "hexahedron27": 27}
# places i + 3 j + 9 k of the nodes of VTK's hexahedra: corners, then middles of edges, faces, and the element
CORNER = (0, 2, 8, 6, 18, 20, 26, 24)
# middles of edges, in the same order
EDGE = (1, 5, 7, 3, 19, 23, 25, 21, 9, 11, 17, 15)
# middles of faces, and of the element
FACE = (12, 14, 10, 16, 4, 22, 13)
# numbering of an element's mirror image, its first axis or edge turned round
MIRRORED = {HEX: np.arange(27).reshape(9, 3)[:, ::-1].ravel(), TET: np.array([1, 0, 2, 3, 4, 7, 8, 5, 6, 9])}
SHARPEST = 0.5  # rad between normals at the ends of an edge of a smooth surface
VTK_TET10 = (0, 1, 2, 3, 4, 6, 7, 5, 8, 9)  # meshio's middles 01 12 02 03 13 23 as 01 02 03 12 13 23


def read_mesh(
    path: Path | str,
    *,
    unit: str = "mm",
    seen: str = "seen",
    bonded: str = "bonded",
    thickness_mm: float | None = None,
) -> GelMesh:
    """Read the mesh of a gel: axes of GelMesh, lengths in `unit`, the sets named `seen` and `bonded`.

    `thickness_mm` is that stated of the gel, which finds a wrong unit. Raises InputError for another file.
    """
    content = _content(Path(path))
    kinds = {block.type: block.data for block in content.cells if block.type in SOLIDS}
    if len({kind[:5] for kind in kinds}) != 1 or len(kinds) != 1:
        raise InputError(
            "a gel's mesh has elements of one kind, tetrahedra or hexahedra",
            where=path,
            value=sorted({block.type for block in content.cells}),
            remedy="Mesh the solid with one kind of element.",
        )
    (kind, _), blocks = next(iter(kinds.items())), [b.data for b in content.cells if b.type in kinds]
    nodes = MM[unit] * np.asarray(content.points, dtype=np.float64)[:, :3]
    sets = {name: _members(content, name, len(nodes)) for name in (seen, bonded)}
    elements, nodes, parents = _quadratic(np.concatenate(blocks).astype(np.intp), nodes, kind)
    # a middle node belongs to a set if all the file's nodes that it lies between do
    top, base = (_spread(sets[name], parents) for name in (seen, bonded))
    for name, found in ((seen, top), (bonded, base)):
        if not found.any():
            raise InputError(
                f"the mesh has no set {name!r}",
                where=path,
                value=", ".join(_names(content)) or "no sets at all",
                remedy="Name the sets of the seen and the bonded surface with seen and bonded of [sensor.gel].",
            )
    if volumes(nodes[elements[:1]]).max() < 0:  # numbered for axes of the other hand, as after mirroring
        elements = elements[:, MIRRORED[elements.shape[1]]]
    faces = _outer(elements, top)
    if SOLIDS[kind] in (4, 8) and len(faces):
        nodes = nodes + _to_smooth(nodes, faces) + _to_smooth(nodes, _outer(elements, base))
    mesh = GelMesh(nodes, elements, faces, base, name=str(path))
    mesh.check_closed()
    _check_size(mesh, thickness_mm, path, unit)
    return mesh


def file_key(path: Path | str) -> str:
    """Return a hash of a mesh file. Raises InputError where there is none."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as fault:
        raise InputError("there is no such mesh", where=path, remedy="Check mesh of [sensor.gel].") from fault


def _content(path: Path) -> Any:
    """Return meshio's mesh. It ends the program for some files, hence SystemExit."""
    file_key(path)
    meshio = library("meshio", extra="mesh", where="read_mesh")
    try:
        return meshio.read(path)
    except (Exception, SystemExit) as fault:
        raise InputError(
            "the mesh cannot be read",
            where=path,
            value=str(fault)[:80],
            remedy="Save it as gmsh .msh 4.1, Abaqus .inp or VTK; second-order .inp of gmsh as .msh.",
        ) from fault


def _names(content: Any) -> list[str]:
    every = {*content.field_data, *content.point_sets, *content.cell_sets, *content.point_data}
    return sorted(name for name in every if not name.startswith("gmsh:"))


def _members(content: Any, name: str, count: int) -> Bools:
    """Return which of the file's nodes (count,) belong to a set."""
    found = np.zeros(count, dtype=bool)
    if name in content.point_sets:
        found[np.asarray(content.point_sets[name], dtype=np.intp)] = True
    if name in content.point_data:
        found |= np.asarray(content.point_data[name]).reshape(count, -1).any(axis=1)
    for block, own in zip(content.cells, content.cell_sets.get(name, ()), strict=False):
        found[block.data[np.asarray(own, dtype=np.intp)].ravel()] = True
    if name in content.field_data:
        tag = int(content.field_data[name][0])
        dimension = int(content.field_data[name][1])
        for block, tags in zip(content.cells, content.cell_data.get("gmsh:physical", ()), strict=False):
            if block.dim == dimension:
                found[block.data[np.asarray(tags) == tag].ravel()] = True
    return found


def _quadratic(given: Ints, nodes: Floats, kind: str) -> tuple[Ints, Floats, Ints]:
    """Return elements of 10 or 27 nodes, the nodes, and (N, 8) the file's nodes between which each lies, or -1."""
    if kind.startswith("tetra"):
        if SOLIDS[kind] == 10:
            elements = given[:, VTK_TET10]
            return elements, nodes, np.where(np.arange(8) == 0, np.arange(len(nodes))[:, None], -1)
        return _with_middles(given, nodes, [given[:, list(pair)] for pair in EDGES])
    corners = given[:, :8]
    if SOLIDS[kind] == HEX:
        elements = np.empty_like(given)
        elements[:, [*CORNER, *EDGE, *FACE]] = given
        return elements, nodes, np.where(np.arange(8) == 0, np.arange(len(nodes))[:, None], -1)
    grid = {place: k for k, place in enumerate(CORNER)}
    edges = _between(corners, grid, EDGE)
    faces = _between(corners, grid, FACE)
    if SOLIDS[kind] == 8:
        elements, nodes, parents = _with_middles(corners, nodes, [*edges, *faces])
    else:
        elements, nodes, parents = _with_middles(given, nodes, faces, serendipity=True)
    turned = np.empty_like(elements)
    turned[:, [*CORNER, *EDGE, *FACE]] = elements
    return turned, nodes, parents


def _between(corners: Ints, grid: dict[int, int], places: tuple[int, ...]) -> list[Ints]:
    """Return the corners (E, 2, 4 or 8) between which each place of a hexahedron lies."""
    found = []
    for place in places:
        own = np.array([place % 3, place // 3 % 3, place // 9])
        near = [c for c in grid if all(o in (1, c // 3**k % 3) for k, o in enumerate(own.tolist()))]
        found.append(corners[:, [grid[c] for c in near]])
    return found


def _with_middles(
    given: Ints, nodes: Floats, groups: list[Ints], *, serendipity: bool = False
) -> tuple[Ints, Floats, Ints]:
    """Return elements with a node in the middle of each group of corners (E, 2, 4 or 8), shared by neighbours."""
    padded = [((0, 0), (0, 8 - one.shape[1])) for one in groups]
    keys = np.concatenate(
        [np.pad(np.sort(one, axis=1), pad, constant_values=-1) for one, pad in zip(groups, padded, strict=True)]
    )
    keys, place = np.unique(keys, axis=0, return_inverse=True)
    there = keys >= 0
    middles = (nodes[np.maximum(keys, 0)] * there[..., None]).sum(axis=1) / there.sum(axis=1)[:, None]
    if serendipity:
        _set_curved(middles, given, nodes, place.reshape(len(groups), -1))
    own = np.where(np.arange(8) == 0, np.arange(len(nodes))[:, None], -1)
    elements = np.concatenate([given, len(nodes) + place.reshape(len(groups), -1).T], axis=1)
    return elements, np.concatenate([nodes, middles]), np.concatenate([own, keys])


def _set_curved(middles: Floats, given: Ints, nodes: Floats, place: Ints) -> None:
    """Set middles (n, 3) of faces and elements of 20 nodes: where their own shape functions have them, mm."""
    grid = {where: k for k, where in enumerate((*CORNER, *EDGE))}
    for k, where in enumerate(FACE):
        own = np.array([where % 3, where // 3 % 3, where // 9])
        inside = [g for g in grid if all(o in (1, g // 3**a % 3) for a, o in enumerate(own.tolist()))]
        ends = [g for g in inside if g in CORNER]
        sides = [g for g in inside if g in EDGE]
        corner = nodes[given[:, [grid[g] for g in ends]]].sum(axis=1)
        edge = nodes[given[:, [grid[g] for g in sides]]].sum(axis=1)
        middles[place[k]] = edge / 2 - corner / 4 if len(ends) == 4 else edge / 4 - corner / 4


def _spread(members: Bools, parents: Ints) -> Bools:
    return np.asarray((members[np.maximum(parents, 0)] | (parents < 0)).all(axis=1))


def _outer(elements: Ints, members: Bools) -> Ints:
    """Return the outer faces (F, 9 or 6) whose nodes are all members."""
    every = HEX_FACES if elements.shape[1] == HEX else TET_FACES
    faces = np.concatenate([elements[:, one] for one in every])
    corners = np.sort(faces[:, list(CORNERS[faces.shape[1]])], axis=1)
    _, first, counts = np.unique(corners, axis=0, return_index=True, return_counts=True)
    outer = faces[first[counts == 1]]
    return np.asarray(outer[members[outer].all(axis=1)])


def _to_smooth(nodes: Floats, faces: Ints) -> Floats:
    """Return the way (N, 3), mm, of the middles of straight edges to a smooth surface through their corners.

    With unit normals n of the corners, means over the faces that meet there, and d along the edge, the middle
    moves by n d.(n2 - n1)/8, the sagitta of an arc. An edge that turns by more than SHARPEST is one of the solid.
    """
    moved, corners = np.zeros_like(nodes), list(CORNERS[faces.shape[1]])
    if not len(faces):
        return moved
    a, b, c = nodes[faces[:, corners[:3]]].swapaxes(0, 1)
    across = np.cross(b - a, c - a)
    normal = np.zeros_like(nodes)
    np.add.at(normal, faces[:, corners], (across * np.sign(across[:, 2:]))[:, None])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), MICRO)
    edges = (
        ((3, 0, 1), (4, 0, 2), (5, 1, 2)) if len(corners) == 3 else ((1, 0, 2), (3, 0, 6), (5, 2, 8), (7, 6, 8))
    )
    for middle, *ends in edges:
        first, last = faces[:, ends].T
        turn = normal[last] - normal[first]
        lift = ((nodes[last] - nodes[first]) * turn).sum(axis=1) / 8 * (np.linalg.norm(turn, axis=1) < SHARPEST)
        moved[faces[:, middle]] = (normal[first] + normal[last]) / 2 * lift[:, None]
    if len(corners) == 4:
        moved[faces[:, 4]] = moved[faces[:, 1::2]].sum(axis=1) / 2
    return moved


def _check_size(mesh: GelMesh, thickness_mm: float | None, path: Path | str, unit: str) -> None:
    from scipy.spatial import cKDTree

    low, high = mesh.nodes_mm.min(axis=0), mesh.nodes_mm.max(axis=0)
    places = mesh.nodes_mm[np.unique(mesh.seen)]
    middle = places[np.argmin(np.hypot(places[:, 0], places[:, 1]))]
    found = float(cKDTree(mesh.nodes_mm[mesh.bonded]).query(middle)[0])
    small = float((high - low).max()) < SMALLEST_MM
    if small or (thickness_mm is not None and abs(found / thickness_mm - 1) > OTHER_THICKNESS):
        guess = ": it looks like metres" if unit == "mm" and small else ""
        raise InputError(
            f"the mesh has another size than the gel{guess}",
            where=path,
            value=f"{found:.4g} mm thick at the picture's centre, stated {thickness_mm} mm; in {unit}",
            remedy='State mesh_unit ("mm", "m" or "inch") of [sensor.gel].',
        )
    if mesh.nodes_mm[np.unique(mesh.seen), 2].mean() > mesh.nodes_mm[mesh.bonded, 2].mean():
        raise InputError(
            "the mesh's z runs out of the gel: its seen surface lies behind the bonded one",
            where=path,
            remedy="Mirror it: z into the gel, x right and y down in the picture.",
        )
