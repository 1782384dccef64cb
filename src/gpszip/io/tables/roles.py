"""Which column of a table is what, from the names that people give them.

A name is one of a list, or it is none: names are not guessed from their parts. Where several columns fit, the name that
stands first in the list wins; where two columns have the same name, the table is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from gpszip.errors import InputError, OptionError
from gpszip.io.values.coordinates import HEMISPHERES, Axis

__all__ = ["Roles", "find_roles", "parse_columns", "time_unit_in_name"]


def _words(text: str) -> tuple[str, ...]:
    return tuple(text.replace("_", "").split())


# Names are compared without case, punctuation and units: `Track-ID`, `trackId` and `track_id` are one. All lists are in
# order of preference. First comes what names a trip, then what names a vehicle or a person, then what may be anything.
_ID = _words("""
    track_id track trajectory_id traj_id trajectory trip_id trip track_name journey_id ride_id activity_id session_id
    vehicle_id vehicle veh_id vehicle_ref taxi_id taxi bus_id car_id bike_id mmsi source_mmsi ship_id vessel_id
    icao24 flight_id callsign agent_id agent robot_id robot object_id
    individual_local_identifier individual_id tag_local_identifier tag_id animal_id bird_id
    user_id user driver_id person_id participant_id uid uuid
    device_id device tracker_id unit_id terminal_id asset_id imei tid oid vid run walk name id
""")

# A bare time comes first, then times that say UTC, those of the receiver, of computers, of what happened when,
# and local times last: their zone is not known.
_TIME = _words("""
    t time timestamp datetime date_time timestamps
    time_utc utc utc_time timestamp_utc time_stamp_utc utc_timestamp datetime_utc utc_datetime utc_date_time
    date_time_utc base_date_time gmt
    gps_time gps_timestamp gps_time_stamp gps_datetime gps_date_time gps_utc gps_utc_time gps_epoch fix_time fix_timestamp
    location_time location_timestamp location_timestamp_since1970 position_time position_timestamp vehicle_timestamp
    unix_time unix_timestamp unix epoch epoch_time epoch_timestamp timestamp_epoch timestamp_unix time_epoch time_unix
    posix posix_time ts tst stamp time_stamp header_stamp
    seconds secs sec elapsed elapsed_time time_elapsed seconds_elapsed elapsed_seconds
    recorded_at tracked_at measured_at captured_at observed_at sampled_at logged_at recorded_at_time
    record_time recording_time log_time logging_time sample_time measurement_time observation_time acquisition_time
    event_time event_timestamp reported_at created_at device_time received_at server_time
    local_time local_timestamp local_datetime time_local timestamp_local datetime_local local_date_time
    date_and_time time_of_day when date
""")
_AXES = {
    "x": _words("x east easting pos_x position_x x_pos px tx utm_x x_utm e"),
    "y": _words("y north northing pos_y position_y y_pos py ty utm_y y_utm n"),
    "z": _words("z up pos_z position_z z_pos pz tz"),
    "lat": _words("""
        lat latitude gps_lat gps_latitude location_lat location_latitude position_lat position_latitude pos_lat
        vehicle_lat vehicle_latitude vehicle_location_latitude lat_wgs84 wgs84_lat lat_dd latitude_dd
        latitude_n_s latitude_ns lat_n_s lat_ns coords_latitude geo_lat latitud breitengrad
"""),
    "lon": _words("""
        lon lng long longitude gps_lon gps_lng gps_long gps_longitude location_long location_lon location_lng
        location_longitude position_long position_lon position_lng position_longitude pos_lon pos_lng
        vehicle_lon vehicle_lng vehicle_longitude vehicle_location_longitude lon_wgs84 wgs84_lon lon_dd longitude_dd
        longitude_e_w longitude_ew lon_e_w lon_ew coords_longitude geo_lon geo_lng longitud laengengrad
"""),
}

#: Columns that say on which side of the equator or of Greenwich a position is.
_HEMISPHERE_NAMES: dict[Axis, tuple[str, ...]] = {
    "lat": _words("""
        n_s ns lat_hemisphere latitude_hemisphere lat_hemi lat_dir latitude_dir lat_direction latitude_direction
        lat_ref latitude_ref gps_lat_ref gps_latitude_ref n_s_indicator ns_indicator n_s_hemisphere
"""),
    "lon": _words("""
        e_w ew w_e lon_hemisphere long_hemisphere longitude_hemisphere lon_hemi long_hemi lon_dir lng_dir long_dir
        longitude_dir lon_direction longitude_direction lon_ref lng_ref long_ref longitude_ref gps_lon_ref gps_lng_ref
        gps_longitude_ref e_w_indicator ew_indicator e_w_hemisphere
"""),
}
_HEADING = _words("""
    heading bearing course cog course_over_ground track_angle true_track true_heading hdg head
    gps_heading gps_bearing gps_course ground_course direction_of_travel azimuth
