"""Press a flat punch into a gel pad, by depth or by force, in and out again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.mechanics.punch_fem.march import StepRecord, march
from tactilevision.mechanics.punch_fem.newton import equations
from tactilevision.mechanics.punch_fem.problem import PunchProblem, build
from tactilevision.mechanics.punch_fem.results import PunchSolution, gather


def press_to_depths(problem: PunchProblem, depths_mm: npt.ArrayLike) -> PunchSolution:
    """Solve `problem` at each depth (mm, into the gel) in the given order; smaller after larger ones unload.

    Assumes quasi-static, hyperelastic gel; the rest is stated in problem, laws and contact. Friction depends on
    the path, so ask for the depths in the order in which they occur; intermediate steps are added where needed.
    Raises InputError for depths outside [0, thickness), ConvergenceError where no equilibrium is found.
    """
    depths = _checked(depths_mm, "depths_mm")
    if depths.max() >= problem.thickness_mm:
        raise InputError(
            "a depth reaches through the gel",
            where="press_to_depths",
            value=float(depths.max()),
            remedy=f"The gel is {problem.thickness_mm} mm thick.",
        )
    return _press(problem, depths.tolist(), by_force=False)


def press_to_forces(problem: PunchProblem, forces_N: npt.ArrayLike) -> PunchSolution:
    """Solve `problem` at each force (N, into the gel) in the given order; the depth is an unknown.

    As press_to_depths otherwise. Raises InputError for forces below 0.
    """
    return _press(problem, _checked(forces_N, "forces_N").tolist(), by_force=True)


def _press(problem: PunchProblem, targets: Sequence[float], *, by_force: bool) -> PunchSolution:
    model = build(problem)
    steps: list[StepRecord] = []
    states = list(march(equations(model, by_force=by_force), targets, log=steps))
    return gather(model, states, steps=steps)


def _checked(values: npt.ArrayLike, name: str) -> npt.NDArray[np.float64]:
    array = np.atleast_1d(np.asarray(values, dtype=float))
    if array.ndim != 1 or array.size == 0 or not np.isfinite(array).all() or array.min() < 0:
        raise InputError(f"{name} is a list of finite numbers from 0 up", where="punch_fem", value=values)
    return array
