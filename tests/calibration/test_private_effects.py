"""Effects of the user's own, and the steps that were taken with them."""

from __future__ import annotations

import importlib.util
import pickle
import signal
import subprocess
import sys
import time
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from each import each
from test_screen import MODEL, TRUTH, measured, presses

from calibration import effects
from calibration.effects.private import load_effect, new_effect
from calibration.fit.least_squares import fit
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from calibration.model.stages import EffectBase
from calibration.tasks.compare import compare
from calibration.tasks.diagnose import diagnose
from calibration.tasks.session import History, Step, load_history
from tactilevision.errors import InputError, OutputError

SAMPLE = Path(__file__).parents[2] / "sample_frames" / "hidden_material"


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
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
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
    said = capfd.readouterr()
    assert "heard" in said.err
    assert "heard" not in said.out
    file.write_text("while True:\n    pass\n")
    with pytest.raises(InputError, match="did not end within 1 s"):
        load_effect(file)


def same(here: Any, there: Any) -> None:
    """Equal bit by bit."""
    assert type(here) is type(there) or isinstance(here, EffectBase)
    if isinstance(here, np.ndarray):
        assert (here.dtype, here.shape, here.tobytes()) == (there.dtype, there.shape, there.tobytes())
    elif isinstance(here, tuple):
        assert len(here) == len(there)
        for one, other in zip(here, there, strict=True):
            same(one, other)
    elif isinstance(here, EffectBase):
        for name in ("key", "title", "stage", "seen_in", "largest", "order", "start_values", "parameters"):
            same(getattr(here, name), getattr(there, name))
    elif is_dataclass(here):
        for part in fields(here):
            same(getattr(here, part.name), getattr(there, part.name))
    else:
        assert here == there or here != here


OTHERS = """
    def in_picture(self, data=None):
        return type(self)()

    def supposed(self, data):
        return replace(data, force_N=2 * data.force_N, gel=replace(data.gel, thickness_mm=3.0))
"""


@pytest.mark.parametrize(
    "key", [pytest.param("viscoelasticity", marks=pytest.mark.slow), "adhesion", "order_drift"]
)
def test_an_effect_in_its_process_gives_the_same_numbers_as_in_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str
) -> None:
    file, place = tmp_path / "own.py", Path(effects.__file__).parent / f"{key}.py"
    if place.exists():
        file.write_text(place.read_text().replace(f'key = "{key}"', f'key = "own_{key}"'))
    else:
        new_effect(file, key)
        file.write_text(file.read_text() + OTHERS)
    spec = importlib.util.spec_from_file_location("own", file)
    assert spec is not None
    assert spec.loader is not None
    monkeypatch.setitem(sys.modules, "own", module := importlib.util.module_from_spec(spec))
    spec.loader.exec_module(module)
    kind = next(one for one in vars(module).values() if isinstance(one, type) and one.__module__ == "own")
    here, there, data = kind(), load_effect(file), presses(4)
    same(here, there)
    rng = np.random.default_rng(3)
    for one, other in ((here, there), (here.freed(), there.freed()), (here.richer(), there.richer())):
        assert (one is None) == (other is None)
        if one is None or other is None:
            continue
        for name in ("parameters_on", "missing", "unfit", "starts", "absent", "to_be_expected", "supposed"):
            same(getattr(one, name)(data), getattr(other, name)(data))
        assert (other.supposed(data) is data) == (one.supposed(data) is data)
        size = len(one.parameters)
        for _ in range(3):
            values = np.array([p.default + p.scale * rng.uniform() for p in one.parameters])
            model = np.append(TRUTH, values)
            same((Model(FlatPunch()) + one).state(model, data), (Model(FlatPunch()) + other).state(model, data))
            same(one.of_modulus(values), other.of_modulus(values))
            same(one.richer_starts(values), other.richer_starts(values))
        assert size == len(other.parameters)
    same(here.in_picture(data), there.in_picture(data))
    there._process._end()  # type: ignore[attr-defined]
    same(here.starts(data), there.starts(data))


STUBBORN = """
import os, time
open(PID, "w").write(str(os.getpid()))
while True:
    try:
        time.sleep(60)
    except:
        pass
"""


KILLED = pytest.param("SIGKILL", -9, marks=pytest.mark.slow)


@pytest.mark.parametrize(("number", "code"), [("SIGTERM", 143), KILLED])
def test_a_stubborn_effect_does_not_keep_the_command_from_ending(tmp_path: Path, number: str, code: int) -> None:
    file, pid = tmp_path / "mine.py", tmp_path / "pid"
    file.write_text(STUBBORN.replace("PID", repr(str(pid))))
    words = ("compare", SAMPLE, "--with", file, "--out", tmp_path / "out")
    with subprocess.Popen([sys.executable, "-m", "tactilevision", *words], stdout=subprocess.DEVNULL) as run:
        until = time.monotonic() + 60
        while not (pid.exists() and pid.read_text()) and time.monotonic() < until:
            time.sleep(0.05)
        run.send_signal(getattr(signal, number))
        assert run.wait(5) == code
    until = time.monotonic() + 5
    while (lives := Path(f"/proc/{pid.read_text()}").exists()) and time.monotonic() < until:
        time.sleep(0.05)
    assert not lives
    assert not (tmp_path / "out" / "comparison.json").exists()


def test_an_effect_that_ends_its_process_is_named_and_may_be_called_again(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    new_effect(file, "my_effect")
    text = file.read_text().replace(
        "        share =", "        if values[0] > 0.4:\n            os._exit(3)\n        share ="
    )
    file.write_text(text.replace("import annotations\n", "import annotations\nimport os\n"))
    effect, data = load_effect(file), presses(4)
    free = effect.freed()
    state = MODEL.state(TRUTH, data)
    before = free.apply(state, np.array([0.1]), data).force_N
    with pytest.raises(InputError, match="ended its process"):
        effect.apply(state, np.array([0.5]), data)
    np.testing.assert_array_equal(free.apply(state, np.array([0.1]), data).force_N, before)
    with pytest.raises(pickle.PicklingError):
        pickle.dumps(effect)


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
    command = "tactilevision compare 'a b.rec' --with depth_zero --with 'my effect.py' --out 'o u t'\n"
    assert history.script("o u t").endswith(command)
    with pytest.raises(InputError, match="undo"):
        History(()).undo()
    (tmp_path / "bad.json").write_text("{}")
    with pytest.raises(InputError, match="no history"):
        load_history(tmp_path / "bad.json")
    with pytest.raises(InputError, match="no history of an analysis here"):
        load_history(tmp_path / "nowhere" / "history.json")
