"""Random contacts for the force benchmark, drawn finely and moved by the exact layer, seen as a camera sees them.

The truth is made on pixels a quarter of a cell wide or finer, apart from the code that is tested: tractions are
formulas, displacements one transform of the whole plane, and the height map is resampled to where the material
has gone.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import fft
from scipy.ndimage import gaussian_filter

from benchmarks.layer_truth import surface_compliance
from tactilevision.records.maps import HeightMap, ShearMap
from tactilevision.records.measured import Floats, Material, Pair
from tactilevision.records.rig import Gel

KINDS = ("Hertz", "flat punch", "two contacts", "ridge")
SLIPPING = "ball in partial slip"  # Cattaneo and Mindlin: shear is not proportional to pressure


@dataclass(frozen=True)
class View:
    """A camera's view: `shape` (H, W) pixels of `mm_per_px`; `fine` truth points per pixel and axis."""

    shape: tuple[int, int]
    mm_per_px: float
    fine: int

    @property
    def size_mm(self) -> Pair:
        """Width and height."""
        return self.shape[1] * self.mm_per_px, self.shape[0] * self.mm_per_px

    def mesh(self) -> tuple[Floats, Floats]:
        """x and y of the fine points on the pad."""
        step, (width, height) = self.mm_per_px / self.fine, self.size_mm
        x = (np.arange(self.shape[1] * self.fine) + 0.5) * step - width / 2
        y = (np.arange(self.shape[0] * self.fine) + 0.5) * step - height / 2
        return tuple(np.meshgrid(x, y))


