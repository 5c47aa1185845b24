"""The state of a workbench, without a browser: what is added, removed, undone, named and held side by side."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from each import each
from made_bench import PRESSES, bench, do, presses

from calibration.effects.private import load_effect, new_effect
from calibration.inputs.observations import leave_out, press_names
from calibration.tasks.compare import compare
from calibration.tasks.session import History, load_history
from calibration.workbench import bench as bench_module
from calibration.workbench.analysis import Asking, Models, Verdict
from calibration.workbench.bench import Bench, Track
from calibration.workbench.curve_views import curve_view, tried_view, why_off
from calibration.workbench.opened import Opened
from calibration.workbench.recorded import file_marks
from calibration.workbench.views import state_view
from tactilevision.errors import InputError
from tactilevision.files.writing import as_json
from tactilevision.records.measured import Estimate


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where its state is kept."""
    return tmp_path_factory.mktemp("state")


@pytest.fixture(scope="module")
def made(folder: Path) -> Bench:
    """One workbench for all tests here; each leaves it at the base model."""
    return bench(folder)


@pytest.fixture(autouse=True)
def _at_the_plain_law(made: Bench) -> Any:
    yield
    while made.shown.track.past:
        do(made, "undo")


def held_out(made: Bench) -> list[float]:
    fall: list[float] = state_view(made)["falls"][0]["error"]
    return fall


def test_adding_what_is_missing_makes_the_error_fall_and_undoing_puts_it_back(made: Bench) -> None:
    before = held_out(made)
    shown = do(made, "add", "depth_zero")
    first, last = held_out(made)
    assert first == before[0]
    assert last < 0.5 * first
    assert [step.key for step in shown.history.steps] == ["depth_zero"]
    assert shown.history.steps[0].held_out_after_N == pytest.approx(1e-3 * last)
    back = do(made, "undo")
    assert held_out(made) == before
    assert [step.key for step in back.history.undone] == ["depth_zero"], "`steps --redo` puts it back"
    do(made, "redo")
    assert held_out(made) == [first, last]


def test_a_state_has_the_numbers_of_the_command_line(made: Bench) -> None:
    do(made, "add", "force_bias")
    do(made, "add", "depth_zero")
    shown = made.shown
    assert shown.now is not None
    effects = ["force_bias", "depth_zero"]
    found = compare(made.opened.data, effects, rng=np.random.default_rng(0), bound=made.opened.bound)
    assert as_json(found.as_json()) == as_json(shown.now.found.as_json())


def test_what_stands_out_names_what_is_missing_and_what_it_would_leave(made: Bench) -> None:
    cards = state_view(made)["cards"]
    card = next(one for one in cards if one["key"] == "depth_zero")
    assert card["significant"]
    assert card["overlay"] is not None
    shares = [one["fall"]["share"] for one in cards if one["fall"]]
    assert shares == sorted(shares, reverse=True), "what removes most of the error comes first"
    assert card["fall"]["share"] == pytest.approx(shares[0], rel=1e-3)
    added = do(made, "add", "depth_zero")
    assert state_view(made)["falls"][0]["error"] == card["fall"]["error"], "the card has the error of the model"
    assert "depth_zero" not in [one.effect.key for one in added.evidence]
    assert all(one.why or one.p_adjusted > 0 for one in added.evidence)
    assert any(one.why for one in added.evidence), "what these data cannot show says why"


def test_what_was_named_stays_until_it_is_added_and_both_are_added_at_once(made: Bench) -> None:
    made._show(verdict=Verdict("IDENTIFIED", "Two are missing.", named=("depth_zero", "force_bias")))
    assert state_view(made)["modulus"][0]["lacks"] == "lacks depth zero and force bias"
    one = do(made, "add", "depth_zero")
    assert [step.key for step in one.history.steps] == ["depth_zero"]
    assert [card["key"] for card in state_view(made)["verdict"]["named"]] == ["force_bias"]
    do(made, "undo")
    both = do(made, "add", "depth_zero\nforce_bias")
    assert [step.key for step in both.history.steps] == ["depth_zero", "force_bias"]
    assert state_view(made)["verdict"]["named"] == []
    assert [row["name"] for row in state_view(made)["modulus"]] == ["base model", "+ depth zero", "+ force bias"]
    assert not do(made, "undo").history.steps


