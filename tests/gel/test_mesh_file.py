"""Mesh files give back the shape that was written, and what is wrong with one is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactilevision.errors import InputError
from tactilevision.gel.mesh_file import CORNER, EDGE, FACE, read_mesh
from tactilevision.gel.shapes import shape_mesh
from tactilevision.records.rig import Gel

meshio = pytest.importorskip("meshio")
AXIS = np.arange(-1.0, 1.5, 0.5)
MESH = shape_mesh(Gel(1.0, shape="dome", curvature_mm=(5.0, 5.0), size_mm=(3.0, 3.0)), AXIS, AXIS, spacing_mm=0.5)
TETS = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))  # of a hexahedron
KINDS = [("hexahedron27", 1e-9), ("hexahedron20", 3e-5), ("hexahedron", 2e-3), ("tetra", 2e-3)]


def sets(points: Any) -> dict[str, Any]:
    top = np.isin(np.arange(len(points)), MESH.seen)
    return {"seen": top.astype(float), "bonded": MESH.bonded.astype(float)}


def written(path: Path, kind: str, **changed: Any) -> Path:
    order = {"hexahedron": CORNER, "hexahedron20": (*CORNER, *EDGE), "hexahedron27": (*CORNER, *EDGE, *FACE)}
    points, data = MESH.nodes_mm * changed.get("times", 1.0), sets(MESH.nodes_mm)
    cells = MESH.elements[:, order[kind]] if kind in order else _tetrahedra()
    used = np.unique(cells)
    data = {name: one[used] for name, one in data.items() if name not in changed.get("without", ())}
    cells = np.searchsorted(used, cells)
    if changed.get("torn"):
        points, used = np.concatenate([points, points]), np.concatenate([used, used + len(points)])
        half = len(cells) // 2
        cells = np.concatenate([cells[:half], cells[half:] + len(used) // 2])
        data = {name: np.tile(one, 2) for name, one in data.items()}
    meshio.write_points_cells(path, points[used], [(kind, cells)], point_data=data)
    return path


def _tetrahedra() -> Any:
    corners = MESH.elements[:, list(CORNER)]
    split = np.stack([corners[:, list(one)] for one in TETS], axis=1)
    return split.reshape(-1, 4)


@pytest.mark.parametrize(("kind", "off"), KINDS)
def test_each_kind_of_element_gives_the_shape_back(tmp_path: Path, kind: str, off: float) -> None:
    mirrored = np.array([-1, 1, 1])  # numbered for axes of the other hand
    found = read_mesh(written(tmp_path / "gel.vtu", kind, times=mirrored), thickness_mm=1.0)
    assert found.volume_mm3 == pytest.approx(MESH.volume_mm3, rel=off)
    faces = 2 if kind == "tetra" else 1
    assert len(found.seen) == faces * len(MESH.seen)
    assert found.bonded.sum() >= (len(MESH.seen) * 4 if kind != "hexahedron20" else 1)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"without": ("bonded",)}, "no set 'bonded'"),
        ({"without": ("seen",)}, "no set 'seen'"),
        ({"times": 1e-3}, "looks like metres"),
        ({"times": 2.0}, "another size than the gel"),
        ({"times": np.array([1, 1, -1])}, "z runs out of the gel"),
        ({"torn": True}, "mesh is open"),
    ],
)
def test_what_is_wrong_with_a_mesh_is_named(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_mesh(written(tmp_path / "gel.vtu", "hexahedron27", **changed), thickness_mm=1.0)


def test_a_file_that_ends_meshio_or_is_not_there_is_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="no such mesh"):
        read_mesh(tmp_path / "gone.msh")
    (tmp_path / "gel.inp").write_text("*NODE\n")

    def ends(_: object) -> None:
        raise SystemExit(1)

    monkeypatch.setattr(meshio, "read", ends)
    with pytest.raises(InputError, match="cannot be read"):
        read_mesh(tmp_path / "gel.inp")
