"""The colour laws as torch functions: changes (3, h, w) to slopes (2, h, w), as their evaluators give them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from tactilevision.photometric.methods.lookup import FINE, LookupEvaluator
from tactilevision.photometric.methods.network import NetworkEvaluator
from tactilevision.photometric.methods.polynomial import MAX_ORDER, PolynomialEvaluator
from tactilevision.photometric.protocols import Evaluator

Law = Callable[[torch.Tensor], torch.Tensor]


def law_on(evaluate: Evaluator, device: str) -> Law | None:
    """The law of an evaluator on `device`; None for one that only its own evaluator knows."""
    if isinstance(evaluate, PolynomialEvaluator):
        return _polynomial(evaluate, device)
    if isinstance(evaluate, LookupEvaluator):
        return _lookup(evaluate, device)
    if isinstance(evaluate, NetworkEvaluator):
        return _network(evaluate, device)
    return None


def _polynomial(evaluate: PolynomialEvaluator, device: str) -> Law:
    per_row, x = (torch.from_numpy(table).to(device) for table in (evaluate.per_row, evaluate.x))
    bound = float(evaluate.bound)

    def slopes(change: torch.Tensor) -> torch.Tensor:
        parts = list(change)
        for first, below, _ in evaluate.raised:
            parts += [part * parts[first.start] for part in parts[below]]
        sums = (per_row @ torch.stack(parts, dim=1)).reshape(len(per_row), MAX_ORDER + 1, 2, -1)
        found = sums[:, MAX_ORDER]
        for i in reversed(range(MAX_ORDER)):
            found = found * x + sums[:, i]
        return found.clamp(-bound, bound).permute(1, 0, 2)

    return slopes


def _lookup(evaluate: LookupEvaluator, device: str) -> Law:
    table = torch.from_numpy(evaluate.slopes.view(np.float32).reshape(-1, 2).T.copy()).to(device)
    per, shift = (
        torch.as_tensor(v, dtype=torch.float32, device=device)[:, None, None]
        for v in (evaluate.per, evaluate.shift)
    )

    def slopes(change: torch.Tensor) -> torch.Tensor:
        cells = torch.round(change * per + shift).clamp(0, FINE - 1).long()
        return table[:, (cells[0] * FINE + cells[1]) * FINE + cells[2]]

    return slopes


def _network(evaluate: NetworkEvaluator, device: str) -> Law | None:
    """The perceptron that `network_training` writes, out of its ONNX file; None for any other network."""
    import onnx
    from onnx import numpy_helper

    graph = onnx.load_from_string(evaluate.content).graph
    held = [torch.from_numpy(numpy_helper.to_array(one).copy()).to(device) for one in graph.initializer]
    layers = list(zip(held[::2], held[1::2], strict=False))
    place, bound = torch.from_numpy(evaluate.place).to(device), float(evaluate.bound)
    if not layers or any(w.ndim != 4 or b.shape != w.shape[:1] for w, b in layers) or len(layers[-1][1]) != 6:
        return None

    def slopes(change: torch.Tensor) -> torch.Tensor:
        seen = torch.cat([change, place])[None]
        for weight, bias in layers[:-1]:
            seen = torch.relu(torch.nn.functional.conv2d(seen, weight, bias))
        m = torch.nn.functional.conv2d(seen, *layers[-1])[0].reshape(3, 2, *change.shape[1:])
        return (m * change[:, None]).sum(0).clamp(-bound, bound)

    tried = np.random.default_rng(0).uniform(-0.2, 0.2, (3, *evaluate.shape)).astype(np.float32)
    with torch.inference_mode():
        same = np.allclose(slopes(torch.from_numpy(tried).to(device)).cpu(), np.stack(evaluate(tried)), atol=1e-3)
    return slopes if same else None