def test_the_progress_counts_the_effects_of_a_pass() -> None:
    steps = [
        ("a", 0, 1),
        ("b", 1, 2),
        ("c", 0, 3),
        ("d", 1, 3),
        ("e", 2, 3),
        ("f", 3, 4),
        ("g", 4, 5),
        ("h", 0, 6),
    ]
    seen = []
    asking = Asking()
    for step in steps:
        asking = asking.then(*step)
        seen.append((asking.tried, asking.of, asking.passes))
    assert seen[2:5] == [(0, 3, 1), (1, 3, 1), (2, 3, 1)]
    assert seen[0] == (0, 0, 0)
    assert seen[-1] == (0, 6, 2)
    assert asking.left_s is None


def test_one_step_is_removed_from_between_others_and_can_be_put_back(made: Bench) -> None:
    for key in ("force_bias", "depth_zero"):
        do(made, "add", key)
    shown = do(made, "remove", "force_bias")
    assert [step.key for step in shown.history.steps] == ["depth_zero"]
    shown = do(made, "undo")
    assert [step.key for step in shown.history.steps] == ["force_bias", "depth_zero"]


def test_a_press_is_left_out_and_put_back(made: Bench, tmp_path: Path) -> None:
    shown = do(made, "leave_out", "p1")
    view = state_view(made)
    assert next(p for p in view["presses"] if p["name"] == "p1")["state"] == "excluded"
    assert len(curve_view(shown)["presses"]) == PRESSES - 1
    assert "--leave-out p1" in shown.history.script(tmp_path)
    assert shown.now is not None
    assert shown.now.found.stated.count == leave_out(made.opened.data, ["p1"]).count
    do(made, "put_back", "p1")
    assert len(curve_view(made.shown)["presses"]) == PRESSES


def test_presses_of_several_recordings_have_names_of_their_own() -> None:
    data = presses()
    half = np.arange(data.count) // (data.count // 2)
    labels = tuple(f"p{k % (data.count // 2)}" for k in range(data.count))
    both = replace(data, presses=replace(data.presses, recording=half, label=labels), recordings=("gel", "gel"))
    assert press_names(both)[:2] == ("gel/p0", "gel/p1")
    assert press_names(both)[-1] == f"gel 2/{labels[-1]}"
    kept = leave_out(both, ["gel 2/p0"])
    assert kept.count == data.count - 1
    assert kept.presses.recording.sum() == data.count // 2 - 1
    with pytest.raises(InputError, match="every press is excluded"):
        leave_out(both, press_names(both))
    with pytest.raises(InputError, match="--leave-out"):
        leave_out(both, ["p0"])


def test_states_have_names_and_stand_side_by_side(made: Bench) -> None:
    do(made, "add", "depth_zero")
    do(made, "label", "with zero")
    do(made, "undo")
    shown = do(made, "sides", "base model\nwith zero")
    view = state_view(made)["sides"]
    assert view["names"] == ["base model", "with zero"]
    assert ["effects", "none", "depth zero"] in view["rows"]
    errors = next(row for row in view["rows"] if row[0] == "error of the force")
    assert len(set(errors)) == 3
    assert curve_view(shown)["models"] == ["base model", "with zero"]
    assert not do(made, "sides", "").sides
    shown = do(made, "restore", "with zero")
    assert [step.key for step in shown.history.steps] == ["depth_zero"]


def test_a_slider_moves_the_force_with_all_else_held(made: Bench) -> None:
    shown = do(made, "add", "depth_zero")
    assert shown.now is not None
    fitted = shown.now.found.models[-1].fitted
    value = float(fitted.values[fitted.index("depth_zero.offset_mm")])
    at_fit = tried_view(shown, "depth_zero.offset_mm", value)
    assert at_fit["rms"] == pytest.approx(1e3 * fitted.rms_error_N)
    assert tried_view(shown, "depth_zero.offset_mm", value + 0.02)["rms"] > 2 * at_fit["rms"]
    for name, wrong in (("depth_zero.offset_mm", 1e6), ("magic", 0.0)):
        with pytest.raises(InputError):
            tried_view(shown, name, wrong)


@each(
    "action, value",
    [
        ("add", "magic"),
        ("add", "ageing"),  # needs several days
        ("remove", "tilt"),
        ("leave_out", "p99"),
        ("put_back", "p1"),
        ("label", "a\nb"),
        ("restore", "nothing"),
        ("sides", "base model\nnothing"),
        ("dance", ""),
    ],
)
def test_what_cannot_be_done_is_said_and_the_state_stays(made: Bench, action: str, value: str) -> None:
    before = made.shown
    after = do(made, action, value)
    assert after.notice
    assert after.track == before.track
    assert after.now is before.now


def test_nothing_is_undone_where_nothing_was_done() -> None:
    for step in (Track.undo, Track.redo):
        with pytest.raises(InputError, match="nothing to"):
            step(Track(History(("made",))))


