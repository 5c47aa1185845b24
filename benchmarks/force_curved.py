"""Force on a dome and a wedge against NGSolve: its own mesh, elements of third order, fine about the contact.

python -m benchmarks.force_curved [cases]. Also a flat mesh against the flat path, set-up, memory, and frames.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from benchmarks.force_cases import KINDS, Forward, View, draw_case, noise, seen
from benchmarks.force_sides import elastic
from tactilevision.force.compliance import compliance_for
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.force.mesh_compliance import MeshCompliance, compliance_of
from tactilevision.force.nodes import lay_grid
from tactilevision.gel.mesh_file import read_mesh
from tactilevision.gel.shapes import shape_mesh
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

VIEW, PAD, MATERIAL = View((150, 150), 0.117, 1), 12, Material(0.2, 0.48)  # PAD px: what moves into the view
WIDE = View((174, 174), 0.117, 1)
SCALE = (VIEW.mm_per_px, VIEW.mm_per_px)
LINEAR = ForceSettings(large_depth=False)
ROUND, RIM = 12.0, 0.85  # mm of the dome's sphere; sine of its steepest place
DOME = Gel(3.0, shape="dome", curvature_mm=(ROUND, ROUND), radius_mm=ROUND * RIM)
WEDGE = Gel(3.5, shape="wedge", thickness_ends_mm=(2.0, 5.0), size_mm=(24.0, 22.0))
STEEPEST_DEG = 35.0
POINTS = 16  # along either side of a cell, of the planted traction's mean
TETS_MM = 1.0  # of a mesh file's tetrahedra
FINE_MM = 0.3  # elements of the truth about the contact; of .2 mm moves the mean displacement by .02 %


@dataclass(frozen=True)
class Contact:
    """A sheared patch: middle (3,), axes (3, 3) with the normal last, radius, force (3,) along them, its kind."""

    place: Floats
    axes: Floats
    radius: float
    force: Floats
    punch: bool

    @property
    def resultant(self) -> Floats:
        return np.asarray(self.force @ self.axes)


def draw(gel: Gel, rng: np.random.Generator) -> Contact:
    """Draw a contact anywhere on the gel, sheared by up to half its normal force."""
    normal, place = np.array([0.0, 0.0, 1.0]), np.array([rng.uniform(-6, 6), rng.uniform(-6, 6), 0.0])
    if gel.shape == "dome":
        polar, turn = np.radians(rng.uniform(0, STEEPEST_DEG)), rng.uniform(0, 2 * np.pi)
        out = np.array([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), -np.cos(polar)])
        normal, place = -out, np.array([0.0, 0.0, ROUND]) + ROUND * out
    along = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    along /= np.linalg.norm(along)
    radius, turn, share = rng.uniform(1.2, 2.0), rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.5)
    size = rng.uniform(0.06, 0.18) * radius**2
    force = size * np.array([share * np.cos(turn), share * np.sin(turn), 1.0])
    return Contact(place, np.stack([along, np.cross(normal, along), normal]), radius, force, bool(rng.integers(2)))


def untouched(gel: Gel, x: Floats, y: Floats) -> Floats:
    """Return z0 of the surface; NaN beside the gel."""
    if gel.shape != "dome":
        return np.zeros_like(x)
    square = x**2 + y**2
    return np.where(square < (ROUND * RIM - 0.02) ** 2, _sphere(square), np.nan)


def _sphere(square: Floats) -> Floats:
    return np.asarray(ROUND - np.sqrt(np.maximum(ROUND**2 - square, 1.0)))


def shape_at(one: Contact, places: Sequence[Any], root: Any, larger: Any) -> Any:
    """Return the pressure's form at places, by the square root and the positive part of either library."""
    off = [p - m for p, m in zip(places, one.place, strict=True)]
    tangent = [sum(o * a for o, a in zip(off, axis, strict=True)) for axis in one.axes[:2]]
    inside = 1 - (tangent[0] * tangent[0] + tangent[1] * tangent[1]) / one.radius**2
    return larger(inside, 1 / root(larger(inside - 0.02, 0) + 0.02) if one.punch else root(larger(inside, 0)))


