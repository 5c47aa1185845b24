"""Solve the cases of the finite-element table and store them in a work folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactilevision.files.runs import output_lock
from tactilevision.mechanics.punch_fem.contact import RoundedPunch
from tactilevision.mechanics.punch_fem.laws import Hencky, Law, NeoHooke, least_acoustic
from tactilevision.mechanics.punch_fem.newton import State, reached
from tactilevision.mechanics.punch_fem.press import surface_profile
from tactilevision.mechanics.punch_fem.problem import Model, PunchProblem, build, default_mesh
from tactilevision.mechanics.punch_fem.solid import deform
from tactilevision.mechanics.tables.cases import BESIDE, DEPTHS, Case, SolvedCase, case_path, save_case
from tactilevision.records.constants import ROUNDING
from tactilevision.records.measured import Floats, Material

# Where the gel leaves a sharp edge one corner of the mesh turns inside out at w/h of .08 to .25. A neo-Hookean
# gel's force continues smoothly; Hencky's law has lost its ellipticity there. Beyond the fold a depth is kept
# while the growth of the force from the last depth without a fold agrees, within SAME_GROWTH, with that of a mesh
# twice as coarse at the edge or, where that one ends early and the law is still elliptic, of a finer one.
#
# Shortly before the elements break down, gel that slides round the edge jams there, and the force of the last
# depths may be .3 to 2 % high. So a case also ends where P/w exceeds the parabola in sqrt(w) through the four
# depths before by SAME_GROWTH; deeper than a third of the punch's radius P/w is as curved without a jam, and is
# not tested.

LAWS: tuple[Law, ...] = (NeoHooke(), Hencky())
COARSER = 2.0  # edge elements of the coarser mesh over those of the first
FINER = 0.6  # edge elements of the finer mesh over those of the first
SAME_GROWTH = 0.003  # relative tolerance of two growths of P/w
FIRST_JAM = 0.09  # w/h: below it P/w is curved by the first touch
WINDOW = 0.1  # w/h: range of the four depths
BRINK = 1.02  # ratio of the depth where the elements break down to the deepest that is kept
HANGS = "the surface folds, and the force depends on its mesh"
JAMS = "gel that slides jams under the punch's edge"
LOST = "the law loses ellipticity at the punch's edge, and the force depends on its mesh"


@dataclass(frozen=True, slots=True, eq=False)
class Press:
    """One mesh's press: `force` (T,) P/(E w h) and `surface` (T, 2, B) u_r, u_z over w at the first T depths asked
    for, the first `sound` of them without a fold; `ended` as in SolvedCase. `lost`: the law is elliptic no more at
    the deepest of them."""

    force: Floats
    surface: Floats
    sound: int
    ended: str
    lost: bool = False


def problem_of(case: Case, coarser: float = 1.0) -> PunchProblem:
    """Return the case with a gel of thickness 1 and modulus 1, its edge meshed coarser by a factor, as stiff in
    contact.
    """
    law = next(law for law in LAWS if law.name == case.law)
    punch = RoundedPunch(case.a_over_h, case.edge_over_h, case.friction)
    problem = PunchProblem(Material(1.0, case.poisson_ratio), punch, 1.0, case.pad_over_h, law=law, may_fold=True)
    usual = default_mesh(problem)
    mesh = replace(usual, edge_size_mm=min(coarser * usual.edge_size_mm, usual.largest_mm))
    return replace(problem, mesh=mesh, penalty=problem.penalty * mesh.edge_size_mm / usual.edge_size_mm)


def solve_case(case: Case, depths: Sequence[float] = DEPTHS) -> SolvedCase:
    """Press as deep as the solver gets and meshes agree; other depths are omitted."""
    press = _press(case, depths, 1.0)
    kept, ended = len(press.force), press.ended
    if 0 < press.sound < kept:
        brink = [BRINK * depths[kept - 1]] if kept < len(depths) else []
        compared = (*depths[:kept], *brink)  # no deeper, but as far as a depth needs to be kept
        kept = agreed(press, _press(case, compared, COARSER))
        if kept < len(press.force) and not press.lost:
            kept = max(kept, agreed(press, _press(case, compared, FINER)))
        ended = HANGS if kept < len(press.force) else ended
    ended = LOST if ended and press.lost else ended
    if (steady := before_a_jam(case, depths[:kept], force=press.force[:kept])) < kept:
        kept, ended = steady, JAMS
    depth = np.array(depths[:kept])
    sound = float(depth[: press.sound].max(initial=0.0))
    return SolvedCase(depth, press.force[:kept], press.surface[:kept, 0], press.surface[:kept, 1], sound, ended)


def agreed(press: Press, other: Press) -> int:
    """Return how many depths of `press` hold: all without a fold, and those beyond that `other` confirms."""
    common, last = min(len(press.force), len(other.force)), press.sound - 1
    if common <= press.sound:
        return press.sound
    growth = press.force[last:common] / press.force[last] / (other.force[last:common] / other.force[last])
    off = np.abs(growth - 1) > SAME_GROWTH
    return last + int(np.argmax(off)) if off.any() else common


def before_a_jam(case: Case, depths: Sequence[float], *, force: Floats) -> int:
    """Return how many `depths` (n,), w/h, come before P/w (`force`, N per mm) rises above the line of four
    before.
    """
    root, log = np.sqrt(depths), np.log(force)
    for k in range(4, len(root)):
        near = depths[k] - depths[k - 4] <= WINDOW * (1 + ROUNDING)
        if near and FIRST_JAM <= depths[k] <= case.a_over_h / 3:
            line = np.polynomial.polynomial.polyfit(root[k - 4 : k] - root[k], log[k - 4 : k], 2)
            if log[k] - line[0] > SAME_GROWTH:
                return k
    return len(root)


def _press(case: Case, depths: Sequence[float], coarser: float) -> Press:
    model = build(problem_of(case, coarser))
    steps: list[State | str] = []
    states, ended = reached(model, depths, log=steps), ""
    if len(states) < len(depths):
        ended = str(steps[-1])
        last = max((step.depth_mm for step in steps if isinstance(step, State)), default=0.0)
        states = [state for state in states if state.depth_mm * BRINK <= last]
    force = np.array([state.force_N / state.depth_mm for state in states])
    surface = np.array([_surface(model, state, case) for state in states]).reshape(-1, 2, len(BESIDE))
    folded = [state.folded for state in states]
    sound = folded.index(True) if True in folded else len(states)
    doubtful = bool(states) and (bool(ended) or sound < len(states))  # elsewhere nobody asks
    return Press(force, surface, sound, ended, doubtful and _lost(model, states[-1]))


def _lost(model: Model, state: State) -> bool:
    problem = model.problem
    return bool((least_acoustic(problem.law, problem.material, state=deform(model.mesh, state.u)) < 0).any())


def _surface(model: Model, state: State, case: Case) -> Floats:
    """Return (u_r, u_z) over the depth (2, places) where the table has places."""
    from scipy.interpolate import CubicSpline

    wanted = case.a_over_h + np.array(BESIDE)
    on_pad = wanted <= case.pad_over_h * (1 + ROUNDING)
    r, profile = surface_profile(model, state)
    outside = r >= case.a_over_h * (1 - ROUNDING)
    found = np.full((2, len(wanted)), np.nan)
    found[:, on_pad] = CubicSpline(r[outside], profile[:, outside], axis=1)(wanted[on_pad]) / state.depth_mm
    return found


Report = Callable[[int, int], None]  # of the cases that are in the folder, and of all


def tabulate(
    cases: Iterable[Case], folder: Path | str, *, workers: Executor | None = None, report: Report | None = None
) -> int:
    """Solve every case that is not in `folder` yet; return how many were solved now.

    Cases are written atomically, so a run may be stopped and started again. Without `workers` (see
    files/runs.py and cluster/pool.py) the cases are solved one by one in this process.
    """
    place, every = Path(folder), list(cases)
    with output_lock(place):
        missing = [case for case in every if not case_path(place, case).exists()]
        for left, (case, solved) in zip(range(len(missing))[::-1], _solved(missing, workers), strict=True):
            save_case(case_path(place, case), solved)
            if report is not None:
                report(len(every) - left, len(every))
    return len(missing)


def _solved(missing: list[Case], workers: Executor | None) -> Iterator[tuple[Case, SolvedCase]]:
    if workers is None:
        for case in missing:
            yield case, solve_case(case)
        return
    waiting = {workers.submit(solve_case, case): case for case in missing}
    try:
        for done in as_completed(waiting):
            yield waiting[done], done.result()
    finally:
        for future in waiting:
            future.cancel()
