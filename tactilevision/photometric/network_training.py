"""Train the slope network on ball presses with torch."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactilevision.photometric.ball_detection import Ball, ball_slopes
from tactilevision.photometric.ball_samples import CONTACT, INSIDE, TYPICAL, Samples, from_axis, join, places_of
from tactilevision.photometric.colour_change import ColourChange
from tactilevision.photometric.methods.network import Network, export_network, require_exporter
from tactilevision.records.measured import Bytes, Floats, Pair

if TYPE_CHECKING:
    import torch


@contextmanager
def one_core(seed: int) -> Iterator[None]:
    """Run torch (and kornia) on one core, seeded with `seed`, and restore threads and random state after.

    Sums on several cores are not reproducible, and small layers gain nothing from them.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            yield
    finally:
        torch.set_num_threads(threads)


# Training on augmented ball presses: pictures are blurred, made noisier, changed in light by some percent (as the
# drift correction leaves), moved and scaled a little, which affects neither slopes nor their colours. Flips and
# turns would. The loss is the squared error of slopes over slope^2 + TYPICAL^2, plus the slope of the untouched
# gel.

WIDTH = 16  # channels of a hidden layer; time per frame grows with its square
LAYERS = 2  # hidden layers of the perceptron
STEPS = 900  # steps of the optimiser
BATCH = 2048  # samples of balls in a step, and a quarter as many of untouched gel
RATE = 1e-2  # highest learning rate
DECAY = 1e-3  # weight decay of the optimiser; larger is smoother
SHOWN = 4  # augmented copies of each press
LIGHT_CHANGE = 0.02  # of brightness, contrast, and their gradient in augmented pictures
SHIFT = 0.05  # of their place and scale
SEED = 20261121  # of the training, arbitrary
UNTOUCHED_WEIGHT = 0.1  # of untouched gel in the loss


@dataclass(frozen=True)
class NetworkFitter:
    """Fitter of a network; `shown` are samples of the augmented pictures of the same presses."""

    shown: Samples | None = None
    steps: int = STEPS

    ridges = (DECAY,)

    def __call__(self, contact: Samples, untouched_samples: Samples, *, ridge: float) -> Network:
        """Fit a network to samples; `ridge` is the weight decay."""
        more = [] if self.shown is None else [self.shown.where(np.isin(self.shown.press, contact.press))]
        return fit_network(join([contact, *more]), untouched_samples, ridge=ridge, steps=self.steps)

    def prepared(
        self, change: ColourChange, pictures: Sequence[Bytes], balls: Sequence[Ball | None], mm_per_px: Pair
    ) -> NetworkFitter:
        """Return the fitter with augmented `pictures` (H, W, 3); `balls` are None where not found."""
        require_exporter()
        parts = [
            augmented(
                change, rgb, ball=ball, mm_per_px=mm_per_px, number=number, most=SHOWN * CONTACT // len(pictures)
            )
            for number, (rgb, ball) in enumerate(zip(pictures, balls, strict=True))
            if ball is not None
        ]
        return NetworkFitter(join(parts) if parts else None, self.steps)


def augmented(change: ColourChange, rgb: Bytes, *, ball: Ball, mm_per_px: Pair, number: int, most: int) -> Samples:
    """Return at most `most` samples of one press from SHOWN augmented pictures."""
    import torch

    changes, _, valid = change.measure(rgb)
    box = _around(ball, rgb.shape, mm_per_px)
    x, y, distance = (whole[box] for whole in from_axis(rgb.shape[:2], ball, mm_per_px))
    contact_mm = ball.contact_radius_px * mm_per_px[0]
    p, q = ball_slopes(x, y, contact_mm=contact_mm, radius_mm=ball.radius_mm)
    inside = (distance < INSIDE * contact_mm) & valid[box]
    cut = (slice(None), *box)
    grey = torch.as_tensor(np.ascontiguousarray(rgb[box].transpose(2, 0, 1)), dtype=torch.float32) / 255
    planes = torch.as_tensor(np.stack([*changes[cut], p, q, inside.astype(float)]), dtype=torch.float32)
    with one_core(SEED + number), torch.no_grad():
        light, place = _augmentations(max(change.reference.noise_grey) / 255)
        many = grey[None].expand(SHOWN, -1, -1, -1).contiguous()
        turned = 255 * (light(many) - many) * torch.as_tensor(change.scale[cut].copy())
        stack = planes[None].repeat(SHOWN, 1, 1, 1)
        stack[:, :3] += turned
        stack = place(stack)
        pixels = torch.nonzero(stack[:, 5] > 0.999)
        pixels = pixels[torch.randperm(len(pixels))[:most]]
    shot, row, column = pixels.numpy().T
    values = stack.double().numpy()[shot, :, row, column]
    at = places_of(column + box[1].start, row + box[0].start, rgb.shape[:2])
    return Samples(values[:, :3], at, values[:, 3:5], np.full(len(pixels), number))


