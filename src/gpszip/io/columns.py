"""Which column of a table is what, from the names that people give them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from gpszip.errors import InputError, OptionError

__all__ = ["Roles", "find_roles", "parse_columns", "time_unit_of"]

# In order of preference: a table with trip_id and id is keyed by the trip.
_ID = (
    *("track_id", "trackid", "track", "trajectory_id", "traj_id", "trajectory", "trip_id", "tripid", "trip", "track_name"),
    *("vehicle_id", "vehicleid", "vehicle", "veh_id", "taxi_id", "taxi", "bus_id", "mmsi", "agent_id", "agent", "robot_id", "robot"),
    *(
        "object_id",
        "objectid",
        "individual_local_identifier",
        "user_id",
        "userid",
        "user",
        "uid",
        "uuid",
        "device_id",
        "deviceid",
        "device",
    ),
    *("imei", "tid", "oid", "vid", "run", "walk", "name", "id"),
)
_TIME = (
    *("t", "time", "timestamp", "datetime", "date_time", "timestamps", "time_utc", "utc", "utc_time", "gps_time", "gpstime", "unix_time"),
    *("unixtime", "unix", "epoch", "epoch_time", "ts", "stamp", "seconds", "secs", "sec", "recorded_at", "created_at", "time_stamp"),
    *("header_stamp", "dateandtime", "date_and_time", "local_time", "posix", "time_of_day", "when", "date"),
)
_AXES = {
    "x": ("x", "east", "easting", "pos_x", "position_x", "x_pos", "px", "tx", "utm_x", "x_utm", "p_x", "e"),
    "y": ("y", "north", "northing", "pos_y", "position_y", "y_pos", "py", "ty", "utm_y", "y_utm", "p_y", "n"),
    "z": ("z", "up", "pos_z", "position_z", "z_pos", "pz", "tz", "p_z"),
    "lat": ("lat", "latitude", "gps_lat", "gps_latitude", "location_lat", "position_lat", "latitude_deg", "lat_deg", "lat_wgs84"),
    "lon": (
        *("lon", "lng", "long", "longitude", "gps_lon", "gps_lng", "gps_longitude", "location_long", "location_lon", "position_long"),
        *("position_lon", "longitude_deg", "lon_deg", "lng_deg", "lon_wgs84"),
    ),
}
_HEADING = (
    *("heading", "bearing", "course", "cog", "course_over_ground", "track_angle", "true_track", "true_heading", "hdg", "head"),
    *("gps_heading", "gps_bearing", "gps_course", "ground_course", "direction_of_travel", "azimuth"),
)
_ALT = ("alt", "altitude", "ele", "elevation", "height")
_UNITS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "millis": 1e-3, "milliseconds": 1e-3}
_UNITS |= {"us": 1e-6, "usec": 1e-6, "micros": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "nsec": 1e-9, "nanos": 1e-9, "nanoseconds": 1e-9}
_NEEDED = "needed: t (or time, timestamp) with x,y or lat,lon"


@dataclass(frozen=True)
class Roles:
    """Indices of the columns that matter.

    Parameters
    ----------
    time : tuple of int
        The time; two columns for a date and a time of day.
    axes : tuple of int
        The coordinates: lat, lon or x, y[, z].
    geographic : bool
        Whether the coordinates are degrees.
    id : int, optional
        The name of the track.
    keep : mapping of str to int
        Attributes.
    heading : int, optional
        Where the agent faces, in degrees clockwise from north.
    """

    time: tuple[int, ...]
    axes: tuple[int, ...]
    geographic: bool
    id: int | None
    keep: Mapping[str, int]
    heading: int | None = None

    @property
    def used(self) -> tuple[int, ...]:
        """All columns that are read, each once, in the order of the table."""
        return tuple(sorted({*self.time, *self.axes, *self.keep.values(), *(i for i in (self.id, self.heading) if i is not None)}))


def find_roles(names: Sequence[str], columns: Mapping[str, str] | None, keep: Sequence[str], where: str, *, heading: bool = False) -> Roles:
    """Find out which column is what.

    Parameters
    ----------
    names : sequence of str
        The columns' names as the log gives them.
    columns : mapping of str to str, optional
        The column for some roles (``id``, ``t``, ``x``, ``y``, ``z``, ``lat``, ``lon``, ``heading``), overriding what names suggest.
    keep : sequence of str
        Attributes to keep.
    where : str
        The log's name for messages.
    heading : bool
        Look for headings, too; a log may have none.

    Returns
    -------
    Roles

    Raises
    ------
    InputError
        If the time or the position can't be found, or a column that was named doesn't exist.

    Examples
    --------
    >>> find_roles(["Longitude", "Latitude", "Vehicle ID", "Time (s)"], None, (), "a.csv").axes
    (1, 0)
    """
    plain = [_plain(name) for name in names]
    fixed = {role: _named(names, column, where) for role, column in (columns or {}).items()}
    free = [None if i in fixed.values() else name for i, name in enumerate(plain)]

    def find(role: str, synonyms: Sequence[str]) -> int | None:
        return fixed[role] if role in fixed else next((free.index(word) for word in synonyms if word in free), None)

    axes = {role: find(role, words) for role, words in _AXES.items()}
    degrees = _is_geographic(axes, fixed)
    chosen = [axes[role] for role in (("lat", "lon") if degrees else ("x", "y", "z"))]
    time = _time(plain, find)
    if None in chosen[:2] or not time:
        raise InputError(
            f"{where}: {_lacking(chosen, time)}; columns found: {_listed(names)}; {_NEEDED}; say which is which: --columns t=COLUMN"
        )
    return Roles(
        time=time,
        axes=tuple(axis for axis in chosen if axis is not None),
        geographic=degrees,
        id=find("id", _ID),
        keep={name: _attribute(names, plain, name, where) for name in keep},
        heading=find("heading", _HEADING) if heading else None,
    )


def parse_columns(columns: str | Sequence[str] | Mapping[str, str] | None) -> Mapping[str, str] | tuple[str, ...] | None:
    """Understand what a user says about columns.

    Parameters
    ----------
    columns : str, sequence of str, or mapping of str to str, optional
        ``t,x,y`` names the columns by position (``-`` leaves one out), ``t=when,x=east,y=north`` by name.

    Returns
    -------
    mapping of str to str, tuple of str, or None
        Column of each role, or the names by position.

    Raises
    ------
    OptionError
        If it is neither, or names a role that doesn't exist.

    Examples
    --------
    >>> parse_columns("t,x,y"), parse_columns("t=when")
    (('t', 'x', 'y'), {'t': 'when'})
    """
    if columns is None:
        return None
    if isinstance(columns, Mapping):
        return {_role(role): column for role, column in columns.items()}
    items = [item.strip() for item in columns.split(",")] if isinstance(columns, str) else list(columns)
    pairs = [item.split("=", 1) for item in items if "=" in item]
    if pairs and len(pairs) < len(items):
        raise OptionError(
            f"--columns {','.join(items)}: give names by position (t,x,y) or all of them as ROLE=COLUMN (t=when,x=east,y=north)"
        )
    return {_role(role): column for role, column in pairs} if pairs else tuple(items)


def time_unit_of(name: str) -> float | None:
    """Seconds in the unit that a column's name tells, such as ``time_ms`` or ``Time [s]``.

    Examples
    --------
    >>> time_unit_of("time_ms"), time_unit_of("Timestamp [ns]"), time_unit_of("time")
    (0.001, 1e-09, None)
    """
    words = re.split(r"[^a-z]+", name.lower().strip(" )]"))
    return _UNITS.get(words[-1]) if len(words) > 1 or words[0] in ("seconds", "milliseconds") else None


def _plain(name: str) -> str:
    bare = re.sub(r"[(\[{].*", "", name.strip().lstrip("#").strip().lower())
    bare = re.sub(r"[^0-9a-z]+", "_", bare).strip("_")
    unit = re.fullmatch(r"(.+)_(s|sec|ms|us|ns|m|deg|degrees|seconds|metres|meters)", bare)
    return unit[1] if unit else bare


def _is_geographic(axes: Mapping[str, int | None], fixed: Mapping[str, int]) -> bool:
    if "x" in fixed or "y" in fixed:
        return False
    return (axes["lat"] is not None and axes["lon"] is not None) or axes["x"] is None or axes["y"] is None


def _time(plain: Sequence[str], find: Callable[[str, Sequence[str]], int | None]) -> tuple[int, ...]:
    found = find("t", _TIME)
    if found is None:
        return ()
    if plain[found] in ("t", "time", "time_of_day", "time_utc", "utc_time", "local_time") and "date" in plain:
        return (plain.index("date"), found)
    return (found,)


def _lacking(chosen: Sequence[int | None], time: Sequence[int]) -> str:
    if None in chosen[:2]:
        return "no position" if time else "no time and no position"
    return "no time"


def _named(names: Sequence[str], column: str, where: str) -> int:
    lower = [name.strip().lower() for name in names]
    if column in names:
        return list(names).index(column)
    if column.strip().lower() in lower:
        return lower.index(column.strip().lower())
    raise InputError(f"{where}: no column {column!r}; columns found: {_listed(names)}")


def _attribute(names: Sequence[str], plain: Sequence[str], name: str, where: str) -> int:
    if name not in names and name in _ALT:
        for other in _ALT:
            if other in plain:
                return list(plain).index(other)
    return _named(names, name, where)


def _role(role: str) -> str:
    known = {"id": "id", "track_id": "id", "t": "t", "time": "t", "timestamp": "t"} | {axis: axis for axis in _AXES}
    known |= {"latitude": "lat", "longitude": "lon", "lng": "lon", "heading": "heading"}
    if role.strip().lower() not in known:
        raise OptionError(f"--columns: {role!r} is not one of id, t, x, y, z, lat, lon, heading")
    return known[role.strip().lower()]


def _listed(names: Sequence[str]) -> str:
    shown = [name if len(name) <= 40 else name[:37] + "..." for name in names[:20]]
    return ", ".join(shown) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
