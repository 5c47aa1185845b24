"""Slope by a small neural network run with onnxruntime: model files, weights and evaluation."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactilevision.errors import InputError
from tactilevision.files.opening import damage
from tactilevision.files.writing import replacing
from tactilevision.photometric.colour_change import Window
from tactilevision.photometric.methods.polynomial import REACH
from tactilevision.photometric.protocols import Evaluator
from tactilevision.records.measured import Floats, Picture

if TYPE_CHECKING:
    import torch


# Network files: opened by onnxruntime on one core and only with the hash of their card, written by torch.

OPSET = 17  # of ONNX, written in the method's card; a newer one excludes older versions of onnxruntime
# none loops, and none enlarges its input: a foreign network ends, and fits into memory
_ALLOWED = (
    "Abs Add BatchNormalization Cast Clip Concat Constant Conv Div Elu Exp Gemm Identity LeakyRelu MatMul Max Min "
    "Mul Neg Pow Relu Reshape Sigmoid Slice Softplus Sqrt Squeeze Sub Tanh Transpose Unsqueeze"
)
OPERATORS = frozenset(_ALLOWED.split())
_MESSAGES = (  # of ONNX, of which a network is made
    "ModelProto OperatorSetIdProto StringStringEntryProto GraphProto NodeProto AttributeProto TensorProto "
    "ValueInfoProto TypeProto Tensor TensorShapeProto Dimension"
)
_PARTS = frozenset(_MESSAGES.split())
MAX_STEP = 1_000_000  # numbers per pixel that a step of a network may give; ours give some tens


@lru_cache(maxsize=8)
def open_bytes(content: bytes, sha256: str, *, where: Path) -> Any:
    """Return an onnxruntime session of the network in a file's `content`, on one core, cached by process.

    Raises InputError where its hash is not `sha256`, it is no network, or it holds more than OPERATORS.
    """
    import onnxruntime

    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(
            "the network does not match its card", where=where, remedy="Copy both files together, or train again."
        )
    checked = _checked(content, where)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    with damage(where, what="the network cannot be read"):
        return onnxruntime.InferenceSession(checked, options, providers=["CPUExecutionProvider"])


def _checked(content: bytes, where: Path) -> bytes:
    """Return the network as far as its format is known here. Raises InputError as `open_bytes` does."""
    import onnx

    with damage(where, what="the network cannot be read"):
        model = onnx.load_from_string(content)
        model.DiscardUnknownFields()
        checked, found = model.SerializeToString(), _unsupported(model)
        largest = 0.0 if found else _largest_step(model)
    if found:
        raise InputError(
            "the network holds more than supported operators and their weights",
            where=where,
            value=", ".join(sorted(found))[:200],
            remedy="Use convolutions and element-wise functions only.",
        )
    if largest > MAX_STEP:
        raise InputError(
            f"a step of the network gives more than {MAX_STEP:,} numbers for one pixel", where=where, value=largest
        )
    return bytes(checked)


def _unsupported(part: Any) -> set[str]:
    """Return names of what a message of ONNX and all within it holds besides steps of OPERATORS and weights."""
    kind = str(part.DESCRIPTOR.name)
    found = {kind} - _PARTS
    if kind == "NodeProto":
        found |= {str(part.op_type)} - OPERATORS
    if kind in ("NodeProto", "OperatorSetIdProto"):
        found |= {str(part.domain)} - {"", "ai.onnx"}
    if kind == "TensorProto" and (part.data_location or part.external_data):
        found.add("weights in other files")
    for field, value in part.ListFields():
        if field.message_type is not None:
            if kind != "ModelProto":
                found |= {field.message_type.name} & {"GraphProto"}
            for inner in [value] if hasattr(value, "ListFields") else value:
                found |= _unsupported(inner)
    return found


def _largest_step(model: Any) -> float:
    """Return the largest output of a step for one pixel; infinite where the file leaves it open."""
    import onnx

    for given in model.graph.input:
        for side in given.type.tensor_type.shape.dim:
            if not side.HasField("dim_value"):
                side.dim_value = 1
    del model.graph.value_info[:]  # the file's own shapes are not trusted
    for result in model.graph.output:
        result.type.tensor_type.ClearField("shape")
    graph = onnx.shape_inference.infer_shapes(model, data_prop=True).graph
    kinds = {step.name: step.type.tensor_type for step in (*graph.value_info, *graph.output)}
    shapes = {name: kind.shape.dim for name, kind in kinds.items() if kind.HasField("shape")}
    names = [name for node in graph.node for name in node.output if name]
    if not all(name in shapes and all(side.HasField("dim_value") for side in shapes[name]) for name in names):
        return math.inf
    return max((math.prod(side.dim_value for side in shapes[name]) for name in names), default=0)


def run_network(session: Any, *inputs: Picture) -> Picture:
    """Return the first output for the inputs in order: slopes (1, 2, h, w) of colours and places (1, 5, h, w).

    Raises InputError where the network has other inputs.
    """
    wanted = session.get_inputs()
    with damage("network", what="the network does not fit its use", remedy=""):
        return np.asarray(session.run(None, {w.name: x for w, x in zip(wanted, inputs, strict=True)})[0])


def require_exporter() -> None:
    """Raise InputError where torch cannot write ONNX, before training."""
    try:
        import onnx  # noqa: F401 -- torch's exporter asks for it
    except ImportError as fault:
        raise InputError(
            "the package onnx, which writes networks, is missing",
            where="train",
            remedy="Install onnx, or choose polynomial.",
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
        warnings.simplefilter("ignore")  # this exporter, which needs no further package, is deprecated
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


# Slope by a small network, evaluated by onnxruntime:
#
#     (p, q) = M(u, X, Y) u        u (3,) the colour change, X, Y the place from -1 to 1
#
# M (2, 3) is the output of a perceptron of convolutions of one pixel, so that the ONNX file takes a picture (1, 5,
# h, w) of any size. No change of colour is no slope, whatever the weights. Strips of rows whose layers stay in the
# cache, on one core, take up to half as long as the whole picture. Results are limited to REACH times the steepest
# slope of the samples.

CHANGE_STEP = 0.05  # colour change of the finite difference at rest


@dataclass(frozen=True)
class Network:
    """`content` of an ONNX file; `steepest` slope among the samples; `source`, the file, for error messages."""

    content: bytes
    steepest: float
    source: Path = Path("network.onnx")

    name = "network"

    @cached_property
    def sha256(self) -> str:
        return hashlib.sha256(self.content).hexdigest()

    @property
    def session(self) -> Any:
        return open_bytes(self.content, self.sha256, where=self.source)

    def at(self, change: Floats, place: Floats) -> Floats:
        """Return slopes (N, 2) for changes (N, 3) at places (N, 2)."""
        inputs = np.concatenate([change, place], axis=1).astype(np.float32)
        bound = REACH * self.steepest
        slopes = run_network(self.session, np.ascontiguousarray(inputs.T)[None, :, None])
        return np.asarray(np.clip(slopes[0, :, 0].T, -bound, bound), np.float64)

    def averaged(self, noise: Floats) -> Network:
        """Return itself: it is as smooth as a polynomial."""
        return self

    def evaluator(self, shape: tuple[int, int]) -> NetworkEvaluator:
        return NetworkEvaluator(self, shape)

    def arrays(self) -> dict[str, Floats]:
        return {"steepest": np.array(self.steepest)}


class NetworkEvaluator(Evaluator):
    """The network over a whole picture, strip by strip."""

    def __init__(self, network: Network, shape: tuple[int, int]) -> None:
        self.network, self.shape = network, shape
        self.bound = np.float32(REACH * network.steepest)
        x, y = (np.linspace(-1, 1, n, dtype=np.float32) for n in shape[::-1])
        self.place = np.stack(np.meshgrid(x, y))

    def strip(self, change: Picture, window: Window, out: Picture) -> None:
        """Slopes (2, h, w), into `out`, of the changes (3, h, w) of a window, one of `strips`."""
        inputs = np.empty((1, 5, *change.shape[1:]), np.float32)
        inputs[0, :3], inputs[0, 3:] = change, self.place[:, *window]
        slopes = run_network(self.network.session, inputs)[0]
        np.minimum(slopes, self.bound, out=slopes)
        np.maximum(slopes, -self.bound, out=out)

    def noise(self, noise: Picture) -> Picture:
        """Return the standard deviation (H, W) of a slope on untouched gel from that of the changes (3, H, W)."""
        total = np.zeros(self.shape, np.float32)
        for colour in range(3):
            step = np.zeros((3, *self.shape), np.float32)
            step[colour] = CHANGE_STEP
            up, down = self(step), self(-step)
            for above, below in zip(up, down, strict=True):
                total += (noise[colour] * (above - below) / np.float32(2.0 * CHANGE_STEP)) ** 2
        return np.asarray(np.sqrt(0.5 * total), np.float32)


# Trained networks: `_models` in an installed wheel, `models` next to the package in a checkout.

HERE = Path(__file__).parents[2]  # the package


def models_folder() -> Path:
    """Return the folder of trained methods. Raises InputError where the installation has none."""
    for folder in (HERE / "_models", HERE.parent / "models"):
        if folder.is_dir():
            return folder
    raise InputError("the trained methods are missing", where=HERE, remedy="Install tactilevision again.")


def find_model(name: str) -> Path | None:
    """Return the path of the network of that name, or None."""
    path = models_folder() / f"{name}.onnx"
    return path if path.is_file() else None


def ready_models() -> tuple[str, ...]:
    """Return the names of the installed networks, each of a kind of sensor."""
    return tuple(sorted(path.stem for path in models_folder().glob("*.onnx")))
