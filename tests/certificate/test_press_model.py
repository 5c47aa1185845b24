"""The forward model of a recording: planted clocks, laws, paces and touches come back, with honest errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from each import each
from planted_presses import THICKNESS, Rig, force_of, planted

from tactilevision.press.contact_event import PressEvent, press_events
from tactilevision.press.fit import ModelFit
from tactilevision.press.recording_fit import Tracked, fit_again, fit_others, fit_recording
from tactilevision.recording.model import StageSeries
from tactilevision.records.measured import Floats, ForceSeries

HEIGHTS = (0.14, 0.27, 0.36, 0.45, 0.54)


def fitted(
    presses: Sequence[Tracked], forces: ForceSeries, offset_s: float, stage: StageSeries | None = None
) -> tuple[ModelFit, dict[str, PressEvent]]:
    fit = fit_recording(presses, forces, offset_s=offset_s + 0.01, thickness_mm=THICKNESS, stage=stage)
    return fit, press_events(fit, {one.track.press.press: one.distance_mm for one in presses})


def force_errors(presses: Sequence[Tracked], events: dict[str, PressEvent]) -> Floats:
    """Return the relative error of the force at each stated depth of touch."""
    found = []
    for one in presses:
        event = events[one.track.press.press].event
        assert event is not None
        found.append(float(event.force_N[2]) / float(force_of(one.nominal_mm)) - 1)
    return np.array(found)


@each("rate_Hz, offset_s", [(15.0, -0.15), (30.0, 0.08), (90.0, 0.0), (30.0, 5432.1)])
def test_clocks_agree_within_three_milliseconds(rate_Hz: float, offset_s: float) -> None:
    rig = Rig(offset_s=offset_s, rate_Hz=rate_Hz)
    presses, forces, _ = planted(HEIGHTS, np.random.default_rng(int(rate_Hz)), rig)
    fit, _ = fitted(presses, forces, offset_s)
    assert fit.shared[0] == pytest.approx(offset_s, abs=0.003)
    assert fit.offset_std_s < 0.003


def test_forces_and_clocks_scatter_by_their_stds() -> None:
    clocks, shared, rms = [], [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        rig = Rig(pace=1.02, give_mm_per_N=0.003, late_mm=float(rng.normal(0, 0.002)))
        presses, forces, _ = planted(HEIGHTS * 2, rng, rig, heights_off=2 * rng.normal(0, 0.001, 5).tolist())
        fit, events = fitted(presses, forces, rig.offset_s)
        clocks.append((fit.shared[0] - rig.offset_s) / fit.offset_std_s)
        errors = force_errors(presses, events)
        scale = next(iter(events.values())).scale_std
        shared.append(np.mean(errors) / (1.2 * scale))
        rms.append(np.sqrt(np.mean(errors**2)))
    assert 0.3 < np.sqrt(np.mean(np.square(clocks))) < 1.6
    assert np.sqrt(np.mean(np.square(shared))) < 1.5
    assert np.median(rms) < 0.008


def test_a_stage_gives_the_depth_of_one_height_though_its_touches_are_late() -> None:
    rig = Rig(late_mm=0.004)
    presses, forces, stage = planted([0.36] * 4, np.random.default_rng(3), rig)
    _, events = fitted(presses, forces, rig.offset_s, stage)
    assert force_errors(presses, events) == pytest.approx(np.zeros(4), abs=0.012)
    assert all(one.delay_mm == pytest.approx(0.004, abs=2.5 * one.delay_std_mm) for one in events.values())


def test_an_uneven_pace_is_no_travel() -> None:
    rig = Rig()
    presses, forces, _ = planted(HEIGHTS, np.random.default_rng(4), rig, uneven=0.3)
    fit, events = fitted(presses, forces, rig.offset_s)
    assert sum(one.way is None for one in fit.model.presses) >= 3
    for one, error in zip(presses, force_errors(presses, events), strict=True):
        event = events[one.track.press.press]
        assert abs(error) < 3 * np.hypot(1.2 * event.scale_std, 1.2 * event.zero_std_mm / one.nominal_mm)


def test_a_wrong_height_moves_its_own_touch_only() -> None:
    rig = Rig()
    presses, forces, _ = planted(
        HEIGHTS * 2, np.random.default_rng(5), rig, heights_off=[0.0] * 7 + [0.03] + [0.0] * 2
    )
    _, events = fitted(presses, forces, rig.offset_s)
    touch = events["p7"].touch
    assert touch is not None
    assert touch.onset.at == pytest.approx(0.39, abs=0.01)
    assert np.abs(np.delete(force_errors(presses, events), 7)).max() < 0.012


def test_a_zero_that_drifts_is_no_lag() -> None:
    rig = Rig(drift_N_s=0.01)
    presses, forces, _ = planted(HEIGHTS, np.random.default_rng(6), rig)
    assert fitted(presses, forces, rig.offset_s)[0].shared[0] == pytest.approx(rig.offset_s, abs=0.003)


def test_a_press_that_ends_before_its_touch_has_no_event() -> None:
    rig = Rig()
    presses, forces, _ = planted(HEIGHTS, np.random.default_rng(7), rig, heights_off=[0, 0, 0.2, 0, 0])
    _, events = fitted(presses, forces, rig.offset_s)
    assert events["p2"].event is None
    assert events["p4"].event is not None


def test_one_press_alone_is_fitted() -> None:
    rig = Rig()
    presses, forces, _ = planted([0.4], np.random.default_rng(8), rig)
    _, events = fitted(presses, forces, rig.offset_s)
    assert force_errors(presses, events) == pytest.approx([0.0], abs=0.05)


def test_presses_that_are_excluded_do_not_change_the_others() -> None:
    """All presses of the first height are excluded: the numbers of the other heights stay theirs."""
    rig = Rig()
    presses, forces, _ = planted(HEIGHTS * 2, np.random.default_rng(9), rig)
    first, _ = fitted(presses, forces, rig.offset_s)
    kept = [one for one in presses if one.nominal_mm != HEIGHTS[0]]
    final = fit_again(first, [one.track.press.press for one in kept])
    others = fit_others(first, final)
    assert [one.name for one in others.model.presses] == ["p0", "p5"]
    for fit, members in ((final, kept), (others, [one for one in presses if one not in kept])):
        events = press_events(fit, {one.track.press.press: one.distance_mm for one in members})
        assert np.abs(force_errors(members, events)).max() < 0.02
