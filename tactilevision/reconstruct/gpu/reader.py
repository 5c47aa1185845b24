"""A frame's slopes and surface on a GPU.

What looks at blocks alone (drift, zero plane, walls) stays on the processor, which is quicker at little; the
changes of colour and the law, which look at every pixel, are done there, and the transforms of whole pictures.
"""

from __future__ import annotations

import numpy as np
import torch

from tactilevision.photometric.illumination.camera_response import SOFTENING_GREY
from tactilevision.photometric.illumination.colour_change import ChangeMaps, Planes
from tactilevision.photometric.method import ReferencedMethod
from tactilevision.photometric.multiresolution import TiledSlopes
from tactilevision.photometric.protocols import Evaluator, Reading
from tactilevision.reconstruct.gpu.cosine import TorchSolver
from tactilevision.reconstruct.gpu.laws import Law, law_on
from tactilevision.records import Bytes, Pair, SlopeMap

Picture = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


class TorchReader:
    """Reads frames of one method on `device`: `read_tiles` where it reads gentle gel in means, else `read`."""

    def __init__(self, method: ReferencedMethod, mm_per_px: Pair, device: str) -> None:
        """Raises LookupError for a colour law that torch is not told of."""
        self.method, self.device, self.tiled = method, device, method.tiled_evaluator
        self.solver = TorchSolver(method.reference.shape, mm_per_px, device)
        self.whole = _Maps(method.change.maps, method.evaluate, method.kept_share, method.bias, device=device)
        tiled = self.tiled
        self.half = (
            _Maps(tiled.maps, tiled.evaluate, tiled.kept_share, tiled.bias, device=device) if tiled else None
        )

    def follow(self) -> None:
        """To be called when the method's reference has moved."""
        for maps in (self.whole, self.half):
            if maps is not None:
                maps.update_scale()

    def read(self, rgb: Bytes) -> tuple[Reading, Picture | None]:
        """What a frame says, and its surface (H, W), mean 0. Raises as the method does.

        Where colours are missing the method reads it itself, without a surface.
        """
        method = self.method
        with torch.inference_mode():
            if method.reference.marks is None:
                drift, valid = method.change.take(rgb)
                slopes = self.whole.slopes(self._greys())
            else:
                changes, drift, valid = method.change.measure(rgb)
                slopes = self.whole.read(torch.from_numpy(changes).to(self.device))
            if method.lost_share() is not None:
                return method.read(rgb), None
            depth = self.solver.surface(slopes).cpu().numpy()
            found: Planes = slopes.cpu().numpy()
            steepest = _steepest(slopes)
        return Reading(SlopeMap(found[0], found[1], valid & method.readable), drift, steepest), depth

    def read_tiles(self, rgb: Bytes) -> TiledSlopes:
        """What a frame says, gentle gel in means, as the method's own reader of gentle gel gives it."""
        assert self.tiled is not None
        assert self.half is not None
        drift, valid = self.method.change.take(rgb)
        if self.method.lost_share() is not None:
            return self.tiled.read_tiles(rgb)
        self.tiled.maps.light(drift.gains)
        rows, columns = self.tiled.even
        with torch.inference_mode():
            greys = self._greys()
            coarse = self.half.slopes(torch.nn.functional.avg_pool2d(greys[:, rows, columns], self.tiled.px))
            windows = self.tiled.windows(coarse.cpu().numpy())
            slopes = self.whole.slopes(greys) if windows else coarse
            fine = [slopes[:, *window] for window in windows]
            steepest = max(_steepest(part) for part in (coarse, *fine))
        valid = self.method.valid(valid)
        return TiledSlopes(
            coarse.cpu().numpy(), windows, [part.cpu().numpy() for part in fine], valid, drift, steepest
        )

    def _greys(self) -> torch.Tensor:
        """Grey levels (3, H, W) of the frame that the method has taken in."""
        height, width = self.method.reference.shape
        greys = self.method.change.greys((slice(0, height), slice(0, width)))
        return torch.from_numpy(np.stack(greys)).to(self.device).float()


def _steepest(slopes: torch.Tensor) -> float:
    return float(slopes.square().sum(dim=0).max().sqrt())


class _Maps:
    """One resolution: what stands between grey levels and slopes, on the device."""

    def __init__(
        self, maps: ChangeMaps, evaluate: Evaluator, kept_share: Picture, bias: Planes, *, device: str
    ) -> None:
        law = law_on(evaluate, device)
        if law is None:
            raise LookupError(type(evaluate).__name__)
        self.law: Law = law
        self.maps, self.device = maps, device
        self.kept_share, self.bias = torch.from_numpy(kept_share).to(device), torch.from_numpy(bias).to(device)
        self.update_scale()

    def update_scale(self) -> None:
        self.scale = torch.from_numpy(self.maps.scale.copy()).to(self.device)

    def slopes(self, greys: torch.Tensor) -> torch.Tensor:
        """Slopes (2, h, w) of grey levels (3, h, w) under the light that the maps were told of."""
        gain = torch.from_numpy(self.maps.down).to(self.device) @ torch.from_numpy(self.maps.across).to(
            self.device
        )
        return self.read((greys * gain + SOFTENING_GREY) * self.scale - 1.0)

    def read(self, change: torch.Tensor) -> torch.Tensor:
        return self.law(change) * self.kept_share - self.bias
