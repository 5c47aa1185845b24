"""Torch on one core, from a seed, leaving the caller's threads and random numbers as they were."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_core(seed: int) -> Iterator[None]:
    """Within it torch computes on one core and draws (kornia too) from `seed`: the same again everywhere.

    Small layers gain nothing from more cores, and sums on many of them round in another order each time.
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