""")
_ALT = ("alt", "altitude", "ele", "elevation", "height")

#: So far from a coordinate a column without a telling name may say on which side it is: lat, lon, side, side.
_MAX_HEMISPHERE_OFFSET = 3

#: Names of times that may stand beside a date, and names of such dates.
_CLOCKS = _words("t time time_of_day time_utc utc_time utc local_time gps_time")
_DATES = _words("date utc_date date_utc gps_date local_date")

_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), 1e-9),
}
_UNIT = re.compile(rf"(.+)_({'|'.join(_UNITS)}|m|deg|degrees|metres|meters)")
_NEEDED = "needed: t (or time, timestamp) with x,y or lat,lon"


@dataclass(frozen=True)
class Roles:
    """Indices of the columns that matter.

    Parameters
    ----------
    time : tuple of int
        The time; two columns for a date and a time of day, none for a table of shapes.
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
    hemispheres : tuple of int or None
        For the latitude and the longitude, the column that says N, S, E or W; empty where there is none for either.
    """

    time: tuple[int, ...]
    axes: tuple[int, ...]
    geographic: bool
    id: int | None
    keep: Mapping[str, int]
    heading: int | None = None
    hemispheres: tuple[int | None, ...] = ()

    @property
    def used(self) -> tuple[int, ...]:
        """All columns that are read, each once, in the order of the table."""
        perhaps = (self.id, self.heading, *self.hemispheres)
        return tuple(
            sorted(
                {
                    *self.time,
                    *self.axes,
                    *self.keep.values(),
                    *(i for i in perhaps if i is not None),
                }
            )
        )


def find_roles(
    names: Sequence[str],
    columns: Mapping[str, str] | None,
    keep: Sequence[str],
    where: str,
    *,
    heading: bool = False,
    cells: Callable[[int], Sequence[str]] | None = None,
    times: bool = True,
) -> Roles:
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
    cells : callable, optional
        Returns some of the texts of a column, so that columns of N, S, E and W are found whatever their names.
    times : bool, default True
        Whether there must be a column of times.

    Returns
    -------
    Roles

    Raises
    ------
    InputError
        If the time or the position can't be found, a column that was named doesn't exist, or two columns have its name.

    Examples
    --------
    >>> find_roles(["Longitude", "Latitude", "Vehicle ID", "Time (s)"], None, (), "a.csv").axes
    (1, 0)
    """
    plain = [_normalise_name(name) for name in names]
    fixed = {role: _find_named(names, column, where) for role, column in (columns or {}).items()}
    free = {name: i for i, name in reversed(list(enumerate(plain))) if i not in fixed.values()}

    def find(role: str, synonyms: Sequence[str]) -> int | None:
        if role in fixed:
            return fixed[role]
        found = next((free[word] for word in synonyms if word in free), None)
        return None if found is None else _require_unique(names, found, where)

    # The position: degrees where there are some, unless x or y was named.
    degrees = False
    chosen = [find(role, _AXES[role]) for role in ("x", "y", "z")]
    if not fixed.keys() & {"x", "y"}:
        place = [find(role, _AXES[role]) for role in ("lat", "lon")]
        degrees = None not in place or None in chosen[:2]
        chosen = place if degrees else chosen

    # The time.
    time = _find_time(plain, find)
    if None in chosen[:2] or (times and not time):
        shapes = "" if None in chosen[:2] else "; or keep the shape alone: --no-times"
        raise InputError(
            f"{where}: {_describe_missing(chosen, time)}; columns found: {_list_names(names)}; {_NEEDED}; say which is which: --columns t=COLUMN{shapes}"
        )

    # All else.
    roles = Roles(
        time=time,
        axes=tuple(axis for axis in chosen if axis is not None),
        geographic=degrees,
        id=find("id", _ID),
        keep={name: _find_attribute(names, plain, name, where) for name in keep},
        heading=find("heading", _HEADING) if heading else None,
    )
    return (
        replace(roles, hemispheres=_find_hemispheres(names, roles, find, cells, where))
        if degrees
        else roles
    )


def parse_columns(
    columns: str | Sequence[str] | Mapping[str, str] | None,
) -> Mapping[str, str] | tuple[str, ...] | None:
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
        return {_canonical_role(role): column for role, column in columns.items()}
    items = (
        [item.strip() for item in columns.split(",")] if isinstance(columns, str) else list(columns)
    )
    pairs = [item.split("=", 1) for item in items if "=" in item]
    if pairs and len(pairs) < len(items):
        raise OptionError(
            f"--columns {','.join(items)}: give names by position (t,x,y) or all of them as ROLE=COLUMN (t=when,x=east,y=north)"
        )
    return {_canonical_role(role): column for role, column in pairs} if pairs else tuple(items)


def time_unit_in_name(name: str) -> float | None:
    """Seconds in the unit that a column's name tells, such as ``time_ms`` or ``Time [s]``.

    Examples
    --------
    >>> time_unit_in_name("time_ms"), time_unit_in_name("Timestamp [ns]"), time_unit_in_name("time")
    (0.001, 1e-09, None)
    """
    words = re.split(r"[^a-z]+", _separate_words(name).lower().strip(" )]"))
    return (
        _UNITS.get(words[-1]) if len(words) > 1 or words[0] in ("seconds", "milliseconds") else None
    )


