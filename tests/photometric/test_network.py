"""The network that is trained on ball presses: same protocol, same every time, right where the balls were."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from lamp_room import MM_PER_PX, SHAPE, ball, flat, picture, presses
from shared_scenes import shared

from tactilevision.errors import InputError
from tactilevision.photometric.ball_detection import Ball
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.ball_samples import Samples
from tactilevision.photometric.calibrate import Calibration, calibrate_from_balls
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.methods.network import Network
from tactilevision.photometric.network_training import NetworkFitter, augmented, fit_network
from tactilevision.photometric.random_lights import (
    LIGHT_KINDS,
    Surfaces,
    draw_places,
    draw_samples,
    draw_scenes,
    draw_surfaces,
    lit_share,
    shade,
)
from tactilevision.photometric.reference import make_reference
from tactilevision.photometric.storage import load_method, save_method
from tactilevision.synthetic.gel import Grid, Prescribed
from tactilevision.synthetic.lights import Strip, visibility

SCALE = (MM_PER_PX, MM_PER_PX)


@lru_cache
@shared
def calibrated() -> Calibration:
    rng = np.random.default_rng(0)
    reference = make_reference([flat(rng) for _ in range(3)])
    shots = [
        BallPicture(picture(*ball(centre, contact, 4.0)[1:], rng), 4.0) for centre, contact in presses(12, rng)
    ]
    return calibrate_from_balls(reference, shots, mm_per_px=SCALE, fit=NetworkFitter(steps=60))


def linear(count: int) -> tuple[Samples, Samples]:
    """Samples of gel whose colours change in proportion to its slopes, everywhere alike."""
    rng = np.random.default_rng(count)
    slopes = rng.uniform(-0.5, 0.5, (count, 2))
    place = rng.uniform(-1, 1, (count, 2))
    matrix = np.array([[1.0, -0.4, -0.5], [0.1, 0.8, -0.7]])
    number = np.arange(count) % 5
    change = slopes @ matrix + rng.normal(0, 0.01, (count, 3))
    rest = Samples(rng.normal(0, 0.01, (count, 3)), place, np.zeros((count, 2)), number)
    return Samples(change, place, slopes, number), rest


def test_slopes_of_balls_never_seen() -> None:
    calibration = calibrated()
    assert calibration.direction_error_deg < 8.0  # trained briefly
    rng = np.random.default_rng(9)
    _, p, q = ball((1.5, -1.0), 1.7, 4.0)
    slopes = calibration.method.slopes(picture(p, q, rng))
    inside = np.hypot(p, q) > 0.1
    gain = np.sum(slopes.dz_dx * p + slopes.dz_dy * q, where=inside) / np.sum(p**2 + q**2, where=inside)
    assert gain == pytest.approx(1.0, abs=0.06)
    rest = calibration.method.slopes(flat(rng))
    assert float(np.median(np.hypot(rest.dz_dx, rest.dz_dy))) < 0.05


def test_no_change_of_colour_is_no_slope_whatever_the_weights() -> None:
    network = fit_network(*linear(200), steps=3)
    found = network.at(np.zeros((50, 3)), np.random.default_rng(0).uniform(-1, 1, (50, 2)))
    assert np.array_equal(found, np.zeros((50, 2)))


def test_a_proportional_law_is_recovered_and_its_noise_with_it() -> None:
    contact, rest = linear(3000)
    network = fit_network(contact, rest, steps=250)
    unseen, _ = linear(2000)
    assert np.sqrt(np.mean((network.at(unseen.change, unseen.place) - unseen.slopes) ** 2)) < 0.02
    evaluate = network.evaluator((40, 50))
    stated = evaluate.noise(np.full((3, 40, 50), 0.01, np.float32))
    drawn = np.random.default_rng(1).normal(0, 0.01, (3, 40, 50)).astype(np.float32)
    assert np.std(np.stack(evaluate(drawn))) == pytest.approx(float(stated.mean()), rel=0.15)


def test_pixels_and_pictures_agree_whatever_the_strips() -> None:
    law = calibrated().method.law
    change = np.random.default_rng(0).normal(0, 0.2, (3, *SHAPE)).astype(np.float32)
    p, q = law.evaluator(SHAPE)(change)
    y, x = np.meshgrid(np.linspace(-1, 1, SHAPE[0]), np.linspace(-1, 1, SHAPE[1]), indexing="ij")
    at = law.at(change.reshape(3, -1).T.astype(float), np.stack([x.ravel(), y.ravel()], axis=1))
    assert np.allclose(np.stack([p.ravel(), q.ravel()], axis=1), at, atol=1e-5)


def test_the_same_samples_give_the_same_network() -> None:
    import torch

    first = fit_network(*linear(500), steps=20)
    torch.manual_seed(5)
    torch.rand(3)
    before = torch.get_rng_state()
    assert fit_network(*linear(500), steps=20).sha256 == first.sha256
    assert torch.equal(torch.get_rng_state(), before), "the caller's random numbers are left alone"


def test_augmented_pictures_keep_colours_and_slopes_together() -> None:
    rng = np.random.default_rng(3)
    reference = make_reference([flat(rng) for _ in range(3)])
    change = ColourChange(reference)
    _, p, q = ball((0.0, 0.0), 1.8, 4.0)
    shot = picture(p, q, rng)
    true = Ball(((SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2), 1.8 / MM_PER_PX, 4.0)
    more = augmented(change, shot, ball=true, mm_per_px=SCALE, number=7, most=2000)
    assert len(more.press) > 1000
    assert set(more.press) == {7}
    assert np.hypot(*more.slopes.T).max() < 0.55
    # one law explains both: fitted to the picture as it is, it reads the augmented ones nearly as well
    seen = change.measure(shot)[0].transpose(1, 2, 0)
    inside = np.hypot(p, q) < 0.45
    terms = np.concatenate([seen, seen**2], axis=2)[inside].astype(float)
    weights = np.linalg.lstsq(terms, np.stack([p, q], -1)[inside], rcond=None)[0]
    found = np.concatenate([more.change, more.change**2], axis=1) @ weights
    assert np.sqrt(np.mean((found - more.slopes) ** 2)) < 0.08


def test_it_survives_the_disk_and_nothing_else(tmp_path: Path) -> None:
    method = calibrated().method
    path = save_method(method, tmp_path / "finger.npz")
    frame = flat(np.random.default_rng(6))
    assert np.array_equal(method.slopes(frame).dz_dx, load_method(path).slopes(frame).dz_dx)
    card = json.loads(path.with_suffix(".json").read_text())
    assert isinstance(method.law, Network)
    assert card["onnx_sha256"] == method.law.sha256
    network = path.with_suffix(".onnx")
    content = network.read_bytes()
    network.write_bytes(content[:-40])
    with pytest.raises(InputError, match="does not match its card"):
        load_method(path)
    network.unlink()
    with pytest.raises(InputError, match="network is missing"):
        load_method(path)


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    import torch

    from tactilevision.photometric.methods.network import export_network

    path = save_method(calibrated().method, tmp_path / "finger.npz")
    strange = export_network(
        torch.nn.Conv2d(3, 2, 1),
        torch.zeros(1, 3, 4, 4),
        path=path.with_suffix(".onnx"),
        free_axes={2: "r", 3: "c"},
    )
    card = json.loads(path.with_suffix(".json").read_text()) | {"onnx_sha256": strange}
    path.with_suffix(".json").write_text(json.dumps(card))
    with pytest.raises(InputError, match="does not fit its use"):
        load_method(path)


def test_drawn_gel_is_lit_as_it_should_be() -> None:
    import torch

    rng = torch.Generator().manual_seed(4)
    torch.manual_seed(4)
    scenes = draw_scenes(32, rng, LIGHT_KINDS["gelslim3"])
    centre = torch.zeros(32, 1, 2)
    tilted = {
        name: torch.tensor(s).expand(32, 1, 2)
        for name, s in {"flat": (0.0, 0.0), "left": (0.3, 0.0), "up": (0.0, 0.3)}.items()
    }
    light = {name: shade(scenes, centre, slopes=s)[:, 0] for name, s in tilted.items()}
    # gel that rises towards the camera to the right turns its face to the left, where green comes from
    assert (light["left"][:, 1] > light["flat"][:, 1]).float().mean() > 0.9
    assert (light["left"][:, 0] < light["flat"][:, 0]).float().mean() > 0.8
    # and downwards: up, where blue comes from
    assert (light["up"][:, 2] > light["flat"][:, 2]).float().mean() > 0.8
    assert (light["up"][:, 0] < light["flat"][:, 0]).float().mean() > 0.8


def test_lamps_of_other_kinds_stand_where_they_are_said_to() -> None:
    """Gel that faces a lamp is brighter in its colour: Mini's red above, DIGIT's blue below."""
    import torch

    for kind, colour, up in (("gelsight_mini", 0, 0.3), ("digit", 2, -0.3)):
        rng = torch.Generator().manual_seed(4)
        torch.manual_seed(4)
        scenes = draw_scenes(32, rng, LIGHT_KINDS[kind])
        level, tilted = (torch.tensor(s).expand(32, 1, 2) for s in ((0.0, 0.0), (0.0, up)))
        flat_light, facing = (
            shade(scenes, torch.zeros(32, 1, 2), slopes=s)[:, 0, colour] for s in (level, tilted)
        )
        assert (facing > flat_light).float().mean() > 0.8


def one_of_each() -> Surfaces:
    """A ball of 4 mm, 1.6 mm in contact, and a bar with a fillet, each in the middle of its own picture."""
    import torch

    numbers = {"flat": (0.0, 1.0), "width": (1.6, 0.3), "radius": (4.0, 0.4), "sink": (0.5, 0.4)}
    return Surfaces(
        middle=torch.zeros(1, 2, 2),
        half=torch.tensor([[[0.0, 0.0], [1.5, 2.0]]]),
        **{name: torch.tensor([pair]) for name, pair in numbers.items()},
    )


def test_slopes_of_drawn_surfaces_are_those_of_their_heights() -> None:
    import torch

    drawn = draw_surfaces(16, torch.Generator().manual_seed(3), (20.0, 15.0))
    at = draw_places(drawn, 50, torch.Generator().manual_seed(4), (20.0, 15.0)).double()
    step = 1e-3
    for axis in range(2):
        off = step * torch.eye(2, dtype=torch.float64)[axis]
        rise = (drawn.height(at + off) - drawn.height(at - off)) / (2 * step)
        error = (rise - drawn.slopes(at)[..., axis]).abs()
        assert error.quantile(0.98) < 0.01  # a ridge of a segment has no slope
    assert (at.abs() <= torch.tensor([10.0, 7.5])).all()


def test_drawn_surfaces_cast_the_simulator_s_shadows() -> None:
    """Beside synthetic/lights.py, which was held against a path tracer."""
    import torch

    drawn, lamp, upright = one_of_each(), (-20.0, 6.0, 5.0), 2.0
    grid = Grid(np.linspace(-6.0, 6.0, 121), np.linspace(-6.0, 6.0, 121))
    x, y = grid.places()
    at = torch.as_tensor(np.stack([x, y], -1)).reshape(1, 1, -1, 2).expand(1, 2, -1, 2)
    heights = drawn.height(at).reshape(2, *x.shape).numpy()
    share = lit_share(drawn, at, torch.tensor([[lamp]]), torch.tensor([[upright]]))[0, ..., 0].reshape(2, *x.shape)
    strip = Strip(lamp, (0.0, 0.0, 0.0), 0.01, upright, 1.0, (1.0, 1.0, 1.0))
    for mine, height in zip(share.numpy(), heights, strict=True):
        theirs = visibility([strip], Prescribed(height.astype(float), grid), grid)[0]
        assert (theirs < 0.5).sum() > 30
        assert np.sqrt(np.mean((mine - theirs)[theirs < 0.95] ** 2)) < 0.12
        assert np.mean(np.abs(mine - theirs)) < 0.01


def test_slopes_of_the_median_light_are_as_steep_as_they_are() -> None:
    """Lights that differ in strength: the best mean square is flat, the unbiased network is not."""
    contact, rest = linear(6000)
    strength = np.array([0.5, 0.7, 1.0, 1.4, 2.0])[contact.press]
    mixed = dataclasses.replace(contact, change=contact.change * strength[:, None])
    network = fit_network(mixed, rest, steps=150, unbiased=True)
    found = network.at(mixed.change, mixed.place)
    gains = [
        float(np.sum(found[at] * mixed.slopes[at]) / np.sum(mixed.slopes[at] ** 2))
        for at in (mixed.press == number for number in range(5))
    ]
    assert np.median(gains) == pytest.approx(1.0, abs=1e-3)


def test_samples_of_drawn_lights_repeat_with_their_seed() -> None:
    first, again = draw_samples(32, 3)[0], draw_samples(32, 3)[0]
    assert np.array_equal(first.change, again.change)
    assert not np.array_equal(first.slopes[:100], draw_samples(32, 4)[0].slopes[:100])


def test_without_the_exporter_it_is_told_before_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    change = ColourChange(make_reference([flat(np.random.default_rng(0))]))
    with pytest.raises(InputError, match=r"package onnx.*Install onnx"):
        NetworkFitter().prepared(change, [], [], SCALE)


def test_importing_photometry_loads_nothing_heavy() -> None:
    heavy = "{'torch', 'kornia', 'onnxruntime'}"
    code = f"import sys, tactilevision.heightmap.build; print(*{heavy} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == []
