"""Force near the gel's side, against tetrahedra of third order in another library."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.force_sides import near_the_side


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_load_near_the_side_comes_back_only_where_the_side_is_known() -> None:
    pytest.importorskip("ngsolve")
    held, free = near_the_side(2.5)
    assert np.abs(held).max() < 0.03
    assert np.abs(free).max() > 2 * np.abs(held).max()