def _normalise_name(name: str) -> str:
    """Return a name without case, punctuation and unit: ``Time_UTC [s]`` is ``timeutc``."""
    bare = re.sub(r"[(\[{].*", "", _separate_words(name.strip().lstrip("#").strip()).lower())
    bare = re.sub(r"[^0-9a-z]+", "_", bare).strip("_")
    unit = _UNIT.fullmatch(bare)
    return (unit[1] if unit and not re.search(r"(^|_)n_s$", bare) else bare).replace("_", "")


def _separate_words(name: str) -> str:
    """Set the words of ``gpsTime`` and ``GPSLatitude`` apart."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)


def _find_time(
    plain: Sequence[str], find: Callable[[str, Sequence[str]], int | None]
) -> tuple[int, ...]:
    found = find("t", _TIME)
    if found is None:
        return ()
    date = next((plain.index(word) for word in _DATES if word in plain), None)
    if date is not None and date != found and plain[found] in _CLOCKS:
        return (date, found)
    return (found,)


def _find_hemispheres(
    names: Sequence[str],
    roles: Roles,
    find: Callable[[str, Sequence[str]], int | None],
    cells: Callable[[int], Sequence[str]] | None,
    where: str,
) -> tuple[int | None, ...]:
    """Columns of N, S, E and W: by their names, else by what they hold, if there is one for either axis."""
    found: dict[Axis, int | None] = {
        axis: find(f"{axis} side", words) for axis, words in _HEMISPHERE_NAMES.items()
    }
    unnamed: dict[Axis, int] = {}
    for axis, place in zip(found, roles.axes, strict=True):
        near = (
            []
            if cells is None or found[axis] is not None
            else _columns_near(place, {*roles.used, *found.values()}, len(names))
        )
        at = next(
            (i for i in near if cells is not None and _holds_hemispheres(cells(i), axis)), None
        )
        if at is not None:
            unnamed[axis] = at
    if len(unnamed) == 1 and found == {"lat": None, "lon": None}:
        ((axis, at),) = unnamed.items()
        raise InputError(
            f"{where}: column {names[at]!r} holds only {'N or S' if axis == 'lat' else 'E or W'}, which may be the sign of {axis}; "
            f"name all columns in their order, and this one {axis}_hemisphere, or - if it isn't: --columns t,lat,-,lon"
        )
    sides = tuple((found | unnamed)[axis] for axis in found)
    return sides if any(side is not None for side in sides) else ()


def _columns_near(place: int, taken: set[int | None], width: int) -> list[int]:
    """Columns around one, the next to the right first."""
    around = [
        place + sign * step for step in range(1, _MAX_HEMISPHERE_OFFSET + 1) for sign in (1, -1)
    ]
    return [i for i in around if 0 <= i < width and i not in taken]


def _holds_hemispheres(cells: Sequence[str], axis: Axis) -> bool:
    return len(cells) > 0 and all(cell.strip().lower() in HEMISPHERES[axis] for cell in cells)


def _describe_missing(chosen: Sequence[int | None], time: Sequence[int]) -> str:
    if None in chosen[:2]:
        return "no position" if time else "no time and no position"
    return "no time"


def _require_unique(names: Sequence[str], index: int, where: str) -> int:
    """Return the index if no other column has the same name."""
    title = names[index].strip().lower()
    same = [i for i, name in enumerate(names) if name.strip().lower() == title]
    if len(same) > 1:
        raise InputError(
            f"{where}: columns {same[0] + 1} and {same[1] + 1} are both named {names[index]!r}; "
            "name all columns in their order: --columns t,lat,lon,-"
        )
    return index


def _find_named(names: Sequence[str], column: str, where: str) -> int:
    lower = [name.strip().lower() for name in names]
    if list(names).count(column) == 1:
        return list(names).index(column)
    if column.strip().lower() in lower:
        return _require_unique(names, lower.index(column.strip().lower()), where)
    raise InputError(f"{where}: no column {column!r}; columns found: {_list_names(names)}")


def _find_attribute(names: Sequence[str], plain: Sequence[str], name: str, where: str) -> int:
    if name not in names and name in _ALT:
        for other in _ALT:
            if other in plain:
                return list(plain).index(other)
    return _find_named(names, name, where)


def _canonical_role(role: str) -> str:
    known = {"id": "id", "track_id": "id", "t": "t", "time": "t", "timestamp": "t"} | {
        axis: axis for axis in _AXES
    }
    known |= {"latitude": "lat", "longitude": "lon", "lng": "lon", "heading": "heading"}
    if role.strip().lower() not in known:
        raise OptionError(f"--columns: {role!r} is not one of id, t, x, y, z, lat, lon, heading")
    return known[role.strip().lower()]


def _list_names(names: Sequence[str]) -> str:
    shown = [name if len(name) <= 40 else name[:37] + "..." for name in names[:20]]
    return ", ".join(shown) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
