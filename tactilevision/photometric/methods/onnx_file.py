"""Networks as files: opened by onnxruntime on one core and only with the hash of their card, written by torch."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactilevision.errors import InputError
from tactilevision.files import replacing

if TYPE_CHECKING:
    import torch

OPSET = 17  # of ONNX, written in the method's card; a newer one shuts out older versions of onnxruntime
# none repeats, and none makes more numbers than it is given: a foreign network ends, and fits into memory
_ALLOWED = (
    "Abs Add BatchNormalization Cast Clip Concat Constant Conv Div Elu Exp Gemm Identity LeakyRelu MatMul Max Min "
    "Mul Neg Pow Relu Reshape Sigmoid Slice Softplus Sqrt Squeeze Sub Tanh Transpose Unsqueeze"
)
OPERATORS = frozenset(_ALLOWED.split())
MAX_STEP = 1_000_000  # numbers that a step of a network may give for one pixel; ours give some tens
Array = npt.NDArray[np.float32]


def open_bytes(content: bytes, sha256: str, *, where: Path) -> Any:
    """An onnxruntime session of the network in a file's `content`, on one core.

    Raises InputError where it is not the one of its card (`sha256`), is no network, or has other OPERATORS.
    """
    import onnxruntime

    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(
            "the network does not match its card", where=where, remedy="Copy both files together, or train again."
        )
    _check_operators(content, where)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as fault:  # onnxruntime has an error of its own for each way of being no network
        raise InputError(f"the network cannot be read: {str(fault)[:200]}", where=where) from fault


def _check_operators(content: bytes, where: Path) -> None:
    import onnx

    try:
        model = onnx.load_from_string(content)
        graph, largest = model.graph, _largest_step(model)
    except Exception as fault:  # protobuf has its own errors, too
        raise InputError(f"the network cannot be read: {str(fault)[:200]}", where=where) from fault
    strange = sorted({str(node.op_type) for node in graph.node} - OPERATORS)
    if strange:
        raise InputError(
            "the network has operators that are not run",
            where=where,
            value=", ".join(strange)[:200],
            remedy="Build it of convolutions and functions of single numbers.",
        )
    if largest > MAX_STEP:
        raise InputError(
            f"a step of the network gives more than {MAX_STEP:,} numbers for one pixel", where=where, value=largest
        )
    if any(tensor.data_location for tensor in graph.initializer):
        raise InputError("the network names other files for its numbers", where=where)


def _largest_step(model: Any) -> float:
    """Numbers that a step gives where the free axes are one pixel; infinite where the file leaves it open."""
    import onnx

    for given in model.graph.input:
        for side in given.type.tensor_type.shape.dim:
            if not side.HasField("dim_value"):
                side.dim_value = 1
    del model.graph.value_info[:]  # what the file says of its own steps is not believed
    for result in model.graph.output:
        result.type.tensor_type.ClearField("shape")
    graph = onnx.shape_inference.infer_shapes(model, data_prop=True).graph
    kinds = {step.name: step.type.tensor_type for step in (*graph.value_info, *graph.output)}
    shapes = {name: kind.shape.dim for name, kind in kinds.items() if kind.HasField("shape")}
    names = [name for node in graph.node for name in node.output if name]
    if not all(name in shapes and all(side.HasField("dim_value") for side in shapes[name]) for name in names):
        return math.inf
    return max((math.prod(side.dim_value for side in shapes[name]) for name in names), default=0)


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
