"""Effects of the user's own, and the steps that were taken with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from each import each
from test_screen import MODEL, TRUTH, measured, presses

from calibration.effects.private import load_effect, new_effect
from calibration.fit.least_squares import fit
from calibration.tasks.compare import compare
from calibration.tasks.diagnose import diagnose
from calibration.tasks.session import History, Step, load_history
from tactilevision.errors import InputError, OutputError


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("raise RuntimeError('my own fault')", "my own fault"),
        pytest.param("raise SystemExit(7)", "SystemExit: 7", marks=pytest.mark.slow),
        pytest.param("return replace(state, force_N=state.force_N * 1j)", "real", marks=pytest.mark.slow),
        pytest.param("return replace(state, force_N=state.force_N * np.nan)", "finite", marks=pytest.mark.slow),
        pytest.param(
            "return replace(state, force_N=state.force_N[:3])", "one force a sample", marks=pytest.mark.slow
        ),
    ],
)
def test_a_private_effect_that_fails_is_named_and_the_rest_goes_on(tmp_path: Path, body: str, why: str) -> None:
    file = tmp_path / "mine.py"
    new_effect(file, "my_effect")
    text = file.read_text()
    head, tail = text.split("        share =")
    file.write_text(head + "        if values[0] != 0:\n            " + body + "\n        share =" + tail)
    effect = load_effect(file)
    data = presses(8)
    taken = measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(1))
    found = diagnose(taken, np.random.default_rng(0), effects=[effect])
    assert why in found.limits.not_testable["my_effect"]
    assert found.verdict in ("ADEQUATE", "IDENTIFIED", "AMBIGUOUS", "UNKNOWN")
    compared = compare(taken, [effect, "ageing", "depth_zero"], rng=np.random.default_rng(0))
    assert [model.effects for model in compared.models] == [(), ("depth_zero",)]
    assert why in dict(compared.left_out)["my_effect"]
    assert "several days" in dict(compared.left_out)["ageing"]


def test_a_private_effect_that_never_ends_is_named_and_one_that_prints_goes_to_stderr(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TACTILEVISION_MAX_EFFECT_SECONDS", "1")
    file = tmp_path / "mine.py"
    new_effect(file, "my_effect")
    head, tail = file.read_text().split("        share =")
    endless = "        if values[0] != 0:\n            while True:\n                pass\n        share ="
    file.write_text(head + "        print('heard')\n" + endless + tail)
    effect, data = load_effect(file), presses(8)
    taken = measured(data, MODEL.predict(TRUTH, data), np.random.default_rng(1))
    compared = compare(taken, [effect], rng=np.random.default_rng(0))
    assert "MyEffect.apply" in dict(compared.left_out)["my_effect"]
    assert "did not end within 1 s" in dict(compared.left_out)["my_effect"]
    said = capsys.readouterr()
    assert "heard" in said.err
    assert "heard" not in said.out
    file.write_text("while True:\n    pass\n")
    with pytest.raises(InputError, match="did not end within 1 s"):
        load_effect(file)


@pytest.mark.parametrize("key", ["'tilt'", "7"])
def test_a_private_effect_has_a_name_of_its_own(tmp_path: Path, key: str) -> None:
    file = tmp_path / "mine.py"
    new_effect(file, "my_effect")
    file.write_text(file.read_text().replace('"my_effect"', key))
    with pytest.raises(InputError, match="a name that no effect of the catalogue has"):
        load_effect(file)


@each("key", ["two words", "tilt", "class", "9th", ""])
def test_a_template_is_not_written_for_a_key_that_could_not_be_loaded(tmp_path: Path, key: str) -> None:
    with pytest.raises(InputError, match="one word"):
        new_effect(tmp_path / "mine.py", key)
    assert not (tmp_path / "mine.py").exists()


def test_the_template_is_an_effect_that_finds_its_planted_value(tmp_path: Path) -> None:
    new_effect(tmp_path / "order_drift.py", "order_drift")
    effect = load_effect(tmp_path / "order_drift.py")
    data = presses()
    model = MODEL + effect
    force = model.predict(np.append(TRUTH, 0.08), data)
    found = fit(model, measured(data, force, np.random.default_rng(0)))
    assert found.estimate("order_drift.amplitude").value == pytest.approx(0.08, abs=0.02)
    with pytest.raises(OutputError, match="exists already"):
        new_effect(tmp_path / "order_drift.py", "order_drift")


@pytest.mark.parametrize(
    ("text", "why"), [("x = 1", "one subclass"), ("1/0", "division by zero"), (None, "no such file")]
)
def test_files_that_are_no_effect_are_named(tmp_path: Path, text: str | None, why: str) -> None:
    if text is not None:
        (tmp_path / "bad.py").write_text(text)
    with pytest.raises(InputError, match=why):
        load_effect(tmp_path / "bad.py")


def test_steps_are_kept_undone_redone_and_exported(tmp_path: Path) -> None:
    history = History(("a b.rec",)).add(Step("depth_zero", "", 0.02, 0.01)).add(Step("mine", "my effect.py"))
    with pytest.raises(InputError, match="already"):
        history.add(Step("mine"))
    back = history.undo()
    assert [s.key for s in back.steps] == ["depth_zero"]
    assert back.redo() == history
    history.save(tmp_path / "history.json")
    assert load_history(tmp_path / "history.json").steps[0] == history.steps[0]
    command = "tactilevision compare 'a b.rec' --with depth_zero --effect 'my effect.py' --out 'o u t'\n"
    assert history.script("o u t").endswith(command)
    with pytest.raises(InputError, match="undo"):
        History(()).undo()
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(InputError, match="no history"):
        load_history(tmp_path / "bad.json")
    with pytest.raises(InputError, match="no history of an analysis here"):
        load_history(tmp_path / "nowhere" / "history.json")
