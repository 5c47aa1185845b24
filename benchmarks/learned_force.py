"""Force by the library beside force that is learned from pictures: on shapes of the training, on others, on
another gel and in another light.

Contacts are solved by Coulomb's law on the exact layer (stick_slip), apart from the library; the simulated camera
draws the moved gel with its ink. Learned: a ridge regression on picture and height map, and a small convolutional
network on the picture, with a deviation for each force (Gaussian likelihood). Both are trained on balls and
cylinders on one gel in one light, and subtract the untouched picture of the light at hand. The library is
calibrated on 14 balls in the training's light and told E, nu and thickness, as after a calibration of its gel.

Published networks are larger and have more frames: FEATS (Helmut et al., arXiv 2411.03315) a U-net on frames of a
GelSight Mini, 9DTact (Lin et al., arXiv 2308.14277) a DenseNet. Their weights and frames could not be had.

python -m benchmarks.learned_force [training frames] [frames of each kind] [folder that keeps frames]
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import torch

from benchmarks.force_cases import Forward, View, at_camera
from benchmarks.shear import Moved
from benchmarks.stick_slip import Contact, Indenter, Layer
from tactilevision.errors import InputError
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.heightmap.build import tuned
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.photometric.ball_pictures import BallPicture
from tactilevision.photometric.calibrate import calibrate_from_balls
from tactilevision.photometric.catalogue import PHOTOMETRIC
from tactilevision.photometric.reference import make_reference
from tactilevision.records.maps import LIGHT, MEANING, Frame
from tactilevision.records.measured import Bytes, Floats, Material
from tactilevision.records.rig import Gel
from tactilevision.sensors import get_sensor
from tactilevision.shear.displacement import Untouched, read_untouched
from tactilevision.synthetic.camera import Camera, CameraOptions, build_camera
from tactilevision.synthetic.gel import Flat, Singles
from tactilevision.synthetic.options import GelOptions
from tactilevision.synthetic.simulation import picture_still, plan_balls

POINTS, VIEW = View((120, 160), 0.171, 1), View((240, 320), 0.0855, 1)  # of the contact, of the camera
SCALE = (VIEW.mm_per_px, VIEW.mm_per_px)
WIDEST_MM = 4.0  # of the points that may touch, from the axis
TEXTURE = 0.08  # contrast of the ink, which shear is followed by
SEEN, UNSEEN = ("ball", "flat punch"), ("star", "ring", "two contacts")
SMALL, PICTURE = (24, 18), (80, 60)  # width and height of what is learned from, ridge and network
EPOCHS, BATCH, RATE = 120, 32, 2e-3
RIDGES = 10.0 ** np.arange(-5, 3)  # of the mean square of the features
LINEAR = ForceSettings(large_depth=False, cell_std=False)  # the gel is linear
Z95 = 1.96  # deviations of a 95 % interval


@dataclass(frozen=True)
class World:
    """A gel, and the seed of the light that it is seen in."""

    thickness_mm: float = 3.0
    modulus_MPa: float = 0.2
    light: int = 2101

    @property
    def gel(self) -> Gel:
        """The gel."""
        return Gel(self.thickness_mm)

    @property
    def material(self) -> Material:
        """E and nu, as a good calibration knows them."""
        return Material(self.modulus_MPa, 0.48, np.diag([(0.01 * self.modulus_MPa) ** 2, 0.003**2]))


HOME = World()
SOFT, DARK = World(2.0, 0.3), replace(HOME, light=2102)


@cache
def bench(world: World) -> tuple[Layer, Forward, Camera]:
    """What makes frames of a world."""
    options = CameraOptions(
        width_px=VIEW.shape[1],
        height_px=VIEW.shape[0],
        mm_per_px=SCALE,
        texture=TEXTURE,
        distortion_px=0.0,
        light_seed=world.light,
    )
    layer = Layer(POINTS, Forward(POINTS, world.gel, world.material), WIDEST_MM)
    return layer, Forward(VIEW, world.gel, world.material), build_camera(options, np.random.default_rng(3))


def frame(world: World, kind: str, rng: np.random.Generator) -> tuple[Bytes, Floats]:
    """A picture of a random contact, and its force (3,) N."""
    layer, forward, camera = bench(world)
    radius = rng.uniform(1.5, 3.0)
    x, y = (rng.uniform(-1, 1) * (size / 2 - radius - 3.0) for size in VIEW.size_mm)
    turned, depth = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.35)
    contact = Contact(layer, Indenter(kind, radius, depth, rng.uniform(0.3, 1.0), turned, 0.0, (x, y)), 0.0)
    for part in (0.5, 1.0):
        contact.advance(part * depth, 0.0)
    slides = 1.5 * contact.one.friction * float(contact.t[2].sum()) / contact.stuck()
    for _ in range(2):
        contact.advance(depth, slides * rng.uniform(0, 0.5))
    fine = np.asarray(np.kron(contact.state(0.0, 0.0).traction, np.ones((1, 2, 2))), dtype=np.float64)
    u = forward(fine)
    carried = np.stack([at_camera(np.stack([u[0], u[1], part]), VIEW) for part in u[:2]])
    picture = camera.picture(Moved(at_camera(u, VIEW), carried), rng)
    return picture, fine.sum(axis=(1, 2)) * VIEW.mm_per_px**2


def frames(
    world: World, kinds: Sequence[str], count: int, *, seed: int, kept: Path | None
) -> tuple[Bytes, Floats]:
    """Pictures (N, H, W, 3) and forces (N, 3), kept in a folder where one is given."""
    name = f"{'-'.join(kinds).replace(' ', '_')}-{world.thickness_mm:g}-{world.light}-{count}-{seed}.npz"
    if kept is not None and (kept / name).exists():
        with np.load(kept / name) as file:
            return file["pictures"], file["forces"]
    rows = [frame(world, kinds[k % len(kinds)], np.random.default_rng([seed, k])) for k in range(count)]
    pictures, forces = (np.stack(one) for one in zip(*rows, strict=True))
    if kept is not None:
        np.savez(kept / name, pictures=pictures, forces=forces)
    return pictures, forces


Told = tuple[Floats, Floats, Floats]  # forces (N, 3), their deviations (N, 3), whether flagged (N,)


@dataclass(frozen=True)
class Ours:
    """The library, calibrated in a world."""

    reader: Reconstructor
    untouched: Untouched
    world: World

    def __call__(self, pictures: Bytes) -> Told:
        """Forces of pictures."""
        field = ForceField(self.world.gel, self.world.material, SCALE, view_px=VIEW.shape, settings=LINEAR)
        rows = []
        for picture in pictures:
            try:
                height = self.reader.height_map(Frame(picture))
                found = field(height, self.untouched.shear(picture))
            except InputError:
                rows.append([*[np.nan] * 6, 1.0])  # refused: the picture is of another view, light or sensor
            else:
                rows.append([*found.resultant_N, *found.resultant_std_N, LIGHT in height.flags])
        table = np.array(rows, dtype=float)
        return table[:, :3], table[:, 3:6], table[:, 6]

    def depth(self, picture: Bytes) -> Floats:
        """The height map (H, W), mm; zero where the library refuses the picture."""
        try:
            return np.asarray(self.reader.height_map(Frame(picture)).depth_mm, dtype=float)
        except InputError:
            return np.zeros(VIEW.shape)


def calibrated(world: World) -> Ours:
    """The library after a user's calibration of the light on 14 balls."""
    camera, rng = bench(world)[2], np.random.default_rng(11)
    flats = [picture_still(camera, Flat(), rng=rng) for _ in range(3)]
    half = (VIEW.size_mm[0] / 2, VIEW.size_mm[1] / 2)
    presses = plan_balls(14, (4.0,), half_mm=half, gel=GelOptions(thickness_mm=world.thickness_mm), rng=rng)
    shots = [BallPicture(picture_still(camera, press, rng=rng), press.radius_mm) for press in presses]
    calibration = calibrate_from_balls(make_reference(flats), shots, mm_per_px=SCALE, fit=PHOTOMETRIC["auto"])
    sensor = get_sensor("custom", width_px=VIEW.shape[1], height_px=VIEW.shape[0], mm_per_px=SCALE[0])
    untouched = [camera.picture(Flat(), rng) for _ in range(12)]
    reader = tuned(replace(sensor, gel=world.gel), calibration, pictures=shots, free=untouched)
    return Ours(reader, read_untouched(camera.picture(Flat(), rng), SCALE), world)


