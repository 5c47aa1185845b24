"""Choose a torch device, and record the steps of a batch on a CUDA device."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor

from tactilevision.errors import InputError
from tactilevision.heightmap.batched_slopes import rectified
from tactilevision.records.measured import Bytes, Picture

HOST = "cpu"  # torch's name of the processor
WARM = 2  # runs before the steps are recorded, in which libraries make their plans

T = TypeVar("T")


def find_device(asked: str) -> str:
    """Return torch's name of the device `asked` for: "cpu", "cuda", "cuda:N" or "auto".

    "auto" is a CUDA device where there is one, else the processor. Raises InputError for one that is not there.
    """
    if asked == "auto":
        return "cuda" if torch.cuda.is_available() else HOST
    with suppress(RuntimeError):
        device = torch.device(asked)
        count = torch.cuda.device_count() if torch.cuda.is_available() else 0
        if device.type == HOST or (device.type == "cuda" and (device.index or 0) < count):
            return asked
    remedy = "Use cpu, or auto for a CUDA device where there is one."
    raise InputError("torch finds no such device", where="device", value=asked, remedy=remedy)


def each(act: Callable[[Tensor], Any], found: Any) -> Any:
    """Return a nested named tuple of tensors with `act` applied to each."""
    return type(found)(*(each(act, one) if isinstance(one, tuple) else act(one) for one in found))


class Recorded(Generic[T]):
    """The steps of a batch on a CUDA device, recorded once as a graph, with pinned copies to and from it.

    `act` maps rectified grey levels (count, 3, H, W) to a nested named tuple of tensors by frame. Two batches may
    be under way: the device computes one while the processor works on the other.
    """

    def __init__(
        self,
        act: Callable[[Tensor], T],
        *,
        device: str,
        count: int,
        shape: tuple[int, int],
        maps: tuple[Picture, Picture] | None,
    ) -> None:
        self.device = device
        self.maps = maps and [torch.from_numpy(one.copy()).to(device)[None] for one in maps]
        self.greys = torch.full((count, 3, *shape), 128.0, device=device)
        with torch.cuda.device(device):
            side, self.graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()  # type: ignore[no-untyped-call]
            side.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(side):
                for _ in range(WARM):
                    act(self.greys)
            torch.cuda.current_stream().wait_stream(side)
            with torch.cuda.graph(self.graph):
                self.found = act(self.greys)
        self.kept = [
            each(lambda one: torch.empty_like(one, device=HOST, pin_memory=True), self.found) for _ in "12"
        ]
        self.done, self.turn = [torch.cuda.Event() for _ in "12"], 0  # type: ignore[no-untyped-call]
        self.given: list[Tensor] = []

    def begin(self, rgbs: Sequence[Bytes]) -> int:
        """Start reading raw pictures of one size, at most `count`; return the slot for `end`."""
        size, self.turn = (len(self.greys), *rgbs[0].shape), 1 - self.turn
        if not self.given or self.given[0].shape != size:
            self.given = [torch.zeros(size, dtype=torch.uint8, pin_memory=True) for _ in "12"]
        given = self.given[self.turn]  # its last copy has ended: `end` waited for what came after it
        for k, rgb in enumerate(rgbs):
            given[k] = torch.from_numpy(rgb)
        with torch.cuda.device(self.device):
            self.greys.copy_(rectified(given.to(self.device, non_blocking=True), self.maps))
            self.graph.replay()
            for kept, made in zip(leaves(self.kept[self.turn]), leaves(self.found), strict=True):
                kept.copy_(made, non_blocking=True)
            self.done[self.turn].record()
        return self.turn

    def end(self, turn: int) -> T:
        """Return what the batch of a slot gave, on the processor; valid until the slot's next batch."""
        self.done[turn].synchronize()
        kept: T = self.kept[turn]
        return kept


def leaves(found: Any) -> list[Tensor]:
    """Return the tensors of a nested named tuple in order."""
    return [leaf for one in found for leaf in (leaves(one) if isinstance(one, tuple) else [one])]
