"""What the commands give is what they gave when the record was written: `make digest` shows every difference."""

from __future__ import annotations

import re

import pytest
from shared_scenes import PAPER, calibrated_points

from benchmarks.digest.cases import CASES
from benchmarks.digest.compare import differences
from benchmarks.digest.record import changed, read_changes, read_record
from benchmarks.digest.values import Values
from benchmarks.digest.workspace import Workspace

QUICK = [name for name, case in CASES.items() if case.quick]
SLOW = [name for name in read_record() if name not in QUICK]  # test_samples has one of them at no cost


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return Workspace(tmp_path_factory.mktemp("digest"), {("calibrate", str(PAPER)): calibrated_points()})


def assert_as_recorded(name: str, space: Workspace) -> None:
    assert list(differences(read_record()[name], CASES[name].values(space), name)) == []


@pytest.mark.parametrize("name", QUICK)
def test_quick_results_are_as_recorded(name: str, space: Workspace) -> None:
    assert_as_recorded(name, space)


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_all_other_results_are_as_recorded(name: str, space: Workspace) -> None:
    assert_as_recorded(name, space)


def test_the_record_holds_every_quick_case_and_no_other_than_the_cases() -> None:
    assert set(QUICK) <= set(read_record()) <= set(CASES)


def test_a_difference_is_named_with_before_after_and_relative() -> None:
    before: Values = {"c": 2.0, "verdict": "NONE", "gone": 1}
    after: Values = {"c": 2.000002, "verdict": "IDENTIFIED", "new": [1]}
    assert list(differences(before, after)) == [
        "c: 2.0 before, 2.000002 now, relative +1.00e-06",
        "verdict: 'NONE' before, 'IDENTIFIED' now",
        "gone: 1 before, missing now",
        "new: not recorded before, [1] now",
    ]


def test_differences_within_the_tolerance_are_none() -> None:
    before: Values = {"c": 2.0, "depth.height.1.grid": [0.1, None]}
    after: Values = {"c": 2.0 + 1e-9, "depth.height.1.grid": [0.1000005, None]}
    assert list(differences(before, after)) == []


def test_only_listed_results_are_recorded_anew() -> None:
    may = [re.compile(r"case: points\..*")]
    before: Values = {"points.c": 2.0, "verdict": "NONE", "gone": 1}
    after: Values = {"points.c": 3.0, "verdict": "IDENTIFIED"}
    values, refused = changed("case", before, after, may)
    assert values == {"points.c": 3.0, "verdict": "NONE", "gone": 1}
    assert refused == ["verdict: 'NONE' before, 'IDENTIFIED' now", "gone: 1 before, missing now"]
    assert all(isinstance(pattern, re.Pattern) for pattern in read_changes())