def changed(pictures: Bytes, size: tuple[int, int]) -> Floats:
    """Pictures less the untouched one of the training's light, small, (N, h, w, 3), in parts of white."""
    small = [cv2.resize(one - free(HOME), size, interpolation=cv2.INTER_AREA) for one in pictures]
    return np.asarray(np.stack(small) / 255, dtype=float)


@cache
def free(world: World) -> Singles:
    """The untouched picture of a world (H, W, 3), without noise, in grey levels."""
    camera = bench(world)[2]
    return camera.expose(camera.ideal(Flat()), None).astype(np.float32)


def rebased(pictures: Bytes, world: World) -> Bytes:
    """Pictures of a world as if they had changed from the untouched one of the training's light."""
    return np.asarray(np.clip(pictures - free(world) + free(HOME), 0, 255), dtype=np.uint8)


def ridge(pictures: Bytes, forces: Floats, depth: Callable[[Bytes], Floats]) -> Callable[[Bytes], Told]:
    """Force by a linear law of picture and height map; its penalty and deviations by ten parts left out."""

    def features(pictures: Bytes) -> Floats:
        maps = np.stack([cv2.resize(depth(one), SMALL, interpolation=cv2.INTER_AREA) for one in pictures])
        parts = [changed(pictures, SMALL).reshape(len(pictures), -1), maps.reshape(len(pictures), -1)]
        return np.concatenate([one / scale for one, scale in zip(parts, scales, strict=True)], axis=1)

    scales = (1.0, 1.0)
    raw = features(pictures)
    split = 3 * SMALL[0] * SMALL[1]
    scales = (float(raw[:, :split].std()), float(raw[:, split:].std()))
    raw = np.concatenate([raw[:, :split] / scales[0], raw[:, split:] / scales[1]], axis=1)
    middle, offset = raw.mean(axis=0), forces.mean(axis=0)

    def solved(known: Floats, to: Floats, penalty: float) -> Floats:
        gram = known @ known.T
        gram.flat[:: len(gram) + 1] += penalty * len(gram) * known.shape[1]
        return np.asarray(known.T @ np.linalg.solve(gram, to))

    part = np.arange(len(forces)) % 10
    best, law_penalty, std = np.inf, RIDGES[0], np.ones(3)
    for penalty in RIDGES:
        left = np.empty_like(forces)
        for fold in range(10):
            out = part == fold
            left[out] = (raw[out] - middle) @ solved(raw[~out] - middle, forces[~out] - offset, penalty)
        error = np.sqrt(np.mean((left - (forces - offset)) ** 2, axis=0))
        if error.sum() < best:
            best, law_penalty, std = float(error.sum()), penalty, error
    law = solved(raw - middle, forces - offset, law_penalty)

    def told(pictures: Bytes) -> Told:
        found = (features(pictures) - middle) @ law + offset
        return found, np.tile(std, (len(found), 1)), np.zeros(len(found))

    return told


