"""
A node of ROS 2
===============

Subscribe to pictures of a sensor; publish depth (32FC1, metres) and wrench with the same stamp.
Start it as any node::

    python examples/ros2_node.py --ros-args -p sensor:=my_sensor.tvs -r image:=/camera/image_raw

Without ROS, frames of a sample are played through the same code.
"""

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from tactilevision import (
    Frame,
    HeightMap,
    InputError,
    Stream,
    Wrench,
    build_reconstructor,
    load_sensor,
    read_frame,
    read_recording,
)

SAMPLE = Path(__file__).parents[1] / "sample_frames" / "gelslim3"
METRES = 1e-3  # of a millimetre; ROS counts in metres
PLAYED = range(70, 110, 4)  # frames of the sample: the end of one press, then the next


@dataclass
class Tactile:
    """The node without ROS: `new_image` and `new_wrench` make empty messages, the others send results."""

    stream: Stream
    new_image: Callable[[], Any]
    new_wrench: Callable[[], Any]
    send_depth: Callable[[Any], None]
    send_wrench: Callable[[Any], None]
    warn: Callable[[str], None]
    frame_id: str = "gel_pad"  # x right, y down, z into the gel, from the pad's centre

    def take(self, message: Any) -> None:
        """Answer one sensor_msgs/Image; skip an unreadable one with a warning."""
        try:
            moment = self.stream.take(Frame(picture_of(message)))
        except InputError as fault:
            self.warn(str(fault))
            return
        depth = self.new_image()
        self._stamp(depth, message)
        fill_depth(depth, moment.height)
        self.send_depth(depth)
        if moment.wrench is not None:
            wrench = self.new_wrench()
            self._stamp(wrench, message)
            fill_wrench(wrench.wrench, moment.wrench)
            self.send_wrench(wrench)

    def _stamp(self, answer: Any, question: Any) -> None:
        answer.header.stamp = question.header.stamp  # when the picture was taken, not when it was read
        answer.header.frame_id = self.frame_id


def picture_of(message: Any) -> npt.NDArray[np.uint8]:
    """Return the picture (H, W, 3) uint8, red first, of an 8-bit message."""
    if message.encoding not in ("rgb8", "bgr8"):
        raise InputError("pictures are rgb8 or bgr8", where="image", value=message.encoding)
    data = np.frombuffer(message.data, np.uint8)
    if message.step < 3 * message.width or data.size != message.height * message.step:
        raise InputError("a picture has other bytes than its size needs", where="image", value=data.size)
    rows = data.reshape(message.height, message.step)
    picture = rows[:, : 3 * message.width].reshape(message.height, message.width, 3)
    return np.ascontiguousarray(picture if message.encoding == "rgb8" else picture[..., ::-1])


def fill_depth(message: Any, height: HeightMap) -> None:
    """Fill a 32FC1 message in metres, NaN where the map is invalid."""
    depth_m = np.where(height.valid, height.depth_mm * METRES, np.nan).astype("<f4")
    message.height, message.width = depth_m.shape
    message.encoding, message.is_bigendian, message.step = "32FC1", 0, 4 * message.width
    message.data = array("B", depth_m.tobytes())


def fill_wrench(message: Any, wrench: Wrench) -> None:
    """Fill a wrench with force in N and torque in N m."""
    for name, force_N, moment_Nmm in zip("xyz", wrench.force_N, wrench.moment_Nmm, strict=True):
        setattr(message.force, name, float(force_N))
        setattr(message.torque, name, float(moment_Nmm) * METRES)


def spin() -> None:
    """Subscribe and answer until the node stops. Only the newest picture is queued, so the node never lags."""
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import Image

    rclpy.init()
    node = rclpy.create_node("tactile")
    sensor = load_sensor(node.declare_parameter("sensor", "my_sensor.tvs").value)
    depth = node.create_publisher(Image, "tactile/depth", 1)
    wrench = node.create_publisher(WrenchStamped, "tactile/wrench", 1)
    warn = node.get_logger().warning
    work = Tactile(Stream(sensor), Image, WrenchStamped, depth.publish, wrench.publish, warn)
    newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(Image, "image", work.take, newest)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def empty() -> SimpleNamespace:
    """Return a stand-in for a ROS message."""
    return SimpleNamespace(header=SimpleNamespace())


def play() -> None:
    """Play frames of the sample and plot the deepest answer."""
    recording = read_recording(SAMPLE)
    answers: list[Any] = []
    stream = Stream(build_reconstructor(recording))
    work = Tactile(stream, empty, empty, answers.append, answers.append, print)
    for number in PLAYED:
        rgb = read_frame(recording, number).rgb
        rows, columns = rgb.shape[:2]
        stamp = SimpleNamespace(sec=number, nanosec=0)
        picture = {
            "height": rows,
            "width": columns,
            "step": 3 * columns,
            "encoding": "rgb8",
            "data": rgb.tobytes(),
        }
        work.take(SimpleNamespace(header=SimpleNamespace(stamp=stamp), **picture))
    maps = [np.frombuffer(one.data, "<f4").reshape(one.height, one.width) for one in answers]
    for answer, depth_m in zip(answers, maps, strict=True):
        deepest_um = 1e6 * np.nanmax(depth_m)
        print(
            f"{answer.header.stamp.sec} s: {answer.encoding} in {answer.header.frame_id}, to {deepest_um:.0f} um"
        )
    draw(max(maps, key=np.nanmax))


def draw(depth_m: npt.NDArray[np.float32]) -> None:
    """Plot the deepest map as a subscriber receives it."""
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    shown = axes.imshow(1e3 * depth_m, cmap="viridis")
    figure.colorbar(shown, label="depth (mm)")
    axes.set(title="The deepest answer on /tactile/depth", xlabel="x (px)", ylabel="y (px)")
    figure.savefig("ros2_node.png", dpi=150)


def main() -> None:
    try:
        import rclpy  # noqa: F401
    except ImportError:
        play()
    else:
        spin()


if __name__ == "__main__":
    main()
