"""Force against planted truth: resultants, tractions, coverage, edges, large depth, a wrong material, and speed.

python -m benchmarks.force [cases]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import numpy as np

from benchmarks.force_cases import KINDS, Forward, View, draw_case, seen
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.force.nodes import cell_means
from tactilevision.records.measured import Floats, Material
from tactilevision.records.rig import Gel

VIEWS = {"160 x 120": View((120, 160), 0.171, 4), "320 x 240": View((240, 320), 0.0855, 2)}
GEL, MATERIAL = Gel(3.0), Material(0.2, 0.48)
REPEATS = 7
LINEAR = ForceSettings(large_depth=False)  # the planted truth of the random cases is linear elasticity


def random_cases(view: View, *, std_mm: float, cases: int, seed: int, material: Material = MATERIAL) -> Floats:
    """Rows: error of fx, fy, fz over the resultant's size; relative L2 of normal and shear; z-score of fz;
    kind.
    """
    rng, forward = np.random.default_rng(seed), Forward(view, GEL, MATERIAL)
    field = ForceField(GEL, material, (view.mm_per_px,) * 2, view_px=view.shape, settings=LINEAR)
    rows = []
    for number in range(cases):
        traction = draw_case(KINDS[number % len(KINDS)], view, rng)
        found = field(*seen(forward(traction), view, std_mm=std_mm, rng=rng))
        true = traction.sum(axis=(1, 2)) * (view.mm_per_px / view.fine) ** 2
        error = np.asarray(found.resultant_N) - true
        truth = [_on_cells(field, view, t) for t in traction]
        normal = _relative(found.t_z[None], np.array(truth[2:]))
        shear = _relative(np.stack([found.t_x, found.t_y]), np.array(truth[:2]))
        scores = error / np.asarray(found.resultant_std_N)
        rows.append([*error / np.linalg.norm(true), normal, shear, *scores, number % len(KINDS)])
    return np.array(rows)


def frame_times(view: View, *, cases: int = 40, seed: int = 3, cell_std: bool = True) -> Floats:
    """Milliseconds of processor time of each frame, the fastest of some repeats: a busy machine only adds."""
    rng, forward = np.random.default_rng(seed), Forward(view, GEL, MATERIAL)
    field = ForceField(
        GEL,
        MATERIAL,
        (view.mm_per_px,) * 2,
        view_px=view.shape,
        settings=ForceSettings(cell_std=cell_std),
    )
    spent = []
    for number in range(cases):
        maps = seen(forward(draw_case(KINDS[number % len(KINDS)], view, rng)), view, std_mm=0.005, rng=rng)
        field(*maps)
        tries = []
        for _ in range(REPEATS):
            start = time.process_time()
            field(*maps)
            tries.append(1e3 * (time.process_time() - start))
        spent.append(min(tries))
    return np.array(spent)


def _on_cells(field: ForceField, view: View, fine: Floats) -> Floats:
    n = view.fine
    pixels = fine.reshape(view.shape[0], n, view.shape[1], n).mean(axis=(1, 3))
    assert field.compliance is not None
    return cell_means(field.compliance.grid, pixels, valid=None)[0]


def _relative(found: Floats, true: Floats) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def report_random(name: str, rows: Floats) -> None:
    """One block of the printed table."""
    off = 100 * np.abs(rows[:, :3])
    median, most = np.median(off, 0).round(2), np.percentile(off, 95, 0).round(2)
    within = (np.abs(rows[:, 5:8]) < 2).mean(0).round(2)
    print(f"{name}: resultant off by {median} % (median), {most} % (95th)")
    print(f"    relative L2 (median): normal {np.median(rows[:, 3]):.3f}, shear {np.median(rows[:, 4]):.3f}")
    print(f"    within 2 std: {within}")
    for number, kind in enumerate(KINDS):
        part = rows[rows[:, 8] == number]
        normal, shear = np.median(part[:, 3]), np.median(part[:, 4])
        print(f"    {kind:13s} fz {np.median(100 * part[:, 2]):+.2f} %   L2 {normal:.3f} {shear:.3f}")


def main(arguments: Sequence[str]) -> None:
    """Print everything."""
    cases = int(arguments[0]) if arguments else 200
    for name, view in VIEWS.items():
        for std_um in (5, 20):
            rows = random_cases(view, std_mm=1e-3 * std_um, cases=cases, seed=11)
            report_random(f"{name}, {std_um} um, {cases} cases", rows)
        for each in (True, False):
            spent = frame_times(view, cell_std=each)
            middle, most = np.percentile(spent, [50, 95])
            print(f"{name}: {middle:.1f} ms a frame (95th {most:.1f}), every cell's std: {each}")


def quick() -> None:
    view = VIEWS["160 x 120"]
    report_random("4 cases", random_cases(view, std_mm=0.005, cases=4, seed=11))
    print(f"{np.median(frame_times(view, cell_std=False)):.1f} ms a frame")


if __name__ == "__main__":
    main(sys.argv[1:])
