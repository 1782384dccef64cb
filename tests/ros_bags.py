"""Bags for tests, written by the writers of rosbags and mcap."""

import json
from pathlib import Path

import numpy as np
import pytest

__all__ = ["bags", "loop", "write_bag", "write_json_mcap"]

rosbags = pytest.importorskip("rosbags", reason="needs the extra: pip install 'gpszip[ros]'")
pytest.importorskip("mcap", reason="needs the extra: pip install 'gpszip[ros]'")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import StoragePlugin  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

#: Nanoseconds at which logs begin.
START = 1_700_000_000_000_000_000

#: Kinds of bags: suffix and storage.
KINDS = ("bag", "sqlite", "mcap")
bags = pytest.mark.parametrize("kind", KINDS)


def loop(n=200):
    """Seconds from the start, and positions of a robot that circles."""
    t = np.arange(n) / 10
    return t, np.stack([20 * np.cos(t / 4), 20 * np.sin(t / 4), 0.1 * t], axis=1).round(6)


class Messages:
    """Makes messages of one version of ROS."""

    def __init__(self, kind):
        self.is_ros1 = kind == "bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.is_ros1 else Stores.ROS2_HUMBLE)
        # Transforms are no part of the messages that come with ROS 1.
        if self.is_ros1:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))

    def make(self, name, *fields):
        package, short = name.split("/")
        return self.store.types[f"{package}/msg/{short}"](*fields)

    def time(self, nanoseconds):
        return self.make("builtin_interfaces/Time", *map(int, divmod(nanoseconds, 10**9)))

    def header(self, nanoseconds, frame):
        stamp = self.time(nanoseconds)
        fields = (0, stamp, frame) if self.is_ros1 else (stamp, frame)
        return self.make("std_msgs/Header", *fields)

    def vector(self, name, p):
        return self.make(f"geometry_msgs/{name}", *map(float, p))

    def pose(self, p, q=(0, 0, 0, 1)):
        return self.make(
            "geometry_msgs/Pose", self.vector("Point", p), self.vector("Quaternion", q)
        )

    def odometry(self, ns, p, q=(0, 0, 0, 1), frame="odom", child="base_link"):
        zero = self.vector("Vector3", (0, 0, 0))
        twist = self.make("geometry_msgs/Twist", zero, zero)
        return self.make(
            "nav_msgs/Odometry",
            self.header(ns, frame),
            child,
            self.make("geometry_msgs/PoseWithCovariance", self.pose(p, q), np.zeros(36)),
            self.make("geometry_msgs/TwistWithCovariance", twist, np.zeros(36)),
        )

    def pose_stamped(self, ns, p, q=(0, 0, 0, 1), frame="map"):
        return self.make("geometry_msgs/PoseStamped", self.header(ns, frame), self.pose(p, q))

    def pose_with_covariance(self, ns, p, q=(0, 0, 0, 1), frame="map"):
        pose = self.make("geometry_msgs/PoseWithCovariance", self.pose(p, q), np.zeros(36))
        return self.make("geometry_msgs/PoseWithCovarianceStamped", self.header(ns, frame), pose)

    def point(self, ns, p, frame="map"):
        return self.make(
            "geometry_msgs/PointStamped", self.header(ns, frame), self.vector("Point", p)
        )

    def transform(self, ns, p, q=(0, 0, 0, 1), frame="map", child="odom"):
        moved = self.make(
            "geometry_msgs/Transform", self.vector("Vector3", p), self.vector("Quaternion", q)
        )
        return self.make("geometry_msgs/TransformStamped", self.header(ns, frame), child, moved)

    def transforms(self, *items):
        return self.make("tf2_msgs/TFMessage", list(items))

    def fix(self, ns, lat, lon, alt=500.0, status=0, frame="gps"):
        return self.make(
            "sensor_msgs/NavSatFix",
            self.header(ns, frame),
            self.make("sensor_msgs/NavSatStatus", status, 1),
            lat,
            lon,
            alt,
            np.zeros(9),
            0,
        )

    def path(self, poses, frame="map"):
        return self.make("nav_msgs/Path", self.header(START, frame), list(poses))

    def text(self, data):
        return self.make("std_msgs/String", data)

    def image(self, ns, size):
        pixels = np.random.default_rng(ns % 2**32).integers(0, 256, size, np.uint8)
        return self.make(
            "sensor_msgs/Image", self.header(ns, "camera"), 1, size, "mono8", 0, size, pixels
        )


def write_bag(path, kind, make, compression=None):
    """Write a bag.

    ``make`` gets :class:`Messages` and yields topic, nanoseconds of the log, and message. Return
    the path of the file, or of the folder of ROS 2.
    """
    path, messages = Path(path), Messages(kind)
    if kind == "bag":
        path = path.with_suffix(".bag")
        writer = Writer1(path)
        if compression is not None:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if compression is not None:
            writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, log_time, message in make(messages):
            key = topic, message.__msgtype__
            if key not in connections:
                connections[key] = writer.add_connection(*key, typestore=messages.store)
            serialize = (
                messages.store.serialize_ros1 if kind == "bag" else (messages.store.serialize_cdr)
            )
            writer.write(connections[key], log_time, serialize(message, message.__msgtype__))
    return path


def write_json_mcap(path, rows, *, finished=True):
    """Write an MCAP file of JSON: rows of topic, schema, nanoseconds of the log, and mapping."""
    from mcap.writer import Writer

    with Path(path).open("wb") as file:
        writer = Writer(file, chunk_size=2000)
        writer.start()
        channels = {}
        for topic, schema, log_time, message in rows:
            if topic not in channels:
                number = writer.register_schema(schema, "jsonschema", b"{}")
                channels[topic] = writer.register_channel(topic, "json", number)
            data = json.dumps(message).encode()
            writer.add_message(channels[topic], log_time, data, log_time)
        if finished:
            writer.finish()
    return Path(path)