def fit_network(
    contact: Samples,
    untouched_samples: Samples,
    *,
    ridge: float = DECAY,
    steps: int = STEPS,
    unbiased: bool = False,
) -> Network:
    """Fit a network to samples of balls and of untouched gel.

    `unbiased`: scale the slopes so that their median error over presses is zero. The least mean square alone gives
    too small slopes where the lights of the presses differ.
    """
    import torch

    with one_core(SEED):
        module = _trained(contact, untouched_samples, ridge, steps)
        if unbiased:
            _unbias(module, contact)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        export_network(module, torch.zeros(1, 5, 4, 4), path=path, free_axes={2: "rows", 3: "columns"})
        content = path.read_bytes()
    return Network(content, float(np.hypot(*contact.slopes.T).max()))


def make_module(typical_change: Floats) -> torch.nn.Module:
    """Return the untrained perceptron; relative `typical_change` (3,) scales its input."""
    import torch
    from torch import nn

    class Perceptron(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            sizes = [5, *[WIDTH] * LAYERS]
            steps = [nn.Conv2d(a, b, 1) for a, b in pairwise(sizes)]
            self.body = nn.Sequential(*[layer for step in steps for layer in (step, nn.ReLU())])
            self.last = nn.Conv2d(WIDTH, 6, 1)
            with torch.no_grad():  # all colours weigh alike at the start
                steps[0].weight[:, :3] /= torch.as_tensor(typical_change, dtype=torch.float32)[:, None, None]

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            m, u = self.last(self.body(x)), x[:, :3]
            slopes: torch.Tensor = m[:, :2] * u[:, :1] + m[:, 2:4] * u[:, 1:2] + m[:, 4:] * u[:, 2:3]
            return slopes

    return Perceptron()


def _trained(contact: Samples, untouched_samples: Samples, ridge: float, steps: int) -> torch.nn.Module:
    import torch

    pressed, still = (
        torch.as_tensor(np.concatenate([s.change, s.place], axis=1), dtype=torch.float32)
        for s in (contact, untouched_samples)
    )
    slopes = torch.as_tensor(contact.slopes, dtype=torch.float32)
    module = make_module(np.sqrt(np.mean(contact.change**2, axis=0)))
    optimiser = torch.optim.AdamW(module.parameters(), RATE, weight_decay=ridge)
    plan = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, steps)
    for _ in range(steps):
        pick = torch.randint(len(pressed), (BATCH,))
        rest = torch.randint(len(still), (BATCH // 4,))
        predicted = module(torch.cat([pressed[pick], still[rest]]).T[None, :, None])[0, :, 0].T
        error = ((predicted[:BATCH] - slopes[pick]) ** 2).sum(1) / ((slopes[pick] ** 2).sum(1) + TYPICAL**2)
        loss = error.mean() + UNTOUCHED_WEIGHT * (predicted[BATCH:] ** 2).sum(1).mean() / TYPICAL**2
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        plan.step()
    return module


def _unbias(module: torch.nn.Module, contact: Samples) -> None:
    """Scale `module` so that the median over presses of estimated over true slope is 1."""
    import torch

    inputs = torch.as_tensor(np.concatenate([contact.change, contact.place], axis=1), dtype=torch.float32)
    with torch.no_grad():
        estimated = module(inputs.T[None, :, None])[0, :, 0].T.double().numpy()
        along, power = (
            np.bincount(contact.press, np.sum(slopes * contact.slopes, axis=1))
            for slopes in (estimated, contact.slopes)
        )
        gain = float(np.median(along[power > 0] / power[power > 0]))
        for name, part in module.named_parameters():
            if name.startswith("last"):
                part.mul_(1.0 / gain)


def _augmentations(noise: float) -> tuple[torch.nn.Module, torch.nn.Module]:
    from kornia import augmentation as draw

    light = draw.AugmentationSequential(
        draw.RandomGaussianBlur((5, 5), (0.3, 0.9), p=0.5),
        draw.ColorJiggle(brightness=LIGHT_CHANGE, contrast=LIGHT_CHANGE, p=0.5),
        draw.RandomLinearIllumination(gain=(0.002, LIGHT_CHANGE), p=0.5),
        draw.RandomGaussianNoise(std=noise, p=1.0),
    )
    scale = 1 - SHIFT, 1 + SHIFT
    place = draw.AugmentationSequential(draw.RandomAffine(0.0, translate=(SHIFT, SHIFT), scale=scale, p=1.0))
    return light, place


def _around(ball: Ball, shape: tuple[int, ...], mm_per_px: Pair) -> tuple[slice, slice]:
    """Return the rows and columns around a contact, with a margin for shifts and scales."""
    reach = 1.2 * ball.contact_radius_px + 2
    reach_y = reach * mm_per_px[0] / mm_per_px[1]
    x, y = ball.centre_px
    rows = slice(max(0, int(y - reach_y)), min(shape[0], int(y + reach_y) + 1))
    return rows, slice(max(0, int(x - reach)), min(shape[1], int(x + reach) + 1))
