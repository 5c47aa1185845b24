"""The scorer counts right, the samples are what their command makes, a small blind test runs from end to end."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from each import each

from benchmarks.blind.analyst import Finding
from benchmarks.blind.cases import Case, make
from benchmarks.blind.run import run
from benchmarks.blind.samples import BALLS_STATED, SEED, make_curves
from benchmarks.blind.score import Result, confusion, targets
from benchmarks.blind.sets import full_set, small_set
from benchmarks.blind.world import HIDDEN
from tactilevision.recording.read import read_recording

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "sample_frames"


def said(verdict: str, *named: str) -> Finding:
    return Finding(verdict, named, named, 0.2, (0.19, 0.21), 0.005, 0.005, 1.0)


def result(case: Case, finding: Finding, *, strength: float = 12.0, rivals: tuple[str, ...] = ()) -> Result:
    return Result(case, dict.fromkeys(case.hidden, strength), rivals, 0.2, finding)


def figures(results: list[Result]) -> dict[str, float]:
    return {line.what: line.value for line in targets(results) if line.size}


def test_scores_of_a_perfect_and_of_a_blind_analyst() -> None:
    cases = [Case(1), Case(2, ("tilt",)), Case(3, ("ageing", "mullins")), Case(4, ("two_ranges",))]
    perfect = figures(
        [
            result(
                case,
                said(
                    "UNKNOWN" if case.seed == 4 else "IDENTIFIED" if case.hidden else "ADEQUATE",
                    *(case.hidden if case.seed != 4 else ()),
                ),
            )
            for case in cases
        ]
    )
    assert perfect["named though nothing is hidden"] == 0
    assert perfect["truth in the returned set"] == perfect["truth in first place"] == 1
    assert perfect["two hidden: both found"] == perfect["outside the catalogue: UNKNOWN"] == 1
    assert perfect["confidently wrong"] == perfect["false UNKNOWN"] == 0
    assert perfect["95 % interval of E holds the truth"] == 1
    blind = figures([result(case, said("IDENTIFIED", "skin")) for case in cases])
    assert blind["named though nothing is hidden"] == blind["confidently wrong"] == 1
    assert blind["outside the catalogue: wrongly named"] == 1
    assert blind["truth in first place"] == blind["two hidden: at least one"] == 0


def test_what_hardly_shows_is_not_counted_and_rivals_ask_for_ambiguous() -> None:
    faint = result(Case(1, ("skin",)), said("ADEQUATE"), strength=3.0)
    assert "truth in first place" not in figures([faint])
    both = [
        result(Case(k, ("thickness",)), said(verdict, "thickness"), rivals=("edge_fillet",))
        for k, verdict in enumerate(["AMBIGUOUS", "IDENTIFIED"])
    ]
    assert figures(both)["AMBIGUOUS where d < 3"] == 0.5


def test_the_confusion_matrix_counts_first_answers() -> None:
    case = Case(1, ("tilt",))
    table = confusion([result(case, said("IDENTIFIED", "tilt")), result(replace(case, seed=2), said("ADEQUATE"))])
    assert table == {"tilt": {"tilt": 1, "ADEQUATE": 1}}


def test_the_sets_number_their_seeds_and_hide_everything() -> None:
    cases = full_set(1, first_seed=50)
    assert [case.seed for case in cases] == list(range(50, 50 + len(cases)))
    assert {key for case in cases for key in case.hidden} >= set(HIDDEN)
    assert {case.design for case in cases} == {"plain", "medium", "rich"}
    assert cases == full_set(1, first_seed=50)


def test_a_recording_does_not_say_what_is_hidden_in_it(tmp_path: Path) -> None:
    """Read back whole, the truth only in truth.toml, and the same seed gives the same bytes."""
    made = make(Case(11, ("mullins",)), tmp_path / "a", rivals=False)
    again = make(Case(11, ("mullins",)), tmp_path / "b", rivals=False)
    for file in made.folder.iterdir():
        assert file.read_bytes() == (again.folder / file.name).read_bytes()
        assert file.name == "truth.toml" or b"mullins" not in file.read_bytes()
    recording = read_recording(made.folder)
    assert len(recording.curves) == len(recording.presses) == 39
    assert all(len(curve.time_s) == 17 for curve in recording.curves)
    assert "mullins" in tomllib.loads((made.folder / "truth.toml").read_text())["hidden"]


@each(
    "name, keys",
    [
        ("hidden_rig", ["photometric_gain"]),
        ("hidden_material", ["viscoelasticity"]),
        ("hidden_unknown", ["two_ranges"]),
        ("hidden_two", ["viscoelasticity", "thickness_wedge"]),
        ("hidden_shadow", ["cast_shadow"]),
        ("hidden_force", ["clock_offset", "modulus_change"]),
    ],
)
def test_samples_hide_what_their_truth_says(name: str, keys: list[str]) -> None:
    folder = SAMPLES / name
    assert list(tomllib.loads((folder / "truth.toml").read_text())["hidden"]) == keys
    assert sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) < 4e6
    for file in ("README.md", "recording.toml", "presses.csv"):
        assert not any(key in (folder / file).read_text() for key in keys)
    recording = read_recording(folder)
    assert bool(recording.frame_names) == (name in {"hidden_rig", "hidden_shadow"})
    if name == "hidden_rig":
        assert {round(ball.ball_radius_mm / BALLS_STATED, 6) for ball in recording.balls} == {2.0, 4.0}


def test_a_sample_is_made_again_by_its_command(tmp_path: Path) -> None:
    make_curves(tmp_path / "hidden_unknown", SEED + 2, {"two_ranges": 0.03})
    for file in ("curves.csv", "presses.csv", "recording.toml"):
        assert (tmp_path / "hidden_unknown" / file).read_text() == (SAMPLES / "hidden_unknown" / file).read_text()


@pytest.mark.slow
def test_the_small_blind_test(tmp_path: Path) -> None:
    """Nothing named where nothing is hidden, plain effects found first, and a log that is taken up."""
    log = tmp_path / "log.jsonl"
    outcomes = [o["diagnose"] for o in run(small_set(), log, with_naive=False)]
    assert not [r.finding.failed for r in outcomes if r.finding.failed]
    assert not any(r.finding.named for r in outcomes if r.clean)
    assert sum(r.first in r.hidden for r in outcomes if r.single) >= 2
    assert [o["diagnose"] for o in run(small_set(), log, with_naive=False)] == outcomes
