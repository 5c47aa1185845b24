"""One model of one recording has the same errors and the same E on the page, in `compare` and in `diagnose`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_sample import write_small

from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured
from calibration.report.diagnosis_report import materials, summary
from calibration.report.headline import DIAGNOSED, fall_sentence, modulus_lines, modulus_rows
from calibration.report.misfit import error_falls, model_names
from calibration.tasks.compare import as_comparison, compare
from calibration.tasks.diagnose import diagnose
from calibration.tasks.session import History
from calibration.workbench.analysis import Verdict
from calibration.workbench.bench import Bench
from calibration.workbench.opened import Opened
from calibration.workbench.views import state_view
from tactilevision.recording.read import read_recording


@pytest.mark.slow
def test_page_compare_and_diagnose_state_the_same_numbers(tmp_path: Path) -> None:
    recording = read_recording(write_small(tmp_path / "small"))
    measured = Measured(recording, recording.points, recording.curves)
    data = observe_curves([measured])
    found = diagnose(data, np.random.default_rng(0))
    keys = [effect.key for effect in found.effects]
    assert keys == ["viscoelasticity"]
    compared = compare(data, keys, rng=np.random.default_rng(0))
    names = model_names([model.effects for model in compared.models])
    gels = {name: model.material for name, model in zip(names, compared.models, strict=True) if model.material}
    over = found.material.after.youngs_modulus
    rows = modulus_rows(gels, over)
    assert rows == modulus_rows(materials(found), over)
    assert rows[-1].name == DIAGNOSED
    assert set(modulus_lines(materials(found), over)) == {
        line.replace(f"{names[0]} +", "+") for line in summary(found) if line.startswith("E ")
    }
    assert found.material.after.from_data("youngs_modulus") == gels[names[-1]].from_data("youngs_modulus")
    last = compared.models[-1].as_json()["youngs_modulus_MPa"]
    assert found.as_json()["unseen"]["interval95_of_E_without"] == last["interval95"]
    assert [fall_sentence(one) for one in error_falls(compared)] == [
        fall_sentence(one) for one in error_falls(as_comparison(found))
    ]
    bench = Bench(
        Opened((tmp_path,), (measured,), data),
        History((str(tmp_path),)),
        export=lambda *_: tmp_path,
        keep=lambda _: None,
        out=tmp_path,
        asks=False,
    )
    bench._known[(), tuple(keys)].verdict = Verdict("ADEQUATE", "Nothing is left.", modulus=over)
    bench.act("add", keys[0])
    bench.work(until_idle=True)
    bench._look_on()
    bench._show(stated=bench._stated(bench.shown.history, compared))
    view = state_view(bench)
    assert [(one["name"], one["modulus"], one["ratio"]) for one in view["modulus"]] == [
        (row.name, row.modulus, row.ratio) for row in rows
    ]
    assert [f"{one['lead']}. {one['note']}" for one in view["falls"]] == list(
        map(fall_sentence, error_falls(compared))
    )
    assert (
        replace(bench.shown.found(bench.opened), models=compared.models).material
        == replace(compared, over=over).material
    )
