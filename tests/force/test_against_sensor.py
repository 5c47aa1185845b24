"""Forces by pictures next to a force sensor's readings: what was planted is found, and nothing else.

The camera's displacements come from one transform of the whole plane and the readings from the integral of the
traction, so nothing of the inverse step is in the truth.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from each import each

from benchmarks.force_readings import GEL, MATERIAL, PROTOCOL, SCALE, Truth, make, solved, step
from calibration.diagnosis.score_test import effect_directions, score_test
from calibration.effects import EFFECTS, effects_for
from calibration.inputs.gather import observe_curves
from calibration.inputs.observations import Measured, Observations
from calibration.laws.resultant import Resultant
from calibration.model.composition import Model
from calibration.report.diagnosis_report import resultant_sentences
from calibration.tasks.compare import plain_law, rms_of_presses, with_effect
from calibration.tasks.diagnose import diagnose
from tactilevision.force.comparison import write_comparison
from tactilevision.force.field import CUT, ForceField
from tactilevision.force.frame import FrameForce, as_force
from tactilevision.recording.model import Recording
from tactilevision.recording.read import read_recording
from tactilevision.records.maps import Frame
from tactilevision.records.rig import Sensor

FEW = tuple(
    replace(kind, place_mm=PROTOCOL[k % 3].place_mm) for k, kind in enumerate(PROTOCOL) if kind.radius_mm > 1
)
# of each radius one in the middle and one whose third lies beyond the border of the picture
CUT_TOO = tuple(
    replace(kind, place_mm=(10.26 - 0.4 * kind.radius_mm, 0.0) if k % 2 else kind.place_mm)
    for k, kind in enumerate(FEW)
)
SAMPLE = Path(__file__).parents[2] / "sample_frames" / "hidden_force"


@cache
def seen(truth: Truth = Truth(), *, cut: bool = False) -> Observations:  # noqa: B008 - frozen
    with TemporaryDirectory() as folder:
        made = make(Path(folder) / "made", truth, protocol=CUT_TOO if cut else FEW, seed=3)
        recording = read_recording(made)
        return observe_curves(Measured(recording, curves=recording.curves))


def test_clean_forces_have_nothing_significant() -> None:
    fitted = plain_law(seen()).models[0].fitted
    found = score_test(fitted, effects_for(seen()), rng=np.random.default_rng(0), draws=99)
    assert found.family_p > 0.05
    E = fitted.estimate("youngs_modulus_MPa")
    assert E.interval95 is not None
    assert E.interval95[0] < MATERIAL.youngs_modulus_MPa < E.interval95[1]


@each(
    "key, truth, value, tolerance",
    [
        ("clock_offset", Truth(clock_s=0.06), 0.06, 0.01),
        ("modulus_change", Truth(modulus=0.85), -0.15, 0.05),
        ("thickness", Truth(thickness=1.2), 0.2, 0.06),
    ],
)
def test_a_planted_fault_is_significant_and_adding_it_lowers_the_error(
    key: str, truth: Truth, value: float, tolerance: float
) -> None:
    found = plain_law(seen(truth))
    effect = EFFECTS[key].freed()
    tested = score_test(found.models[0].fitted, [effect], rng=np.random.default_rng(0), draws=99)
    assert tested.effects[0].p_adjusted < 0.05
    added = with_effect(found, effect).models
    assert added[-1].effects == (key,)
    first = f"{key}.{effect.parameters[0].name}"
    assert dict(added[-1].parameters)[first].value == pytest.approx(value, abs=tolerance)
    assert added[-1].fitted.chi2 < added[0].fitted.chi2 - 6
    if key == "clock_offset":  # E takes up most of the others, at its prior's cost
        assert added[-1].held_out_N < 0.8 * added[0].held_out_N


def test_force_beyond_the_border_is_named_and_its_presses_get_nearer() -> None:
    data = seen(cut=True)
    found = plain_law(data)
    beyond = data.resultants is not None and data.resultants.cut[data.first] > 0
    tested = score_test(found.models[0].fitted, [EFFECTS["cut_contact"]], rng=np.random.default_rng(0), draws=99)
    assert tested.effects[0].p_adjusted < 0.05
    before, after = (
        rms_of_presses(one.fitted)[beyond].max() for one in with_effect(found, EFFECTS["cut_contact"]).models
    )
    assert after < before < 0.01, "the rings of the contact take up most of the force beyond"


def test_thickness_by_its_slope_is_the_inverse_step_at_another_thickness() -> None:
    data = seen()
    deepest = int(np.argmax(data.depth_mm))
    kind = replace(FEW[int(data.press[deepest])], ramp_s=0.0)
    maps, row = solved(kind, GEL.thickness_mm, False)[-1]
    gel = replace(GEL, thickness_mm=1.05 * GEL.thickness_mm)
    thicker = ForceField(gel, MATERIAL, SCALE, settings=step().settings)
    expected = thicker(maps.height, maps.shear).resultant_N[2] / row.resultant_N[2]
    model = Model(Resultant()) + EFFECTS["thickness"]
    values = model.defaults(data)
    ratio = model.predict(np.append(values[:-1], 0.05), data) / model.predict(values, data)
    assert ratio[deepest] == pytest.approx(expected, rel=0.006)
    assert expected < 0.99


def test_effects_of_a_punch_say_why_they_do_not_apply() -> None:
    fitted = plain_law(seen()).models[0].fitted
    _, why = effect_directions(fitted, effects_for(seen()))
    for key in ("tilt", "edge_fillet", "skin", "friction", "adhesion"):
        assert "from the picture" in why[key]
    assert "no contact is cut" in why["cut_contact"]
    punch = replace(seen(), resultants=None)
    assert not {"cut_contact", "modulus_change"} & {effect.key for effect in effects_for(punch)}


def test_contacts_of_a_recording_without_presses_are_taken_from_the_frames(tmp_path: Path) -> None:
    kind = replace(FEW[0], ramp_s=0.0)
    maps, row = solved(kind, GEL.thickness_mm, False)[-1]
    free = FrameForce("", 0.0, (0.0, 0.0, 0.0), flags="no contact", measured_N=(0.0, 0.0, 0.1))
    touching = replace(row, measured_N=(0.0, 0.0, row.resultant_N[2] + 0.1))
    rows = [
        replace(touching if k % 8 > 2 else free, frame=f"{k}", time_s=0.1 * k, depth_mm=0.01 * (k % 8))
        for k in range(24)
    ]
    sensor = Sensor("custom", 120, 90, SCALE, gel=GEL)
    recording = Recording(path=tmp_path, name="free", sensor=sensor)
    written = write_comparison(
        recording, rows, step(), folder=tmp_path / "beside", maps=lambda number: (maps.height, maps.shear)
    )
    assert written is not None
    again = read_recording(written)
    assert [len(curve.time_s) for curve in again.curves] == [5, 5, 5]
    assert again.sensor.gel is not None
    assert again.sensor.gel.youngs_modulus_MPa == MATERIAL.youngs_modulus_MPa


def test_the_share_of_an_outline_on_the_border_is_that_of_the_contact() -> None:
    maps, whole = solved(replace(FEW[0], ramp_s=0.0), GEL.thickness_mm, False)[-1]
    assert whole.cut == 0
    half = np.zeros_like(maps.found.t_z)
    half[:4, 6:10] = 1.0  # 4 of the 12 cells of its outline lie on the border, and 4 beside it
    found = as_force(replace(maps.found, t_z=half, flags=(CUT,)), Frame(np.zeros((1, 1, 3), np.uint8)))
    assert found.cut == pytest.approx(4 / 12)


@pytest.mark.slow
def test_the_sample_gives_what_is_hidden_in_it() -> None:
    recording = read_recording(SAMPLE)
    found = diagnose(observe_curves(Measured(recording, curves=recording.curves)), np.random.default_rng(0))
    assert found.verdict == "AMBIGUOUS", "a height map off by a factor has the same form as another E"
    assert {"clock_offset", "modulus_change", "photometric_gain"} <= set(found.candidates)
    assert found.errors.held_out_N[-1] < 0.75 * found.errors.held_out_N[0]
    first, verdict, *_ = resultant_sentences(found)
    assert "mN rms" in first
    assert "loading or unloading" in first
    assert verdict.startswith("AMBIGUOUS")
    low, high = found.material.after.youngs_modulus.interval95 or (0, 0)
    assert low < 0.88 * MATERIAL.youngs_modulus_MPa < high
