"""The example's node: its answers as messages that rosbags packs, and its wiring against a stand-in of rclpy."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactilevision.profile.sensor import CalibratedSensor, load_sensor
from tactilevision.records.measured import Bytes
from tactilevision.robots.live import Stream
from tactilevision.robots.messages import IMAGE, WRENCH, typestore

sys.path.insert(0, str(Path(__file__).parents[1] / "profile"))
from lamp_sensor import free, pressed, saved

NODE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "ros2_node.py"))
START = 1_790_000_000


def picture(rgb: Bytes, *, second: int = 0, encoding: str = "bgr8", pad: int = 4) -> Any:
    """A message; its rows are longer than they need be, as cameras have them."""
    store = typestore("cdr").types
    stamp = store["builtin_interfaces/msg/Time"](sec=START + second, nanosec=7)
    header = store["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")
    rows = rgb[..., ::-1].reshape(rgb.shape[0], -1)
    data = np.pad(rows, [(0, 0), (0, pad)]).ravel()
    size = {"height": rgb.shape[0], "width": rgb.shape[1], "step": 3 * rgb.shape[1] + pad}
    return store[IMAGE](header=header, encoding=encoding, is_bigendian=0, data=data, **size)


def blank_image() -> Any:
    return SimpleNamespace(header=SimpleNamespace())


def blank_wrench() -> Any:
    whole = SimpleNamespace(force=SimpleNamespace(), torque=SimpleNamespace())
    return SimpleNamespace(header=SimpleNamespace(), wrench=whole)


@pytest.fixture(scope="module")
def sensor(tmp_path_factory: pytest.TempPathFactory) -> CalibratedSensor:
    return load_sensor(saved(tmp_path_factory.mktemp("node")))


def test_depth_and_wrench_are_messages_with_the_pictures_stamp(sensor: CalibratedSensor) -> None:
    depths: list[Any] = []
    wrenches: list[Any] = []
    told: list[str] = []
    send = depths.append, wrenches.append, told.append
    work = NODE["Tactile"](Stream(sensor), blank_image, blank_wrench, *send)
    for second, rgb in enumerate((free(), free(4), pressed())):
        work.take(picture(rgb, second=second))
    work.take(picture(free(), encoding="mono8"))
    work.take(picture(free()[:90]))
    assert [one.header.stamp.sec - START for one in depths] == [0, 1, 2]
    assert "rgb8 or bgr8" in told[0]
    assert len(told) == 2
    store = typestore("cdr")
    depths[2].data = np.frombuffer(depths[2].data, np.uint8)  # rosbags packs arrays of numpy alone
    message = store.deserialize_cdr(store.serialize_cdr(depths[2], IMAGE), IMAGE)
    assert (message.encoding, message.step, message.header.frame_id) == ("32FC1", 960, "gel_pad")
    expected = sensor.read(pressed()).height
    depth_m = np.frombuffer(message.data.tobytes(), "<f4").reshape(180, 240)
    valid = np.isfinite(depth_m) & expected.valid
    np.testing.assert_allclose(depth_m[valid], 1e-3 * expected.depth_mm[valid], atol=1e-5)
    wrench = store.deserialize_cdr(store.serialize_cdr(wrenches[-1], WRENCH), WRENCH)
    assert wrench.header.stamp.nanosec == 7
    found = sensor.read(pressed()).wrench
    assert found is not None
    assert wrench.wrench.force.z == pytest.approx(found.force_N[2], rel=0.03)
    assert wrench.wrench.torque.x == pytest.approx(1e-3 * found.moment_Nmm[0], rel=0.03)


class StandIn:
    """What of a node of rclpy is used; it hands over one picture."""

    def __init__(self, profile: Path) -> None:
        self.profile, self.sent, self.took, self.ended = profile, list[Any](), list[str](), False

    def declare_parameter(self, name: str, default: str) -> Any:
        return SimpleNamespace(value=str(self.profile) if (name, default) == ("sensor", "my_sensor.tvs") else None)

    def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
        return SimpleNamespace(publish=lambda message: self.sent.append((topic, message)))

    def create_subscription(self, kind: type, topic: str, take: Any, quality: Any) -> None:
        self.took.append(topic)
        assert quality.depth == 1
        take(picture(pressed()))

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=pytest.fail)

    def destroy_node(self) -> None:
        self.ended = True


def test_the_node_is_wired_to_ros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    node = StandIn(saved(tmp_path))

    def stop(_: Any) -> None:
        raise KeyboardInterrupt

    def quality(**told: Any) -> Any:
        return SimpleNamespace(**told)

    ros: dict[str, dict[str, Any]] = {
        "rclpy": {
            "init": lambda: None,
            "create_node": lambda name: node,
            "spin": stop,
            "try_shutdown": lambda: None,
        },
        "rclpy.qos": {"QoSProfile": quality, "ReliabilityPolicy": SimpleNamespace(BEST_EFFORT=2)},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": blank_image},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"WrenchStamped": blank_wrench},
    }
    for name, holds in ros.items():
        module = ModuleType(name)
        vars(module).update(holds)
        monkeypatch.setitem(sys.modules, name, module)
    NODE["main"]()
    assert [topic for topic, _ in node.sent] == ["tactile/depth", "tactile/wrench"]
    assert node.took == ["image"]
    assert node.ended