def solved(gel: Gel, one: Contact, x: Floats, y: Floats) -> tuple[Floats, float]:
    """Return NGSolve's displacement (3, ...) of the surface at x, y, and the pressure over its form."""
    import ngsolve as ng

    mesh = ng.Mesh(_geometry(gel, one).GenerateMesh(maxh=1.8))
    mesh.Curve(3)
    space, form = elastic(mesh, MATERIAL)
    v = space.TestFunction()

    pressure = shape_at(one, (ng.x, ng.y, ng.z), ng.sqrt, lambda a, b: ng.IfPos(a, a if np.isscalar(b) else b, 0))
    load = ng.LinearForm(space)
    for axis, force in enumerate(one.resultant):
        load += force * pressure * v[axis] * ng.ds("pressed", bonus_intorder=8)
    load.Assemble()
    answer, push = ng.GridFunction(space), ng.GridFunction(space)
    push.Set(ng.CoefficientFunction(tuple(one.resultant)))
    # the load's own sum: quadrature of the form has another order
    whole = ng.InnerProduct(load.vec, push.vec) / float(one.resultant @ one.resultant)
    answer.vec.data = form.mat.Inverse(space.FreeDofs(), "sparsecholesky") * load.vec
    answer.vec.data /= whole
    z = untouched(gel, x, y)
    known = np.isfinite(z)
    moved = np.full((3, *x.shape), np.nan)
    below = np.zeros(known.sum()) + 1e-5
    moved[:, known] = np.asarray(answer(mesh(x[known], y[known], z[known] + below))).T
    return moved, 1 / whole


def _geometry(gel: Gel, one: Contact) -> Any:
    """NGSolve's solid, fine about the contact, with the pressed face cut out of its own."""
    from netgen.occ import Cylinder, Dir, Glue, OCCGeometry, Pnt, Sphere

    whole, normal = _solid(gel), one.axes[2]
    ball = Sphere(Pnt(*one.place), one.radius + 0.8)
    rod = Cylinder(Pnt(*(one.place - normal)), Dir(*normal), r=one.radius, h=1.6)
    near, pressed = whole * ball - rod, whole * rod
    pressed.faces["top"].name = "pressed"
    pressed.faces["pressed"].maxh = near.faces["top"].maxh = FINE_MM
    return OCCGeometry(Glue([pressed, near, whole - ball - rod]))