class Forward:
    """Tractions (3, H', W') in MPa on the fine points of a view -> displacement of the pixels' material (3, H,
    W).
    """

    def __init__(self, view: View, gel: Gel, material: Material) -> None:
        self.view = view
        step = view.mm_per_px / view.fine
        pad = int(8 * gel.thickness_mm / step)
        self.count = [fft.next_fast_len(n * view.fine + pad) for n in view.shape]
        k_y = 2 * np.pi * np.fft.fftfreq(self.count[0], step)[:, None]
        k_x = 2 * np.pi * np.fft.fftfreq(self.count[1], step)[None, : self.count[1] // 2 + 1]
        self.compliance = surface_compliance(
            np.asarray(k_x, float),
            np.asarray(k_y, float),
            modulus=material.youngs_modulus_MPa,
            nu=material.poisson_ratio,
            thickness=gel.thickness_mm,
        )

    def __call__(self, traction: Floats) -> Floats:
        """Mean displacement of each pixel's material."""
        waves = np.stack([fft.rfft2(t, self.count) for t in traction], axis=-1)
        moved = np.einsum("...ij,...j->...i", self.compliance, waves)
        rows, columns = traction.shape[1:]
        u = np.stack([fft.irfft2(moved[..., i], self.count)[:rows, :columns] for i in range(3)])
        n = self.view.fine
        return np.asarray(u.reshape(3, rows // n, n, columns // n, n).mean(axis=(2, 4)))


def seen(
    u: Floats, view: View, *, std_mm: float, rng: np.random.Generator, correlation_mm: float = 0.0
) -> tuple[HeightMap, ShearMap]:
    """What is measured of a displacement: depth at the camera's places, shear at the material's, both with
    noise of a deviation and correlation length (0: white).
    """
    scale = (view.mm_per_px, view.mm_per_px)
    off = noise(view, std_mm=std_mm, rng=rng, correlation_mm=correlation_mm)
    everywhere = np.ones(view.shape, dtype=bool)
    height = HeightMap(at_camera(u, view) + off[2], everywhere, scale, std_mm=np.full(view.shape, std_mm))
    alike = max(1.0, correlation_mm / view.mm_per_px)
    shear = u[:2] + off[:2]
    return height, ShearMap(shear[0], shear[1], everywhere, scale, std_mm=std_mm, correlation_px=alike)


def noise(view: View, *, std_mm: float, rng: np.random.Generator, correlation_mm: float = 0.0) -> Floats:
    """Gaussian noise (3, H, W); white noise under a Gaussian of s has the correlation length 2 s sqrt(pi)."""
    off = np.stack([std_mm * rng.standard_normal(view.shape) for _ in range(3)])[[1, 2, 0]]
    if correlation_mm == 0:
        return off
    length = correlation_mm / view.mm_per_px
    return length * np.stack([gaussian_filter(one, length / np.sqrt(4 * np.pi), mode="wrap") for one in off])


def at_camera(u: Floats, view: View) -> Floats:
    """Depth at the places of the picture: u_z(X) where X + u(X) = x, by fixed-point steps."""
    x, y = np.meshgrid(np.arange(view.shape[1], dtype=np.float32), np.arange(view.shape[0], dtype=np.float32))
    go = (u[:2] / view.mm_per_px).astype(np.float32)
    from_x, from_y = x.copy(), y.copy()
    for _ in range(8):
        step = [cv2.remap(g, from_x, from_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for g in go]
        from_x, from_y = x - step[0], y - step[1]
    return np.asarray(
        cv2.remap(u[2].astype(np.float32), from_x, from_y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE),
        dtype=np.float64,
    )


def draw_case(kind: str, view: View, rng: np.random.Generator) -> Floats:
    """Traction (3, H', W') of one random contact of a kind. Shear is up to half the normal force, any
    direction.
    """
    x, y = view.mesh()
    width, height = view.size_mm

    def centre(reach: float) -> Pair:
        return (rng.uniform(-1, 1) * (width / 2 - reach - 1.5), rng.uniform(-1, 1) * (height / 2 - reach - 1.5))

    if kind == "ridge":
        half, ratio, turn = rng.uniform(0.5, 1.0), rng.uniform(3, 5), rng.uniform(0, np.pi)
        c = centre(half * ratio)
        along = (x - c[0]) * np.cos(turn) + (y - c[1]) * np.sin(turn)
        across = -(x - c[0]) * np.sin(turn) + (y - c[1]) * np.cos(turn)
        shape = np.sqrt(np.clip(1 - (across / half) ** 2, 0, None)) * (np.abs(along) < half * ratio)
        return _loaded(shape, view, rng.uniform(0.06, 0.15) * half**2 * ratio, rng)
    if kind == "two contacts":
        a, b = rng.uniform(1.2, 2.2, 2)
        while True:
            c, d = centre(a), centre(b)
            if np.hypot(c[0] - d[0], c[1] - d[1]) > a + b + 1.5:
                break
        return _patch(kind, view, a, c, rng) + _patch(kind, view, b, d, rng)
    a = rng.uniform(1.2, 3.0)
    if kind == SLIPPING:
        core, stuck, place = rng.uniform(0.3, 0.95) * a, rng.uniform(0, 2 * np.pi), centre(a)
        square = (x - place[0]) ** 2 + (y - place[1]) ** 2
        whole, inner = (np.sqrt(np.clip(1 - square / r**2, 0, None)) for r in (a, core))
        normal = _loaded(whole, view, rng.uniform(0.1, 0.25) * a**2, rng)[2]
        lag = rng.uniform(0.3, 1.0) * (whole - core / a * inner) * normal.sum() / whole.sum()
        return np.stack([np.cos(stuck) * lag, np.sin(stuck) * lag, normal])
    return _patch(kind, view, a, centre(a), rng)


def _patch(kind: str, view: View, radius: float, centre: Pair, rng: np.random.Generator) -> Floats:
    x, y = view.mesh()
    square = ((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / radius**2
    if kind == "flat punch":
        shape = np.where(square < 1, 1 / np.sqrt(np.clip(1 - square, 0.02, None)), 0.0)
        return _loaded(shape, view, rng.uniform(0.1, 0.3) * radius**2, rng)
    return _loaded(np.sqrt(np.clip(1 - square, 0, None)), view, rng.uniform(0.1, 0.25) * radius**2, rng)


def _loaded(shape: Floats, view: View, force_N: float, rng: np.random.Generator) -> Floats:
    pressure = shape * force_N / (shape.sum() * (view.mm_per_px / view.fine) ** 2)
    size, turn = rng.uniform(0, 0.5), rng.uniform(0, 2 * np.pi)
    return np.stack([size * np.cos(turn) * pressure, size * np.sin(turn) * pressure, pressure])
