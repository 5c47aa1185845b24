"""The rise at the bevel, seen in all presses together, at the depth of each."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from each import each

from tactilevision.mechanics.profile import touch_depth
from tactilevision.mechanics.tables.punch import profile_model
from tactilevision.press.contact_times import ContactTimes, TravelPoint, fit_travel_scale
from tactilevision.press.pile_up import press_pile_ups
from tactilevision.records.rig import Gel, Indenter

HEIGHTS_MM = (0.15, 0.3, 0.4, 0.5, 0.6)
THICKNESS_MM = 2.8
DISTANCE_MM = 5.0


def indenter(height_mm: float) -> Indenter:
    return Indenter(
        f"A{height_mm}",
        "flat_cylinder",
        radius_mm=2.5,
        height_mm=height_mm,
        bevel="right",
        bevel_distance_mm=DISTANCE_MM,
        bevel_angle_deg=10.0,
    )


def pressed(height_mm: float, rise: float) -> ContactTimes:
    """A press up to its event, its ring of gel risen by this over the depth."""
    depth, r = np.linspace(0.0, height_mm, 20), np.arange(2.5, 7.0, 0.1)
    rings = np.broadcast_to(-rise * depth[:, None, None], (depth.size, 4, r.size))
    track = SimpleNamespace(
        indenter=indenter(height_mm),
        r_mm=r,
        rings=rings,
        face_map=SimpleNamespace(std_mm=None),
        footprint=None,
        deepest=-1,
    )
    signal = SimpleNamespace(track=track, drive=depth, use=np.ones(depth.size, dtype=bool))
    contact = SimpleNamespace(distance_mm=DISTANCE_MM, distance_given=True, press_signal=signal)
    touch = SimpleNamespace(depth_seen_mm=height_mm, onset=SimpleNamespace(gain=1e3, at=2 * height_mm))
    return cast(ContactTimes, SimpleNamespace(bevel_contact=contact, touch=touch))


@each("nu", [0.42, 0.45, 0.48, 0.495])
def test_depths_keep_their_ratio_though_the_rise_grows_with_the_depth(nu: float) -> None:
    model = profile_model(nu, 2.5 / THICKNESS_MM, deepest=0.6 / THICKNESS_MM)
    truth = np.array(
        [
            touch_depth(
                indenter(height),
                thickness_mm=THICKNESS_MM,
                poisson_ratio=nu,
                poisson_ratio_std=0.0,
                model=model,
            ).depth_mm
            for height in HEIGHTS_MM
        ]
    )
    rises = np.array(HEIGHTS_MM) / truth - 1
    assert rises[-1] / rises[0] > 1.05
    events = {str(h): pressed(h, float(rises.mean())) for h in HEIGHTS_MM}
    found = press_pile_ups(events, Gel(thickness_mm=THICKNESS_MM, poisson_ratio=nu))
    depth = np.array(HEIGHTS_MM) / (1 + np.array([found[str(h)].ratio for h in HEIGHTS_MM]))
    assert np.ptp(depth / truth) < 0.002, "one rise for all depths leaves .004 to .009"

    # events that are seen without error then tell the pace, and no delay
    scale = fit_travel_scale(
        [
            TravelPoint(float(w), float(z), 0.0013, 0.003, float(6 * z), f"A{k}", 0.001)
            for k, (w, z) in enumerate(zip(depth, truth, strict=True))
        ],
        even=True,
    )
    assert scale is not None
    assert abs(scale.delay_mm) < 2.5e-4
    assert scale.travel_mm(float(depth[0]), float(6 * truth[0])) == pytest.approx(truth[0], rel=0.002)
