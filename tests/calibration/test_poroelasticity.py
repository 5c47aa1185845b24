"""A gel that drains relaxes in a time that goes as the radius squared; one that relaxes has one for all radii."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from each import each
from made_presses import indenter, observations

from calibration.diagnosis.constant_parameters import varying
from calibration.diagnosis.forward_selection import Searched, forward_selection
from calibration.effects import EFFECTS
from calibration.fit.least_squares import fit
from calibration.fit.repeats import refit_with_pure_noise
from calibration.inputs.observations import Observations
from calibration.laws.flat_punch import FlatPunch
from calibration.model.composition import Model
from tactilevision.records.measured import Floats

MODEL = Model(FlatPunch())
TRUTH = np.array([0.25, 0.48, 0.85, 0.85])
SMALL, LARGE = 1.0, 2.5  # mm, radii
SHARE, DIFFUSIVITY = 0.2, 0.4
FINE = 40  # steps of the integral between two samples


def drained(x: Floats) -> Floats:
    """g of a cylindrical punch (Hu, Zhao, Vlassak, Suo, Appl. Phys. Lett. 96 (2010) 121904)."""
    return np.asarray(1.304 * np.exp(-np.sqrt(x)) - 0.304 * np.exp(-0.254 * x))


def holds(count: int = 12) -> Observations:
    """Ramps at .1 and 1 mm/s and holds of 15 s, with two radii by turns."""
    ramp, depths, times = np.linspace(0.0, 0.5, 12), [], []
    for k in range(count):
        up = 300.0 * k + ramp / (0.1, 1.0)[k // 2 % 2]
        depths.append(np.concatenate([ramp, np.full(10, 0.5)]))
        times.append(np.concatenate([up, up[-1] + np.geomspace(0.1, 15, 10)]))
    kinds = [indenter("small", SMALL), indenter("large", LARGE)] * (count // 2)
    data = observations(depths, kinds, time_s=times, phase=[["load"] * 12 + ["hold"] * 10] * count)
    return replace(data, presses=replace(data.presses, speed_mm_s=np.resize([0.1, 0.1, 1.0, 1.0], count)))


def relaxing(data: Observations, seed: int, *, goes_as: int, times_s: tuple[float, ...] = (3.0,)) -> Observations:
    """Measured forces of a gel whose time goes as this power of the radius: 2 drains, 0 relaxes at these times."""
    elastic, force = MODEL.predict(TRUTH, data), np.zeros(data.size)
    rng = np.random.default_rng(seed)
    for one in data.spans:
        path, times = elastic[one], data.time_s[one]
        along = np.linspace(0, path.size - 1, FINE * (path.size - 1) + 1)
        fine, when = (np.interp(along, np.arange(path.size), values) for values in (path, times))
        since = times[:, None] - (when[1:] + when[:-1]) / 2
        if goes_as:
            left = drained(np.maximum(since, 0) * DIFFUSIVITY / data.radius_mm[one][0] ** goes_as)
        else:
            left = np.mean([np.exp(-np.maximum(since, 0) / tau) for tau in times_s], axis=0)
        force[one] = np.sum(np.where(since > 0, 1 - SHARE + SHARE * left, 0.0) * np.diff(fine), axis=1)
    gain = 1 + 0.003 * rng.standard_normal(data.count)
    return data.with_force(force * gain[data.press] + 0.004 * rng.standard_normal(data.size))


def searched(data: Observations, among: tuple[str, ...] = ("viscoelasticity", "poroelasticity")) -> Searched:
    """The search on these data for these effects."""
    base = refit_with_pure_noise(fit(MODEL, data))
    return forward_selection(base, [EFFECTS[key] for key in among], rng=np.random.default_rng(0), level=0.05)


@each("radius", [SMALL, LARGE])
def test_after_a_step_the_force_falls_as_the_paper_says(radius: float) -> None:
    time = np.concatenate([[0.0, 1e-6], np.geomspace(0.02, 200, 60)])
    depth = np.concatenate([[0.0], np.full(61, 0.4)])
    data = observations([depth], [indenter("one", radius)], time_s=[time])
    elastic = MODEL.predict(TRUTH[:3], data)[1:]
    force = (MODEL + EFFECTS["poroelasticity"]).predict(np.append(TRUTH[:3], [SHARE, DIFFUSIVITY]), data)[1:]
    expected = drained(time[1:] * DIFFUSIVITY / radius**2)
    np.testing.assert_allclose((force / elastic - 1 + SHARE) / SHARE, expected, atol=4e-3)


def test_a_gel_that_drains_is_not_taken_for_one_that_relaxes() -> None:
    found = searched(relaxing(holds(), 1, goes_as=2))
    assert [step.best.effect.key for step in found.steps] == ["poroelasticity"]
    assert found.current.estimate("poroelasticity.diffusivity_mm2_s").value == pytest.approx(DIFFUSIVITY, rel=0.15)
    assert found.current.estimate("poroelasticity.fraction").value == pytest.approx(SHARE, rel=0.1)
    assert varying(found.current, found.last.covariates, level=0.05) == ()


def test_with_one_radius_it_may_be_either() -> None:
    data = relaxing(holds(), 1, goes_as=2)
    (step,) = searched(data.take(data.presses.radius_mm == LARGE)).steps
    assert {c.effect.key for c in step.equals} == {"poroelasticity", "viscoelasticity"}


def test_without_that_effect_the_times_of_the_two_radii_are_stated() -> None:
    found = searched(relaxing(holds(), 1, goes_as=2), ("viscoelasticity",))
    one = varying(found.current, found.last.covariates, level=0.05)[0]
    assert (one.effect, one.parameter, one.covariate, one.ends) == (
        "viscoelasticity",
        "tau_s",
        "a",
        (SMALL, LARGE),
    )
    assert 1.8 < one.ratio < (LARGE / SMALL) ** 2


@pytest.mark.parametrize("times_s", [(3.0,), pytest.param((0.15, 1.5, 15.0), marks=pytest.mark.slow)])
def test_a_gel_that_relaxes_over_any_range_of_times_does_not_drain(times_s: tuple[float, ...]) -> None:
    found = searched(relaxing(holds(), 1, goes_as=0, times_s=times_s))
    assert [step.best.effect.key for step in found.steps] == ["viscoelasticity"]
    assert varying(found.current, found.last.covariates, level=0.05) == ()
    if len(times_s) == 1:
        assert found.current.estimate("viscoelasticity.tau_s").value == pytest.approx(3.0, rel=0.05)
