"""The worked page of the five published points says what the code gives."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from each import each

from benchmarks import five_points
from benchmarks.five_points import CASES, Case, blocks, published, read, solve_case, solved
from tactilevision.recording.read import read_recording

PAGE = (Path(__file__).parents[2] / "docs" / "evidence" / "five_points.md").read_text(encoding="utf-8")


@each("name", ["reproduced", "depth_zero", "other_gels", "equal_depth", "left_open"])
def test_the_page_holds_the_tables_as_they_are_computed(name: str) -> None:
    assert "\n".join(blocks()[name]) in PAGE


def test_the_points_of_the_sample_are_the_published_ones() -> None:
    points = read_recording(Path(__file__).parents[2] / "sample_frames" / "paper_points").points
    np.testing.assert_allclose([p.depth_mm for p in points], five_points.DEPTHS_MM)
    np.testing.assert_allclose([p.fz_N for p in points], published(), atol=1e-4)


def test_the_sentences_quote_the_tables() -> None:
    depths = five_points.DEPTHS_MM
    truth = solved()

    def seen(case: Case) -> five_points.Reading:
        secant = truth[case]
        return read(depths[: len(secant)], secant * depths[: len(secant)])

    nus = [seen(case).poisson_ratio for case in (Case(poisson_ratio=0.45), Case(), Case(poisson_ratio=0.49))]
    assert "the route reads " + ", ".join(f"{nu:.4f}"[1:] for nu in nus) in PAGE
    thin = seen(Case(thickness_mm=2.25, edge_mm=0.1))
    assert f"β = {thin.beta:.2f}, R² = {thin.r_squared:.4f}"[:9] in PAGE
    assert f"E reads {100 * (thin.youngs_modulus_MPa - 1):.0f} % high" in re.sub(r"\s+", " ", PAGE)
    assert f"reads {seen(Case(edge_mm=0.25)).beta:.2f}, .5 mm {seen(Case(edge_mm=0.5)).beta:.2f}" in PAGE
    assert max(seen(case).beta for case in CASES if case.law != "neo-hooke") == pytest.approx(1.64, abs=0.005)


def test_every_case_of_the_page_was_solved() -> None:
    assert list(solved()) == list(CASES)


@pytest.mark.slow
@pytest.mark.parametrize("case", [Case(), Case(edge_mm=0.25)])
def test_the_elements_behind_the_page_solve_to_the_same(case: Case) -> None:
    np.testing.assert_allclose(solve_case(case), solved()[case], rtol=1e-3)
