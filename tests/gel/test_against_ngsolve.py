"""Forces on a dome and on a wedge, against tetrahedra of third order in another library."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.force_curved import DOME, WEDGE, against_ngsolve
from tactilevision.records.rig import Gel


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("gel", [DOME, WEDGE], ids=["dome", "wedge"])
def test_a_force_on_a_curved_gel_comes_back(gel: Gel) -> None:
    pytest.importorskip("ngsolve")
    off = against_ngsolve(gel, 3, seed=4)
    assert np.median(off[:, 0, [0, 2]]) < 0.01
    assert off[:, 0, [0, 2]].max() < 0.02