def network(pictures: Bytes, forces: Floats) -> Callable[[Bytes], Told]:
    """Force and its deviation by a convolutional network on the picture."""
    torch.manual_seed(1)
    torch.set_num_threads(1)
    wide = (3, 16, 32, 48, 64)
    layers: list[torch.nn.Module] = []
    for i, o in pairwise(wide):
        layers += [torch.nn.Conv2d(i, o, 3, 2, 1), torch.nn.BatchNorm2d(o), torch.nn.ReLU()]
    layers += [torch.nn.Flatten(), torch.nn.LazyLinear(64), torch.nn.ReLU(), torch.nn.Linear(64, 6)]
    model = torch.nn.Sequential(*layers)
    offset, scale = torch.tensor(forces.mean(axis=0)).float(), torch.tensor(forces.std(axis=0)).float()

    def given(pictures: Bytes) -> torch.Tensor:
        return 5 * torch.from_numpy(changed(pictures, PICTURE)).float().permute(0, 3, 1, 2)

    x, y = given(pictures), (torch.from_numpy(forces).float() - offset) / scale
    model(x[:2])
    kept = torch.arange(len(x)) % 10 == 0  # chooses the epoch
    optimizer = torch.optim.AdamW(model.parameters(), lr=RATE, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, RATE, total_steps=EPOCHS * (int((~kept).sum()) // BATCH + 1)
    )

    def loss(part: torch.Tensor, true: torch.Tensor) -> torch.Tensor:
        mean, log = model(part).chunk(2, dim=1)
        return torch.nn.functional.gaussian_nll_loss(mean, true, torch.exp(2 * log.clamp(-6, 3)))

    best, state = np.inf, model.state_dict()
    for _ in range(EPOCHS):
        model.train()
        for some in torch.split(torch.randperm(int((~kept).sum())), BATCH):
            if len(some) > 1:
                optimizer.zero_grad()
                torch.autograd.backward(loss(x[~kept][some], y[~kept][some]))
                optimizer.step()
            schedule.step()
        model.eval()
        with torch.no_grad():
            now = float(loss(x[kept], y[kept]))
        if now < best:
            best, state = now, {key: value.clone() for key, value in model.state_dict().items()}
    model.load_state_dict(state)

    def told(pictures: Bytes) -> Told:
        model.eval()
        with torch.no_grad():
            mean, log = model(given(pictures)).chunk(2, dim=1)
        found, std = mean * scale + offset, torch.exp(log.clamp(-6, 3)) * scale
        return found.double().numpy(), std.double().numpy(), np.zeros(len(found))

    return told


def summary(told: Told, forces: Floats) -> str:
    """Errors of fz and shear over fz, coverage of 95 % intervals by component; share flagged or refused.

    Errors and coverage are of the others.
    """
    found, std, flagged = told
    trusted = flagged == 0
    if not trusted.any():
        return f"flagged or refused {flagged.mean():4.0%}"
    found, std, forces = found[trusted], std[trusted], forces[trusted]
    off, whole = found - forces, forces[:, 2]
    normal, side = np.abs(off[:, 2]) / whole, np.hypot(off[:, 0], off[:, 1]) / whole
    inside = np.where(np.isnan(off), np.nan, np.abs(off) < Z95 * std)
    middle, most = np.percentile(100 * normal, [50, 95])
    along, across = np.nanpercentile(100 * side, [50, 95])
    covers = " ".join(f"{100 * one:3.0f}" for one in np.nanmean(inside, axis=0))
    bias = 100 * np.mean(off[:, 2]) / np.mean(whole)
    return (
        f"fz {middle:5.1f} {most:6.1f} % (bias {bias:+5.1f})  "
        f"shear {along:5.1f} {across:6.1f} % (known in {np.isfinite(side).mean():4.0%})  "
        f"covers {covers} %  flagged or refused {flagged.mean():4.0%}"
    )


def compare(training: int, count: int, *, kept: Path | None = None) -> list[tuple[str, str, str]]:
    """Print the table; rows of frames, method, and what `summary` says."""
    ours = calibrated(HOME)
    known, true = frames(HOME, SEEN, training, seed=1, kept=kept)
    methods: dict[str, Callable[[Bytes], Told]] = {
        "ours": ours,
        "ridge": ridge(known, true, ours.depth),
        "network": network(known, true),
    }
    rows = []

    def show(name: str, shown: tuple[Bytes, Floats], world: World = HOME, **more: Callable[[Bytes], Told]) -> None:
        pictures, forces = shown
        print(f"{name}: {len(forces)} frames, fz {forces[:, 2].min():.2f} to {forces[:, 2].max():.2f} N")
        for method, told in (methods | more).items():
            given = pictures if method.startswith("ours") else rebased(pictures, world)
            rows.append((name, method, summary(told(given), forces)))
            print(f"    {method:18} {rows[-1][2]}", flush=True)

    show("seen shapes", frames(HOME, SEEN, count, seed=2, kept=kept))
    for kind in UNSEEN:
        show(kind, frames(HOME, (kind,), count, seed=3, kept=kept))
    show("another gel", frames(SOFT, SEEN, count, seed=4, kept=kept), SOFT, ours_told=replace(ours, world=SOFT))
    show("another light", frames(DARK, SEEN, count, seed=5, kept=kept), DARK, ours_anew=calibrated(DARK))
    return rows


def main(arguments: Sequence[str] = ()) -> None:
    """Print the table."""
    training, count = (int(one) for one in (*arguments[:2], *("1000", "100")[len(arguments[:2]) :]))
    print(
        f"{training} frames of training; errors: median, 95th percentile of |error|/fz; {MEANING[LIGHT]!r} flags"
    )
    compare(training, count, kept=Path(arguments[2]) if len(arguments) > 2 else None)


def quick() -> None:
    """Print the errors on two frames of seen shapes in the light of the calibration."""
    ours, (known, true) = calibrated(HOME), frames(HOME, SEEN, 8, seed=1, kept=None)
    pictures, forces = frames(HOME, SEEN, 2, seed=2, kept=None)
    print("ours ", summary(ours(pictures), forces))
    print("ridge", summary(ridge(known, true, ours.depth)(rebased(pictures, HOME)), forces))
    print("network", summary(network(known, true)(rebased(pictures, HOME)), forces))


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main(sys.argv[1:])