def test_a_tab_that_has_not_seen_the_change_of_another_changes_nothing(made: Bench) -> None:
    seen = made.shown.version
    do(made, "add", "depth_zero")
    with pytest.raises(InputError, match="another tab"):
        made.act("remove", "depth_zero", version=seen)
    made.act("remove", "depth_zero", version=made.shown.version)
    made.work(until_idle=True)
    assert not made.shown.history.steps


def test_the_state_is_kept_and_goes_on_from_its_file(made: Bench, folder: Path, tmp_path: Path) -> None:
    do(made, "add", "depth_zero")
    do(made, "label", "cured")
    do(made, "leave_out", "p2")
    kept = load_history(folder / "history.json")
    again = bench(tmp_path, history=kept)
    assert as_json(state_view(again)["falls"]) == as_json(state_view(made)["falls"])
    assert kept.left_out == ("p2",)
    assert ("cured", ()) in [(one.name, one.left_out) for one in kept.labels]


FAULTS = {
    "raises": "raise RuntimeError('no <b>luck</b>')",
    "returns": "return state.force_N",
    "prints": "print('noise'); raise KeyError",
    "loops": "while True: pass",
}


@pytest.mark.slow
def test_an_effect_of_ones_own_that_fails_is_said_on_its_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_MAX_EFFECT_SECONDS", "1")
    files = {}
    for key, fault in FAULTS.items():
        file = tmp_path / f"{key}.py"
        new_effect(file, key)
        text = file.read_text()
        body = text.index("\n", text.index(":\n", text.index("def apply"))) + 1
        file.write_text(f"{text[:body]}        {fault}\n")
        files[key] = str(file)
    made = bench(tmp_path, private=tuple(load_effect(file) for file in files.values()), files=files)
    for key in FAULTS:
        card = next(one for one in state_view(made)["cards"] if one["key"] == key)
        assert card["why"]
        assert card["kind"] == "your own"
        assert do(made, "add", key).notice
    assert not made.shown.history.steps
    assert not do(made, "add", "depth_zero").notice, "the page lives on"


EFFECT = """
from calibration.model.stages import EffectBase, Stage, amplitude


class Own(EffectBase):
    key = "own_zero"
    stage = Stage.DEPTH
    parameters = (amplitude("offset_mm", "mm", 0.2, "zero", 0.01),)

    def apply(self, state, values, data):
        return state.plus(depth_mm=values[0])
"""


def test_an_effect_is_written_run_and_added_on_the_page(tmp_path: Path) -> None:
    made = bench(tmp_path)
    for text, said in ((EFFECT.replace("key =", "k ="), "no key"), (EFFECT.replace("def", "de"), "SyntaxError")):
        assert said in do(made, "own", text).notice
        assert not list(tmp_path.glob("own_effects/*.py")), "a text that cannot be run is not kept"
    assert "no luck" in do(made, "own", EFFECT.replace("return", "raise RuntimeError('no luck') #")).notice
    assert not made.opened.private
    shown = do(made, "own", EFFECT)
    first, last = held_out(made)
    assert last < 0.5 * first
    assert shown.history.steps[0].path.endswith("own_effects/own_zero.py")
    assert "--effect" in made.again
    assert "in the model" in do(made, "own", EFFECT).notice
    do(made, "undo")
    assert len(held_out(made)) == 1


def test_the_page_is_there_while_presses_are_certified_and_stays_where_they_cannot_be(tmp_path: Path) -> None:
    seen: list[tuple[str, str]] = []

    def read(made: Bench) -> Opened:
        made.report("certifying presses: frames", 1, 3)
        made.warned(["careful"])
        view = state_view(made)
        seen.append((view["verdict"]["asking"], view["presses"][0]["state"]))
        assert view["warnings"] == ["careful"]
        raise InputError("every press was rejected", where="made")

    press: Any = SimpleNamespace(press="p1", indenter="A")
    measured: Any = SimpleNamespace(recording=SimpleNamespace(name="made", presses=(press,)), points=())
    made = Bench(
        Opened((), (measured,)),
        History(("made",)),
        export=lambda *_: tmp_path,
        keep=lambda _: None,
        out=tmp_path,
        asks=False,
        read=read,
    )
    made.work(until_idle=True)
    view = state_view(made)
    assert seen == [("certifying presses: frames", "being certified")]
    assert view["presses"][0]["state"] == "not certified"
    assert "every press was rejected" in view["verdict"]["troubled"]
    assert not view["busy"]
    assert curve_view(made.shown)["models"] == []


