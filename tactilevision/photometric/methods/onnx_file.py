"""Networks as files: opened by onnxruntime on one core and only with the hash of their card, written by torch."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files import replacing

if TYPE_CHECKING:
    import torch

OPSET = 17  # of ONNX, written in the method's card; a newer one shuts out older versions of onnxruntime
Array = npt.NDArray[np.float32]


def open_bytes(content: bytes, sha256: str, *, where: Path) -> Any:
    """An onnxruntime session of the network in a file's `content`, on one core.

    Raises InputError where it is not the one of its card (`sha256`), or is no network.
    """
    import onnxruntime

    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(
            "the network does not match its card", where=where, remedy="Copy both files together, or train again."
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as fault:  # onnxruntime has an error of its own for each way of being no network
        raise InputError(f"the network cannot be read: {str(fault)[:200]}", where=where) from fault


def run_network(session: Any, *inputs: Array) -> Array:
    """The first output for the inputs in their order: slopes (1, 2, h, w) of colours and places (1, 5, h, w).

    Raises InputError where the network wants others.
    """
    wanted = session.get_inputs()
    try:
        return np.asarray(session.run(None, {w.name: x for w, x in zip(wanted, inputs, strict=True)})[0])
    except Exception as fault:
        raise InputError(f"the network does not fit its use: {str(fault)[:200]}", where="network") from fault


def require_exporter() -> None:
    """Raises InputError where torch cannot write ONNX, before any time is spent on training."""
    try:
        import onnx  # noqa: F401 -- torch's exporter asks for it
    except ImportError as fault:
        raise InputError(
            "a network is written by the package onnx, which is missing",
            where="train",
            remedy="Install onnx, or take polynomial.",
        ) from fault


def export_network(
    module: torch.nn.Module, example: torch.Tensor, *, path: Path | str, free_axes: dict[int, str]
) -> str:
    """Write `module` to `path` as ONNX (opset OPSET), its `free_axes` of any size; returns its hash."""
    import warnings

    import torch

    target = Path(path)
    module.eval()
    with replacing(target) as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter that needs no further package says it is the older one
        torch.onnx.export(
            module,
            (example,),
            temporary,
            dynamo=False,
            opset_version=OPSET,
            input_names=["x"],
            output_names=["y"],
            dynamic_axes={"x": free_axes, "y": free_axes},
        )
    return hashlib.sha256(target.read_bytes()).hexdigest()
