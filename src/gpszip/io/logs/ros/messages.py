"""What messages hold: stamps, frames, positions and orientations, by their types."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

__all__ = [
    "GEOGRAPHIC_TYPES",
    "PATH",
    "POSE_TYPES",
    "TRANSFORMS",
    "Pose",
    "Transform",
    "poses_of",
    "transforms_of",
]

#: Type of messages with transforms.
TRANSFORMS = "tf2_msgs/msg/TFMessage"

#: Type of messages each of which holds a whole path.
PATH = "nav_msgs/msg/Path"

#: No orientation.
_UNKNOWN = (float("nan"),) * 4


class Pose(NamedTuple):
    """A position, and what comes with it.

    Parameters
    ----------
    stamp : int
        Nanoseconds of the header; 0 if the sender left it empty.
    frame : str
        Frame of the position.
    child : str
        Frame that is there; empty if the type has none.
    position : tuple of float
        x, y and z in metres, or latitude, longitude and altitude.
    orientation : tuple of float
        Quaternion x, y, z, w; NaN if the type has none.
    has_fix : bool
        Whether a receiver says that it knows its position.
    """

    stamp: int
    frame: str
    child: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float] = _UNKNOWN
    has_fix: bool = True


class Transform(NamedTuple):
    """Where a frame is in its parent.

    Parameters
    ----------
    parent, child : str
        Names of frames.
    stamp : int
        Nanoseconds.
    position : tuple of float
        x, y and z of the child's origin, in metres.
    orientation : tuple of float
        Quaternion x, y, z, w.
    """

    parent: str
    child: str
    stamp: int
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


def poses_of(kind: str, message: Any) -> Iterable[Pose]:
    """Return the poses of a message.

    Parameters
    ----------
    kind : str
        One of :data:`POSE_TYPES`.
    message : object or mapping
        The decoded message.
    """
    return POSE_TYPES[kind](message)


def transforms_of(message: Any) -> Iterable[Transform]:
    """Return the transforms of a message of type :data:`TRANSFORMS`."""
    for item in message.transforms:
        moved = item.transform
        yield Transform(
            item.header.frame_id.lstrip("/"),
            item.child_frame_id.lstrip("/"),
            _stamp(item.header),
            _vector(moved.translation),
            _quaternion(moved.rotation),
        )


def _fix(message: Any) -> Iterable[Pose]:
    # A status below 0 says that there is no fix.
    position = (message.latitude, message.longitude, message.altitude)
    has_fix = message.status.status >= 0
    yield Pose(_stamp(message.header), _frame(message.header), "", position, has_fix=has_fix)


def _odometry(message: Any) -> Iterable[Pose]:
    yield _pose(message.header, message.pose.pose, message.child_frame_id.lstrip("/"))


def _pose_stamped(message: Any) -> Iterable[Pose]:
    yield _pose(message.header, message.pose)


def _pose_with_covariance(message: Any) -> Iterable[Pose]:
    yield _pose(message.header, message.pose.pose)


def _point(message: Any) -> Iterable[Pose]:
    yield Pose(_stamp(message.header), _frame(message.header), "", _vector(message.point))


def _transform(message: Any) -> Iterable[Pose]:
    moved = message.transform
    yield Pose(
        _stamp(message.header),
        _frame(message.header),
        message.child_frame_id.lstrip("/"),
        _vector(moved.translation),
        _quaternion(moved.rotation),
    )


def _path(message: Any) -> Iterable[Pose]:
    for item in message.poses:
        # A pose of a path may leave its frame to the path.
        pose = _pose(item.header, item.pose)
        yield pose if pose.frame else pose._replace(frame=_frame(message.header))


def _json_fix(message: Any) -> Iterable[Pose]:
    lat, lon = float(message["latitude"]), float(message["longitude"])
    frame = str(message.get("frame_id", ""))
    yield Pose(_json_stamp(message), frame, "", (lat, lon, float(message.get("altitude", 0.0))))


def _json_pose(message: Any) -> Iterable[Pose]:
    pose = message["pose"]
    x, y, z = (float(pose["position"][axis]) for axis in "xyz")
    qx, qy, qz, qw = (float(pose["orientation"][axis]) for axis in "xyzw")
    frame = str(message.get("frame_id", ""))
    yield Pose(_json_stamp(message), frame, "", (x, y, z), (qx, qy, qz, qw))


#: Functions that return the poses of a message, by its type.
POSE_TYPES: dict[str, Callable[[Any], Iterable[Pose]]] = {
    "sensor_msgs/msg/NavSatFix": _fix,
    "nav_msgs/msg/Odometry": _odometry,
    "geometry_msgs/msg/PoseStamped": _pose_stamped,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _pose_with_covariance,
    "geometry_msgs/msg/PointStamped": _point,
    "geometry_msgs/msg/TransformStamped": _transform,
    PATH: _path,
    "foxglove.LocationFix": _json_fix,
    "foxglove.PoseInFrame": _json_pose,
}

#: Types whose positions are latitude and longitude.
GEOGRAPHIC_TYPES = ("sensor_msgs/msg/NavSatFix", "foxglove.LocationFix")


def _pose(header: Any, pose: Any, child: str = "") -> Pose:
    return Pose(
        _stamp(header), _frame(header), child, _vector(pose.position), _quaternion(pose.orientation)
    )


def _stamp(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _frame(header: Any) -> str:
    return str(header.frame_id).lstrip("/")


def _vector(point: Any) -> tuple[float, float, float]:
    return point.x, point.y, point.z


def _quaternion(turn: Any) -> tuple[float, float, float, float]:
    return turn.x, turn.y, turn.z, turn.w


def _json_stamp(message: Any) -> int:
    stamp = message.get("timestamp") or {}
    seconds, nanoseconds = stamp.get("sec", 0), stamp.get("nsec", stamp.get("nanosec", 0))
    total = int(seconds) * 1_000_000_000 + int(nanoseconds)
    # Stamps have 64 bits; JSON may hold any number.
    if abs(total) >= 1 << 63:
        raise ValueError("a stamp out of range")
    return total
