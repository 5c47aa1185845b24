"""The cosine transforms of `tactilevision.integration.dct_poisson` by complex Fourier transforms of equal length.

    X_k = Re(2 exp(-i pi k/2N) V_k)     V: Fourier transform of x_0 x_2 x_4 ... x_5 x_3 x_1
and back, V_k = exp(i pi k/2N) (X_k - i X_(N-k)) / 2 with X_N = 0.
Source: Makhoul, A fast cosine transform in one and two dimensions, IEEE Trans. ASSP 28 (1980).
"""

from __future__ import annotations

import numpy as np
import torch

from tactilevision.integration.dct_poisson import inverse_eigenvalues
from tactilevision.records import Pair


class TorchSolver:
    """`TransformSolver` for one size, scale and device, in single precision."""

    def __init__(self, shape: tuple[int, int], mm_per_px: Pair, device: str) -> None:
        self.mm_per_px = mm_per_px
        self.inverse = torch.as_tensor(inverse_eigenvalues(shape, mm_per_px), dtype=torch.float32, device=device)
        self.turns = [
            torch.as_tensor(np.exp(0.5j * np.pi * np.arange(n) / n), dtype=torch.complex64, device=device)
            for n in shape
        ]

    def surface(self, slopes: torch.Tensor) -> torch.Tensor:
        """Depth (H, W) of mean 0 of slopes (2, H, W), as `surface.integrate` gives it."""
        p, q = slopes[0] * (0.5 / self.mm_per_px[0]), slopes[1] * (0.5 / self.mm_per_px[1])
        right = torch.zeros_like(p)
        along_x, along_y = p[:, 1:] + p[:, :-1], q[1:] + q[:-1]
        right[:, :-1] += along_x
        right[:, 1:] -= along_x
        right[:-1] += along_y
        right[1:] -= along_y
        return self.solve(right)

    def solve(self, right: torch.Tensor) -> torch.Tensor:
        """Depth (H, W) of mean 0 whose 5-point Laplacian is `right`, which sums to 0."""
        down, across = self.turns
        modes = _forward(_forward(right, across).T, down).T * self.inverse
        return _back(_back(modes, across).T, down).T


def _forward(x: torch.Tensor, turn: torch.Tensor) -> torch.Tensor:
    """Along the last axis."""
    folded = torch.cat([x[..., ::2], x[..., 1::2].flip(-1)], dim=-1)
    modes: torch.Tensor = 2.0 * (torch.fft.fft(folded) * turn.conj()).real
    return modes


def _back(modes: torch.Tensor, turn: torch.Tensor) -> torch.Tensor:
    mirrored = torch.cat([torch.zeros_like(modes[..., :1]), modes[..., 1:].flip(-1)], dim=-1)
    folded = torch.fft.ifft(0.5 * turn * torch.complex(modes, -mirrored)).real
    out, half = torch.empty_like(modes), (modes.shape[-1] + 1) // 2
    out[..., ::2], out[..., 1::2] = folded[..., :half], folded[..., half:].flip(-1)
    return out
