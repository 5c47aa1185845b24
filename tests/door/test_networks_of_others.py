"""A network of others holds steps and weights alone, wherever its file could hide more."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import onnx
import pytest
from each import each
from onnx import TensorProto, helper

from tactilevision.errors import InputError
from tactilevision.photometric.methods.network import open_bytes

MODEL = Path(__file__).parents[2] / "models" / "gelslim3.onnx"


def loop() -> Any:
    """A loop without end, as a step."""
    step, go, more = (
        helper.make_tensor_value_info(name, kind, [])
        for name, kind in (("k", TensorProto.INT64), ("go", TensorProto.BOOL), ("more", TensorProto.BOOL))
    )
    body = helper.make_graph([helper.make_node("Identity", ["go"], ["more"])], "body", [step, go], [more])
    return helper.make_node("Loop", ["", "go"], [], body=body)


def function(model: Any) -> None:
    """A function of the file by the name of a step."""
    made = helper.make_function("", "Relu", ["x"], ["y"], [loop()], [helper.make_opsetid("", 17)])
    model.functions.append(made)


def foreign_function(model: Any) -> None:
    function(model)
    model.functions[0].domain = "mine"
    model.opset_import.append(helper.make_opsetid("mine", 1))
    model.graph.node[0].domain = "mine"


def foreign_domain(model: Any) -> None:
    model.graph.node[0].domain = "com.microsoft"


def graph_in_a_step(model: Any) -> None:
    """A known step with an attribute that it does not have."""
    graph = helper.make_graph([], "inner", [], [])
    model.graph.node[0].attribute.append(helper.make_attribute("inner", graph))


def graphs_in_a_step(model: Any) -> None:
    graph = helper.make_graph([], "inner", [], [])
    model.graph.node[0].attribute.append(helper.make_attribute("inner", [graph, graph]))


def _outside(tensor: Any) -> Any:
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")
    return tensor


def weights_outside(model: Any) -> None:
    _outside(model.graph.initializer[0])


def constant_outside(model: Any) -> None:
    value = _outside(helper.make_tensor("c", TensorProto.FLOAT, [1], [0.0]))
    model.graph.node.append(helper.make_node("Constant", [], ["c"], value=value))


def sparse_weights(model: Any) -> None:
    """One number that stands for a billion."""
    values, places = (helper.make_tensor("v", kind, [1], [1]) for kind in (TensorProto.FLOAT, TensorProto.INT64))
    model.graph.sparse_initializer.append(helper.make_sparse_tensor(values, places, [10**9]))


def sparse_constant(model: Any) -> None:
    sparse_weights(model)
    tensor = model.graph.sparse_initializer.pop()
    model.graph.node.append(helper.make_node("Constant", [], ["c"], sparse_value=tensor))


def training(model: Any) -> None:
    model.training_info.add().algorithm.CopyFrom(helper.make_graph([], "inner", [], []))


def opened(model: Any) -> Any:
    content = model.SerializeToString()
    return open_bytes(content, hashlib.sha256(content).hexdigest(), where=Path("a.onnx"))


@each(
    "spoil",
    [
        function,
        foreign_function,
        foreign_domain,
        graph_in_a_step,
        graphs_in_a_step,
        weights_outside,
        constant_outside,
        sparse_weights,
        sparse_constant,
        training,
    ],
)
def test_what_is_no_step_and_no_weight_is_refused(spoil: Callable[[Any], None]) -> None:
    model = onnx.load(MODEL)
    spoil(model)
    with pytest.raises(InputError, match=r"a\.onnx: the network holds more than supported operators"):
        opened(model)


def test_fields_of_no_known_meaning_are_not_run() -> None:
    content = onnx.load(MODEL).SerializeToString() + bytes([0xFA, 0x3E, 1, 0])  # field 1007: one byte
    session = open_bytes(content, hashlib.sha256(content).hexdigest(), where=Path("a.onnx"))
    assert [one.name for one in session.get_inputs()] == [
        one.name for one in opened(onnx.load(MODEL)).get_inputs()
    ]