def _solid(gel: Gel) -> Any:
    """NGSolve's solid, its faces named; z runs into it."""
    from netgen.occ import ArcOfCircle, Axis, Face, Pnt, Segment, Vec, Wire, Z

    if gel.shape == "dome":
        steep = np.arcsin(RIM)

        def at(radius: float, angle: float) -> Any:
            return Pnt(radius * np.sin(angle), 0, ROUND - radius * np.cos(angle))

        top, base = ROUND, ROUND - 3
        outline = [
            ArcOfCircle(at(top, 0), at(top, steep / 2), at(top, steep)),
            Segment(at(top, steep), at(base, steep)),
            ArcOfCircle(at(base, steep), at(base, steep / 2), at(base, 0)),
            Segment(at(base, 0), at(top, 0)),
        ]
        whole = Face(Wire(outline)).Revolve(Axis((0, 0, 0), Z), 360)
        areas = {2 * np.pi * r**2 * (1 - np.cos(steep)): name for r, name in ((ROUND, "top"), (ROUND - 3, "base"))}
    else:
        corners = [Pnt(*p) for p in ((-12, -11, 0), (12, -11, 0), (12, -11, 5), (-12, -11, 2))]
        edges = [Segment(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
        whole = Face(Wire(edges)).Extrude(Vec(0, 22, 0))
        areas = {24 * 22: "top", float(np.hypot(24, 3) * 22): "base"}
    for face in whole.faces:
        face.name = next((name for area, name in areas.items() if abs(face.mass - area) < 1e-3), "side")
    return whole


def tetrahedra(gel: Gel) -> MeshCompliance:
    """Return the compliance of a mesh file of straight tetrahedra of TETS_MM, as netgen writes them."""
    import meshio
    from netgen.occ import OCCGeometry

    made, sets = OCCGeometry(_solid(gel)).GenerateMesh(maxh=TETS_MM), {}
    points = np.array([one.p for one in made.Points()])
    cells = np.array([[vertex.nr - 1 for vertex in one.vertices] for one in made.Elements3D()])
    for name, face in (("seen", "top"), ("bonded", "base")):
        own = [one for one in made.Elements2D() if made.GetBCName(one.index - 1) == face]
        sets[name] = np.isin(np.arange(len(points)), [v.nr - 1 for one in own for v in one.vertices]).astype(float)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gel.vtu"
        meshio.write_points_cells(path, points, [("tetra", cells)], point_data=sets)
        mesh = read_mesh(path, thickness_mm=gel.thickness_mm)
    grid = lay_grid(VIEW.shape, SCALE, spacing_mm=0.5)
    return compliance_of(mesh, gel, grid, poisson_ratio=MATERIAL.poisson_ratio)


def measured(gel: Gel, u: Floats, *, std_mm: float, rng: np.random.Generator) -> tuple[HeightMap, ShearMap]:
    """What is measured of a displacement (3, H, W) over WIDE: the surface's motion along the camera's ray, and the
    marks' motion, with noise.
    """
    x, y = WIDE.mesh()
    z = untouched(gel, x, y)
    known, whole = np.isfinite(z), _sphere(x**2 + y**2) if gel.shape == "dome" else z
    u = np.nan_to_num(u)
    rows, columns = np.indices(z.shape).astype(float)
    from_y, from_x = rows, columns
    for _ in range(12):
        go = [map_coordinates(one, (from_y, from_x), order=1, mode="nearest") / SCALE[0] for one in u[:2]]
        from_x, from_y = columns - go[0], rows - go[1]
    inner, off = (..., slice(PAD, -PAD), slice(PAD, -PAD)), noise(VIEW, std_mm=std_mm, rng=rng)
    depth = (map_coordinates(whole + u[2], (from_y, from_x), order=3, mode="nearest") - whole)[inner] + off[2]
    height = HeightMap(np.where(known[inner], depth, 0.0), known[inner], SCALE, std_mm=np.full(VIEW.shape, std_mm))
    shear = u[:2][inner] + off[:2]
    return height, ShearMap(shear[0], shear[1], known[inner], SCALE, std_mm=std_mm)


def against_ngsolve(gel: Gel, cases: int, *, seed: int, others: Sequence[MeshCompliance] = ()) -> Floats:
    """Rows (cases, meshes, 4): error of the resultant over its size and L2 of the normal traction, at 0 and 5 um,
    by our mesh and by `others`.
    """
    rng, rows = np.random.default_rng(seed), []
    x, y = WIDE.mesh()
    own = ForceField(gel, MATERIAL, SCALE, view_px=VIEW.shape, settings=LINEAR)
    fields = [own, *(ForceField(gel, MATERIAL, SCALE, settings=LINEAR, compliance=one) for one in others)]
    for _ in range(cases):
        one = draw(gel, rng)
        u, unit = solved(gel, one, x, y)
        truth, size = _normal(gel, own, one, unit), np.linalg.norm(one.resultant)
        row = np.zeros((len(fields), 4))
        for k, std_mm in enumerate((0.0, 0.005)):
            maps = measured(gel, u, std_mm=std_mm, rng=rng)
            for to, field in zip(row, fields, strict=True):
                found = field(*maps)
                to[2 * k] = np.linalg.norm(np.asarray(found.resultant_N) - one.resultant) / size
                to[2 * k + 1] = np.linalg.norm(found.pressure - truth) / np.linalg.norm(truth)
        rows.append(row)
        kind = f"{'punch' if one.punch else 'ball'} of {one.radius:.1f} mm at {np.round(one.place, 1)}"
        deep = float(np.nanmax(np.linalg.norm(u, axis=0)))
        off = "; ".join(f"off {100 * a:.2f}, {100 * c:.2f} %, L2 {b:.3f}, {d:.3f}" for a, b, c, d in row)
        print(f"    {kind}, moved {deep:.2f} mm: {off}", flush=True)
    return np.array(rows)


def _normal(gel: Gel, field: ForceField, one: Contact, unit: float) -> Floats:
    """Return the planted normal traction, a mean over each cell from POINTS x POINTS places in it."""
    assert isinstance(field.compliance, MeshCompliance)
    grid, offset = field.compliance.grid, (np.arange(POINTS) + 0.5) / POINTS - 0.5
    x, y = np.meshgrid(*((axis[:, None] + grid.spacing_mm * offset).ravel() for axis in (grid.x_mm, grid.y_mm)))
    places = x, y, np.nan_to_num(untouched(gel, x, y))
    form = shape_at(one, places, np.sqrt, lambda a, b: np.where(a > 0, a if np.isscalar(b) else b, 0))
    means = form.reshape(grid.shape[0], POINTS, grid.shape[1], POINTS).mean(axis=(1, 3))
    along = np.einsum("i,inm->nm", one.resultant, field.compliance.surface.frames[:, 2].T.reshape(3, *means.shape))
    return np.asarray(unit * means * along)


def flat_against_flat(cases: int) -> Floats:
    """Return the resultants' difference (cases,) by a flat mesh from those by the flat path, over their size."""
    view, gel = View((120, 120), 0.1, 2), Gel(3.0, shape="rectangle", size_mm=(18.0, 16.0))
    scale, rng, forward = (0.1, 0.1), np.random.default_rng(5), Forward(view, gel, MATERIAL)
    grid = lay_grid(view.shape, scale, spacing_mm=0.5)
    mesh = shape_mesh(gel, grid.x_mm, grid.y_mm, spacing_mm=0.5)
    solid = compliance_of(mesh, gel, grid, poisson_ratio=MATERIAL.poisson_ratio)
    layer = compliance_for(gel, grid, poisson_ratio=MATERIAL.poisson_ratio)
    fields = [ForceField(gel, MATERIAL, scale, settings=LINEAR, compliance=one) for one in (solid, layer)]
    off = []
    for number in range(cases):
        maps = seen(forward(draw_case(KINDS[number % 4], view, rng)), view, std_mm=0.0, rng=rng)
        a, b = (np.asarray(field(*maps).resultant_N) for field in fields)
        off.append(np.linalg.norm(a - b) / np.linalg.norm(b))
    return np.array(off)


def speed() -> None:
    """Print set-up, load from the cache, memory, and time of frames of up to 80 cells."""
    grid = lay_grid(VIEW.shape, SCALE, spacing_mm=0.5)
    mesh = shape_mesh(DOME, grid.x_mm, grid.y_mm, spacing_mm=0.5)
    nodes, kept = len(np.unique(mesh.seen)), os.environ.get("TACTILEVISION_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TACTILEVISION_CACHE"] = folder
        for name in ("set up", "from the cache"):
            began, clock = time.process_time(), time.perf_counter()
            made = compliance_for(DOME, grid, poisson_ratio=MATERIAL.poisson_ratio)
            print(f"{name}: {time.process_time() - began:.2f} s of one core, {time.perf_counter() - clock:.2f} s")
    os.environ.pop("TACTILEVISION_CACHE") if kept is None else os.environ.update(TACTILEVISION_CACHE=kept)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    unknowns = 3 * np.count_nonzero(~mesh.bonded)
    print(f"{nodes} surface nodes, {unknowns} unknowns, {made.inside.size} cells, {peak:.2f} GB at most")
    field, spent = ForceField(DOME, MATERIAL, SCALE, compliance=made), []
    x, y = WIDE.mesh()
    for depth, bend in ((0.2, 6.0), (0.3, 8.0), (0.25, 9.0)):
        u = np.stack([0 * x, 0 * x, np.clip(depth - (x**2 + y**2) / (2 * bend), 0, None)])
        maps = measured(DOME, u, std_mm=0.005, rng=np.random.default_rng(0))
        for _ in range(9):
            began = time.process_time()
            found = field(*maps)
            spent.append(1e3 * (time.process_time() - began))
        assert found.patch_map is not None
        print(f"{np.count_nonzero(found.patch_map)} cells: {np.median(spent[-9:]):.1f} ms a frame")


def main(arguments: Sequence[str]) -> None:
    """Print everything."""
    cases = int(arguments[0]) if arguments else 20
    speed()
    off = 100 * flat_against_flat(12)
    print(
        f"a flat mesh and the flat path: resultants differ by {np.median(off):.2f} % (median), {off.max():.2f} %"
    )
    if find_spec("ngsolve") is None:
        print("NGSolve is not installed: nothing to compare curved gels with")
        return
    for name, gel in (("dome, 0 to 35 degrees", DOME), ("wedge, 2 to 5 mm", WEDGE)):
        found = against_ngsolve(gel, cases, seed=2027, others=[tetrahedra(gel)])
        for (mesh, rows), (um, k) in product(
            zip(("hexahedra", "tetrahedra of 1 mm"), found.swapaxes(0, 1), strict=True), ((0, 0), (5, 2))
        ):
            middle, most = 100 * np.percentile(rows[:, k], [50, 95])
            print(
                f"{name}, {mesh}, {um} um: resultant off by {middle:.2f} % (median), {most:.2f} % (95th), ", end=""
            )
            print(f"L2 of normal traction {np.median(rows[:, k + 1]):.3f}")


def quick() -> None:
    print(f"a flat mesh and the flat path: {100 * flat_against_flat(2).max():.2f} %")


if __name__ == "__main__":
    main(sys.argv[1:])
