"""First contacts that know the law of other presses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactilevision.press.force_readings import ContactPoint
from tactilevision.press.indenter_travel import shared_contact_law

PACE = 0.25
B1, B2 = 3.0, 0.9
NOISE = 0.0125


def contact(rng: np.random.Generator, top_mm: float, *, gain: float = 1.0, bend: float = 1.0) -> ContactPoint:
    """What a fit of one ramp to `top_mm` at 200 Hz finds, true zero at 0 s: linear errors about the truth."""
    time = np.arange(0.0, top_mm / PACE, 0.005)
    law = gain * np.array([B1 * PACE, bend * B2 * PACE**2])
    jacobian = np.column_stack([-(law[0] + 2 * law[1] * time), time, time**2])
    covariance = NOISE**2 * np.linalg.inv(jacobian.T @ jacobian)
    zero, *found = rng.multivariate_normal([0.0, *law], covariance)
    return ContactPoint(float(zero), float(np.sqrt(covariance[0, 0])), np.array(found), covariance)


def together(rng: np.random.Generator, scatter: float) -> dict[str, ContactPoint]:
    tops = [0.14, 0.27, 0.36, 0.45] * 3
    return {str(k): contact(rng, top, gain=1 + scatter * rng.standard_normal()) for k, top in enumerate(tops)}


def test_zeros_sharpen_and_say_by_how_much() -> None:
    for scatter in (0.0, 0.003, 0.01):
        alone, shared, stated = [], [], []
        for seed in range(40):
            found = together(np.random.default_rng(seed), scatter)
            known = shared_contact_law(found, dict.fromkeys(found, PACE))
            alone += [one.time_s for one in found.values()]
            shared += [one.time_s for one in known.values()]
            stated += [np.hypot(one.std_s, one.shared_s) for one in known.values()]
        assert np.std(shared) < (0.6 if scatter < 0.005 else 0.8) * np.std(alone)
        assert 0.75 < np.std(shared) / np.sqrt(np.mean(np.square(stated))) < 1.3
        assert abs(np.mean(shared)) < 0.1 * np.std(alone)


def test_what_the_common_law_leaves_open_moves_all_zeros_alike() -> None:
    means, stated = [], []
    for seed in range(60):
        found = together(np.random.default_rng(seed), 0.002)
        known = shared_contact_law(found, dict.fromkeys(found, PACE)).values()
        means.append(np.mean([one.time_s for one in known]))
        own = np.mean([one.std_s**2 for one in known]) / len(found)
        stated.append(np.sqrt(own + np.mean([one.shared_s for one in known]) ** 2))
    assert 0.7 < np.std(means) / np.mean(stated) < 1.4


def test_presses_of_another_law_or_too_few_keep_their_own() -> None:
    rng = np.random.default_rng(1)
    mixed = together(rng, 0.0) | {f"x{k}": contact(rng, 0.45, bend=3.0) for k in range(6)}
    assert shared_contact_law(mixed, dict.fromkeys(mixed, PACE)) == mixed
    few = dict(list(together(rng, 0.0).items())[:2])
    assert shared_contact_law(few, dict.fromkeys(few, PACE)) == few
    paced = together(rng, 0.0)
    uneven = {name: PACE * (1.5 if int(name) % 2 else 1.0) for name in paced}
    assert shared_contact_law(paced, uneven) == paced


def test_without_noise_nothing_moves() -> None:
    exact = {
        name: replace(one, time_s=0.0, law=np.array([B1 * PACE, B2 * PACE**2]))
        for name, one in together(np.random.default_rng(0), 0.0).items()
    }
    known = shared_contact_law(exact, dict.fromkeys(exact, PACE))
    assert max(abs(one.time_s) for one in known.values()) < 1e-12
