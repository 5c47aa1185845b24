"""Tables made by a Dask cluster, here one of two processes on this machine, of which one is killed at work."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactilevision.cli import main
from tactilevision.cluster.pool import cluster_pool
from tactilevision.mechanics.tables import solve as method
from tactilevision.mechanics.tables.cases import Grid, case_path, load_case
from tactilevision.mechanics.tables.solve import solve_case
from tactilevision.mechanics.tables.table import read_table

distributed = pytest.importorskip("distributed")
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]  # the cluster's own farewells

GRID = Grid(("neo-hooke",), (np.inf,), (0.1,), (5.0,), (0.3, 0.4), (0.4, 0.6))


@pytest.fixture
def local() -> Iterator[Any]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as running:
        yield running


def test_a_worker_that_dies_costs_its_case_a_second_try_and_no_more(local: Any, tmp_path: Path) -> None:
    cases, told = list(GRID.cases()), []

    def report(done: int, total: int) -> None:
        told.append(done)
        if len(told) == 1:
            os.kill(next(iter(local.workers.values())).pid, signal.SIGKILL)

    with cluster_pool(local.scheduler_address) as workers:
        assert method.tabulate(cases, tmp_path, workers=workers, report=report) == len(cases)
    assert told == [1, 2, 3, 4]
    here, there = solve_case(cases[3]), load_case(case_path(tmp_path, cases[3]))
    np.testing.assert_allclose(there.force, here.force, rtol=1e-9)


def test_the_command_hands_its_cases_to_the_cluster(
    local: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("tactilevision.mechanics.tables.solve.build")  # nothing can be solved in this process
    options = (
        "--law",
        "neo-hooke",
        "--friction",
        "inf",
        "--poisson-ratio",
        "0.3,0.4",
        "--a-over-h",
        "0.4,0.6",
        "--edge-over-h",
        "0.1",
        "--cluster",
        local.scheduler_address,
    )
    monkeypatch.setattr(sys, "argv", ["tactilevision", "tabulate", str(tmp_path), *options])
    assert main() == 0
    assert read_table(tmp_path / "punch.npz").blocks[0].stiffness.shape[:2] == (2, 2)
