"""Messages of ROS 1 and 2 as rosbridge writes them in JSON.

Format: definitions of sensor_msgs, nav_msgs and geometry_msgs. Positions are degrees or metres,
x to the east and y to the north of a map (REP 103). Unknown numbers are null or NaN.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.values import Context, make_fix, member, to_number

__all__ = ["ROS_TYPES", "agent_of_ros_topic", "frame_of", "is_of_robot", "parse_ros"]

#: Types of messages with positions, the one that is taken first where a robot has several: poses
#: on a map, positions of a receiver, other poses, and odometry, which drifts.
ROS_TYPES = ("PoseWithCovarianceStamped", "NavSatFix", "PoseStamped", "Odometry")

#: Status of NavSatFix without a position.
_NO_FIX = -1

#: Words in names of topics whose poses are those that a robot shall have, not those that it has.
_WISHES = ("goal", "initialpose", "target", "setpoint", "clicked", "waypoint")

#: Letters of a frame that are compared.
_MAX_FRAME_LETTERS = 100

#: Numbers of a covariance of a pose and of a position, which are squares of 6 and 3 rows.
_POSE_COVARIANCE = 36
_POSITION_COVARIANCE = 9


def agent_of_ros_topic(topic: str) -> str:
    """Return the namespace of a topic, which is that of a robot; none for ``/odom``.

    Examples
    --------
    >>> agent_of_ros_topic("/fleet/r2/odom"), agent_of_ros_topic("/odom")
    ('fleet/r2', '')
    """
    return topic.strip("/").rpartition("/")[0]


def is_of_robot(topic: str) -> bool:
    """Whether the poses of a topic are positions of a robot, as far as its name says.

    Examples
    --------
    >>> is_of_robot("/r2/odom"), is_of_robot("/move_base_simple/goal")
    (True, False)
    """
    return not any(word in topic.lower() for word in _WISHES)


def frame_of(message: Any) -> str:
    """Return the frame of a message's coordinates; an empty text where it names none."""
    header = member(message, "header") if isinstance(message, Mapping) else {}
    frame = header.get("frame_id")
    return frame[:_MAX_FRAME_LETTERS] if isinstance(frame, str) else ""


def parse_ros(message: Any, context: Context) -> Fix | Unusable:
    """Return the fix of a message, whose members tell its type.

    Examples
    --------
    >>> stamp = {"sec": 7, "nanosec": 500_000_000}
    >>> pose = {"position": {"x": 1.0, "y": 2.0, "z": 0.0}, "orientation": {"z": 0.0, "w": 1.0}}
    >>> fix = parse_ros({"header": {"stamp": stamp}, "pose": pose}, Context(9.0, "ros", "r2"))
    >>> fix.time, fix.position, fix.heading, fix.kind
    (7.5, (1.0, 2.0), 90.0, 'PoseStamped')
    """
    if not isinstance(message, Mapping):
        return Unusable(context.agent, "messages that are no object of JSON left out")
    time = _time(member(message, "header"))
    if "latitude" in message:
        return _parse_navsat(message, time, context)

    # A pose may have a covariance, and odometry has a speed, too.
    stamped = member(message, "pose")
    with_covariance = member(stamped, "pose")
    pose = with_covariance or stamped
    position = member(pose, "position")
    velocity = member(member(member(message, "twist"), "twist"), "linear")
    plain = "PoseWithCovarianceStamped" if with_covariance else "PoseStamped"
    return make_fix(
        context,
        context.agent,
        time,
        (to_number(position.get("x")), to_number(position.get("y"))),
        kind="Odometry" if velocity else plain,
        accuracy=_accuracy(stamped.get("covariance"), _POSE_COVARIANCE, 7),
        heading=_heading(member(pose, "orientation")),
        speed=_length(velocity.get("x"), velocity.get("y")),
        geographic=False,
    )


def _parse_navsat(
    message: Mapping[str, Any], time: float | None, context: Context
) -> Fix | Unusable:
    if to_number(member(message, "status").get("status")) == _NO_FIX:
        return Unusable(context.agent, "messages of receivers without a fix left out")
    is_known = to_number(message.get("position_covariance_type")) != 0
    covariance = message.get("position_covariance") if is_known else None
    return make_fix(
        context,
        context.agent,
        time,
        (to_number(message.get("latitude")), to_number(message.get("longitude"))),
        kind="NavSatFix",
        accuracy=_accuracy(covariance, _POSITION_COVARIANCE, 4),
    )


def _time(header: Mapping[str, Any]) -> float | None:
    """Time of a header of ROS 2 or 1; none where it is 0, as nobody set it."""
    stamp = member(header, "stamp")
    seconds = to_number(stamp.get("sec", stamp.get("secs")))
    parts = to_number(stamp.get("nanosec", stamp.get("nsecs")))
    if seconds is None or parts is None or (seconds == 0 and parts == 0):
        return None
    return round(seconds + parts * 1e-9, 9)


def _accuracy(covariance: Any, size: int, second: int) -> float | None:
    """Root mean square of the distance from the true place; None where it isn't known."""
    if not isinstance(covariance, list) or len(covariance) != size:
        return None
    east, north = to_number(covariance[0]), to_number(covariance[second])
    if east is None or north is None or east < 0 or north < 0:
        return None
    return round(math.sqrt(east + north), 6)


def _heading(orientation: Mapping[str, Any]) -> float | None:
    """Degrees clockwise from north of a quaternion: its yaw is counter-clockwise from east."""
    x, y, z, w = (to_number(orientation.get(name, 0.0)) for name in "xyzw")
    if x is None or y is None or z is None or w is None or not (z or w):
        return None
    if max(abs(x), abs(y), abs(z), abs(w)) > 2:
        return None
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return round((90.0 - math.degrees(yaw)) % 360, 6)


def _length(x: Any, y: Any) -> float | None:
    east, north = to_number(x), to_number(y)
    return None if east is None or north is None else round(math.hypot(east, north), 6)