def test_what_was_stated_of_a_model_stays_and_an_export_keeps_every_caveat(made: Bench) -> None:
    modulus = Estimate.normal(0.2, 0.03, "MPa")
    known = made._known[(), ()]
    known.verdict = Verdict(
        "IDENTIFIED",
        "It is missing.",
        named=("depth_zero",),
        modulus=modulus,
        next_modulus=Estimate.normal(0.21, 0.02, "MPa"),
        warnings=("shaded",),
    )
    shown = do(made, "add", "depth_zero")
    assert shown.stated == known.verdict.next_modulus
    shown = do(made, "leave_out", "p1")
    opened = replace(made.opened, warnings=("of the light",))
    assert shown.said(opened)[1] == ["of the light", "Excluded by hand: p1."]
    gel = shown.found(opened).models[-1].material
    assert gel is not None
    assert {"of the light", "Excluded by hand: p1."} <= set(gel.warnings)
    known.verdict = None


def test_a_press_that_stays_off_says_why(made: Bench) -> None:
    shown = do(made, "add", "depth_zero")
    assert shown.now is not None
    fitted = shown.now.found.models[-1].fitted
    rows, left = fitted.data.spans[2], 0.0 * fitted.residual_N
    for change, said in (
        (-0.03 * fitted.force_N, "3.0 % low as a whole: beyond the scatter of gains"),
        (0.02 * fitted.about.slope_N_per_mm, "its zero is off by 20 µm"),
    ):
        left[rows] = change[rows]
        off = why_off(replace(fitted, residual_N=left))
        assert list(off) == ["p2"]
        assert off["p2"].startswith(said)


def test_a_file_that_changes_or_goes_is_said_and_nothing_is_lost(made: Bench, tmp_path: Path) -> None:
    recording, before = tmp_path / "recording", made.opened
    recording.mkdir()
    for name in ("points.csv", "recording.toml"):
        (recording / name).write_text("1")
    made.opened = replace(before, paths=(recording,), marks=file_marks([recording]))
    (recording / "out").mkdir()
    assert made.wait(0, 0).changed == ""
    (recording / "points.csv").write_text("12")
    (recording / "recording.toml").unlink()
    shown = made.wait(0, 0)
    assert shown.changed.startswith("recording.toml is gone and points.csv is changed or new since")
    assert shown.changed in state_view(made)["warnings"]
    shutil.rmtree(recording)
    assert "points.csv, recording.toml are gone" in made.wait(0, 0).changed
    assert len(held_out(made)) == 1, "what was read stands"
    made.opened = before
    assert made.wait(0, 0).changed == ""


def test_the_error_falls_before_what_it_depends_on_is_drawn(made: Bench) -> None:
    models = Models(made.opened)
    quick = models.fitted((), ("force_bias",))
    assert quick.rng is None
    assert not quick.found.models[-1].covariates
    assert np.isfinite(quick.found.models[-1].held_out_N)
    assert models.completed((), ("force_bias",)).found.models[-1].covariates


def test_a_change_that_takes_too_long_is_stopped_and_said(made: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_module, "FIT_S", 0.02)
    shown = do(made, "add", "thickness")
    assert "was stopped after" in shown.notice
    assert not shown.history.steps


def test_where_nothing_is_sure_what_may_be_it_is_offered_to_try(made: Bench) -> None:
    unknown = Verdict("UNKNOWN", "Something is missing.", nearest="depth_along_depth+skin")
    made._show(verdict=unknown)
    shown = state_view(made)["verdict"]
    assert [one["title"] for one in shown["nearest"]] == ["depth along depth", "skin"]
    assert shown["named"] == []
    alike = replace(unknown, word="AMBIGUOUS", named=("tilt",), candidates=("tilt", "skin"), nearest="")
    made._show(verdict=alike)
    shown = state_view(made)["verdict"]
    assert [one["key"] for one in shown["nearest"]] == ["tilt", "skin"]
    assert shown["named"] == [], "of several that look alike none is added as if it were sure"
    made._show(verdict=None)
    assert state_view(made)["verdict"]["nearest"] == []


def test_the_candidates_stay_possible_when_one_of_them_is_added() -> None:
    now = Verdict("ADEQUATE", modulus=Estimate.normal(0.2, 0.01, "MPa"))
    before = Verdict("AMBIGUOUS", named=("tilt",), candidates=("tilt", "skin"), next_E_MPa=(0.1, 0.21))
    held = now.after(before, ["tilt"]).modulus
    assert held is not None
    assert held.interval95 == pytest.approx((0.1, 0.2 + 1.96 * 0.01), rel=1e-4)
    for other in (now.after(before, ["backlash"]), now.after(None, ["tilt"])):
        assert other == now
