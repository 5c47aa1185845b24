"""Two lights of the drift benchmark: depths, and what their deviations say, stay as good as they are."""

from __future__ import annotations

import pytest

from benchmarks.light_drift import Observability, read_light


@pytest.mark.slow
def test_depths_and_deviations_under_drift_stay_as_good_as_they_are() -> None:
    """Of balls 68 and 95 % should lie within one and two deviations; two lights leave room for chance."""
    plain, strange = Observability(), Observability()
    for seed in (2101, 2102):
        read_light(seed, plain, strange)
    # steps were within .026 until walls counted with the attached shadow, which faces of a path tracer ask for
    for told, most, least in ((plain, (0.013, 0.034), (0.6, 0.94)), (strange, (0.035, 0.06), (0.45, 0.8))):
        rms, _, under, under_two, beside, beside_two = told.of("balls")
        assert rms < most[0]
        assert least[0] < min(under, beside) <= max(under, beside) < 0.96
        assert min(under_two, beside_two) > least[1]
        assert told.of("steps")[0] < most[1]
