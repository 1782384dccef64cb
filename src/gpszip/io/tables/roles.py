"""The roles of a table's columns (time, position, track id and so on), found from their names.

A name has a role only if it is in a list of synonyms; fragments of names don't count. If several
columns fit, the synonym that is first in the list wins. A table with two columns of the same name
is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from gpszip.errors import InputError, NoPositionsError, OptionError
from gpszip.io.logs.raw import HEIGHT_NAMES
from gpszip.io.values.coordinates import HEMISPHERES, Axis

__all__ = ["Roles", "find_roles", "names_accuracy", "parse_columns", "time_unit_in_name"]


def _words(text: str) -> tuple[str, ...]:
    # The lists are easier to read with underscores, but names are compared without them.
    return tuple(text.replace("_", "").split())


# Names are compared without case, punctuation and units: `Track-ID`, `trackId` and `track_id` are
# the same. All lists are in order of preference. Names of trips come first, then those of vehicles
# and persons, then unspecific ones.
_ID = _words("""
    track_id track trajectory_id traj_id trajectory trip_id trip track_name journey_id ride_id
    activity_id session_id
    vehicle_id vehicle veh_id vehicle_ref taxi_id taxi bus_id car_id bike_id mmsi source_mmsi
    ship_id vessel_id
    icao24 flight_id callsign agent_id agent robot_id robot object_id
    individual_local_identifier individual_id tag_local_identifier tag_id animal_id bird_id
    user_id user driver_id person_id participant_id uid uuid
    device_id device tracker_id unit_id terminal_id asset_id imei tid oid vid run walk name id
""")

# Plain names of times come first, then UTC times, those of receivers, of computers and of events.
# Local times come last: their zone is unknown.
_TIME = _words("""
    t time timestamp datetime date_time timestamps
    time_utc utc utc_time timestamp_utc time_stamp_utc utc_timestamp datetime_utc utc_datetime
    utc_date_time
    date_time_utc base_date_time gmt
    gps_time gps_timestamp gps_time_stamp gps_datetime gps_date_time gps_utc gps_utc_time gps_epoch
    fix_time fix_timestamp
    location_time location_timestamp location_timestamp_since1970 position_time position_timestamp
    vehicle_timestamp
    unix_time unix_timestamp unix epoch epoch_time epoch_timestamp timestamp_epoch timestamp_unix
    time_epoch time_unix
    posix posix_time ts tst stamp time_stamp header_stamp
    seconds secs sec elapsed elapsed_time time_elapsed seconds_elapsed elapsed_seconds
    recorded_at tracked_at measured_at captured_at observed_at sampled_at logged_at recorded_at_time
    record_time recording_time log_time logging_time sample_time measurement_time observation_time
    acquisition_time
    event_time event_timestamp reported_at created_at device_time received_at server_time
    local_time local_timestamp local_datetime time_local timestamp_local datetime_local
    local_date_time
    date_and_time time_of_day when date
""")

#: Names of the coordinates.
_AXES = {
    "x": _words("x east easting pos_x position_x x_pos px tx utm_x x_utm e"),
    "y": _words("y north northing pos_y position_y y_pos py ty utm_y y_utm n"),
    "z": _words("z up pos_z position_z z_pos pz tz"),
    "lat": _words("""
        lat latitude gps_lat gps_latitude location_lat location_latitude position_lat
        position_latitude pos_lat
        vehicle_lat vehicle_latitude vehicle_location_latitude lat_wgs84 wgs84_lat lat_dd
        latitude_dd
        latitude_n_s latitude_ns lat_n_s lat_ns coords_latitude geo_lat latitud breitengrad
"""),
    "lon": _words("""
        lon lng long longitude gps_lon gps_lng gps_long gps_longitude location_long location_lon
        location_lng
        location_longitude position_long position_lon position_lng position_longitude pos_lon
        pos_lng
        vehicle_lon vehicle_lng vehicle_longitude vehicle_location_longitude lon_wgs84 wgs84_lon
        lon_dd longitude_dd
        longitude_e_w longitude_ew lon_e_w lon_ew coords_longitude geo_lon geo_lng longitud
        laengengrad
"""),
}

#: Names of columns with hemispheres: the side of the equator or of Greenwich.
_HEMISPHERE_NAMES: dict[Axis, tuple[str, ...]] = {
    "lat": _words("""
        n_s ns lat_hemisphere latitude_hemisphere lat_hemi lat_dir latitude_dir lat_direction
        latitude_direction
        lat_ref latitude_ref gps_lat_ref gps_latitude_ref n_s_indicator ns_indicator n_s_hemisphere
"""),
    "lon": _words("""
        e_w ew w_e lon_hemisphere long_hemisphere longitude_hemisphere lon_hemi long_hemi lon_dir
        lng_dir long_dir
        longitude_dir lon_direction longitude_direction lon_ref lng_ref long_ref longitude_ref
        gps_lon_ref gps_lng_ref
        gps_longitude_ref e_w_indicator ew_indicator e_w_hemisphere
"""),
}

#: Names of headings.
_HEADING = _words("""
    heading bearing course cog course_over_ground track_angle true_track true_heading hdg head
    gps_heading gps_bearing gps_course ground_course direction_of_travel azimuth
""")

#: Names of errors of positions in metres. HDOP and its like are factors, no lengths.
_ACCURACY = _words("""
    accuracy horizontal_accuracy gps_accuracy location_accuracy position_accuracy accuracy_meters
    accuracy_metres h_accuracy haccuracy h_acc hacc acc eph est_horizontal_error
    estimated_horizontal_error location_horizontal_accuracy horizontal_error
""")

#: Largest number of columns from a coordinate to a column of hemispheres with any other name, as in
#: lat, lon, hemisphere of lat, hemisphere of lon.
_MAX_HEMISPHERE_OFFSET = 3

#: Names of times that may be times of day beside a date.
_CLOCKS = _words("t time time_of_day time_utc utc_time utc local_time gps_time")

#: Names of such dates.
_DATES = _words("date utc_date date_utc gps_date local_date")

#: Seconds in the units of time that may end a name.
_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), 1e-9),
}

#: A name that ends with a unit.
_UNIT = re.compile(rf"(.+)_({'|'.join(_UNITS)}|m|deg|degrees|metres|meters)")

#: A role of a coordinate by its number.
_NUMBERED = re.compile(r"x\d{1,3}")

#: Number of names that messages show.
_MAX_SHOWN_NAMES = 20

#: Number of letters of a name that messages show.
_MAX_SHOWN_LETTERS = 40

#: What messages say about a table without time or position.
_NEEDED = "needed: t (or time, timestamp) with x,y or lat,lon"


@dataclass(frozen=True)
class Roles:
    """Indices of the columns with a role.

    Parameters
    ----------
    time : tuple of int
        Time; two columns for a date and a time of day, none for a table of shapes.
    axes : tuple of int
        Coordinates: lat, lon or x, y[, z[, x4, ...]] or x0, x1, ...
    geographic : bool
        Whether coordinates are degrees.
    id : int, optional
        Name of the track.
    keep : mapping of str to int
        Attributes to keep, by name.
    heading : int, optional
        Heading in degrees clockwise from north.
    accuracy : int, optional
        Error of the position in metres.
    hemispheres : tuple of int or None
        Hemispheres of latitude and longitude, None for an axis without; empty if there are none.
    """

    time: tuple[int, ...]
    axes: tuple[int, ...]
    geographic: bool
    id: int | None
    keep: Mapping[str, int]
    heading: int | None = None
    accuracy: int | None = None
    hemispheres: tuple[int | None, ...] = ()

    @property
    def used(self) -> tuple[int, ...]:
        """All columns to read, without duplicates, in the order of the table."""
        optional = (self.id, self.heading, self.accuracy, *self.hemispheres)
        given = (i for i in optional if i is not None)
        return tuple(sorted({*self.time, *self.axes, *self.keep.values(), *given}))


def find_roles(
    names: Sequence[str],
    columns: Mapping[str, str] | None,
    keep: Sequence[str],
    where: str,
    *,
    heading: bool = False,
    accuracy: bool = False,
    cells: Callable[[int], Sequence[str]] | None = None,
    times: bool = True,
    optional: Sequence[str] = (),
) -> Roles:
    """Find the roles of a table's columns.

    Parameters
    ----------
    names : sequence of str
        Names of the columns in the log.
    columns : mapping of str to str, optional
        Columns for some roles (``id``, ``t``, ``x``, ``y``, ``z``, ``x0``, ``x1``, ..., ``lat``,
        ``lon``, ``heading``), which override synonyms.
    keep : sequence of str
        Attributes to keep.
    where : str
        Name of the log for messages.
    heading, accuracy : bool, default False
        Whether to look for headings, and for errors of positions; a log may have none.
    cells : callable, optional
        Returns some of the texts of a column. With it, columns of N, S, E and W are found also by
        their content.
    times : bool, default True
        Whether a column of times is required.
    optional : sequence of str
        Names of heights in ``keep`` that may be missing.

    Returns
    -------
    Roles

    Raises
    ------
    InputError
        If time or position can't be found, a given column doesn't exist, or its name is not unique.

    Examples
    --------
    >>> find_roles(["Longitude", "Latitude", "Vehicle ID", "Time (s)"], None, (), "a.csv").axes
    (1, 0)
    """
    # Columns that the user has given, and the others by name, the first of each name.
    plain = [_normalise_name(name) for name in names]
    fixed = {role: _find_named(names, column, where) for role, column in (columns or {}).items()}
    free = {name: i for i, name in reversed(list(enumerate(plain))) if i not in fixed.values()}

    # A column that the user has given overrides synonyms, whose order is their rank.
    def find(role: str, synonyms: Sequence[str]) -> int | None:
        # Who numbers some axes means no others.
        if role in fixed or (_NUMBERED.fullmatch(role) and any(map(_NUMBERED.fullmatch, fixed))):
            return fixed.get(role)
        index = next((free[word] for word in synonyms if word in free), None)
        return None if index is None else _require_unique(names, index, where)

    # The position: degrees if there are any, unless x or y was given.
    geographic = False
    axes = _find_axes(find)
    if not fixed.keys() & {"x", "y", "x0", "x1"}:
        degrees = [find(role, _AXES[role]) for role in ("lat", "lon")]
        geographic = None not in degrees or None in axes[:2]
        axes = degrees if geographic else axes

    # The time.
    time = _find_time(plain, find)
    if None in axes[:2] or (times and not time):
        shapes = "" if None in axes[:2] else "; or keep the shape alone: --no-times"
        kind = NoPositionsError if None in axes[:2] else InputError
        raise kind(
            f"{_describe_missing(axes, time)}; columns found: {_list_names(names)}",
            path=where,
            remedy=f"{_NEEDED}; say which is which: --columns t=COLUMN{shapes}",
        )

    # Other roles.
    roles = Roles(
        time=time,
        axes=tuple(axis for axis in axes if axis is not None),
        geographic=geographic,
        id=find("id", _ID),
        keep={
            name: _find_attribute(names, plain, name, where)
            for name in keep
            if name not in optional or {name, *HEIGHT_NAMES} & {*names, *plain}
        },
        heading=find("heading", _HEADING) if heading else None,
        accuracy=find("accuracy", _ACCURACY) if accuracy else None,
    )
    if not geographic:
        return roles
    return replace(roles, hemispheres=_find_hemispheres(names, roles, find, cells, where))


def _find_axes(find: Callable[[str, Sequence[str]], int | None]) -> list[int | None]:
    """Columns of the coordinates in metres: x, y, z, x4, x5, ..., or x0, x1, x2, ...

    The former are the names that GPSZip writes. Without x and y, their columns are None.
    """
    # Numbered from 0.
    axes = [find(role, _AXES[role]) for role in ("x", "y", "z")]
    numbered = _find_numbered(find, 0)
    if None in axes[:2] and len(numbered) > 1:
        return list(numbered)

    # Further ones follow z.
    return axes if None in axes else [*axes, *_find_numbered(find, len(axes) + 1)]


def _find_numbered(find: Callable[[str, Sequence[str]], int | None], first: int) -> list[int]:
    """Columns x4, x5, ... from a number on, as far as there are some."""
    found: list[int] = []
    while (index := find(f"x{first + len(found)}", (f"x{first + len(found)}",))) is not None:
        found.append(index)
    return found


def parse_columns(
    columns: str | Sequence[str] | Mapping[str, str] | None,
) -> Mapping[str, str] | tuple[str, ...] | None:
    """Parse the columns that a user gives.

    Parameters
    ----------
    columns : str, sequence of str, or mapping of str to str, optional
        ``t,x,y`` gives roles by position (``-`` for a column without), ``t=when,x=east,y=north``
        gives columns by name.

    Returns
    -------
    mapping of str to str, tuple of str, or None
        Column of each role, or roles by position.

    Raises
    ------
    OptionError
        If it is neither, or gives a role that doesn't exist.

    Examples
    --------
    >>> parse_columns("t,x,y"), parse_columns("t=when")
    (('t', 'x', 'y'), {'t': 'when'})
    """
    # Columns by name need no parsing but of their roles.
    if columns is None:
        return None
    if isinstance(columns, Mapping):
        return {_canonical_role(role): column for role, column in columns.items()}

    # Split the text; either all items or none are pairs.
    if isinstance(columns, str):
        columns = [item.strip() for item in columns.split(",")]
    items = list(columns)
    pairs = [item.split("=", 1) for item in items if "=" in item]
    if pairs and len(pairs) < len(items):
        raise OptionError(
            f"--columns {','.join(items)}: give names by position (t,x,y) or all of them as "
            "ROLE=COLUMN (t=when,x=east,y=north)"
        )
    return {_canonical_role(role): column for role, column in pairs} if pairs else tuple(items)


def time_unit_in_name(name: str) -> float | None:
    """Seconds in the unit that ends a column's name, such as ``time_ms`` or ``Time [s]``, if any.

    Examples
    --------
    >>> time_unit_in_name("time_ms"), time_unit_in_name("Timestamp [ns]"), time_unit_in_name("time")
    (0.001, 1e-09, None)
    """
    words = re.split(r"[^a-z]+", _separate_words(name).lower().strip(" )]"))
    # A single word such as `s` or `ms` may stand for anything; only these two are clear.
    has_unit = len(words) > 1 or words[0] in ("seconds", "milliseconds")
    return _UNITS.get(words[-1]) if has_unit else None


def names_accuracy(name: str) -> bool:
    """Whether a column of this name holds errors of positions in metres.

    Examples
    --------
    >>> names_accuracy("horizontalAccuracy"), names_accuracy("hdop")
    (True, False)
    """
    return _normalise_name(name) in _ACCURACY


def _normalise_name(name: str) -> str:
    """Return a name without case, punctuation and unit: ``Time_UTC [s]`` becomes ``timeutc``."""
    # Drop comments in brackets, and separate words by underscores.
    words = re.sub(r"[(\[{].*", "", _separate_words(name.strip().lstrip("#").strip()).lower())
    words = re.sub(r"[^0-9a-z]+", "_", words).strip("_")

    # Drop the unit; but n_s are hemispheres, not seconds.
    unit = _UNIT.fullmatch(words)
    if unit and not re.search(r"(^|_)n_s$", words):
        words = unit[1]
    return words.replace("_", "")


def _separate_words(name: str) -> str:
    """Insert underscores between the words of ``gpsTime`` and ``GPSLatitude``."""
    # A word begins at a capital after a small letter or a digit (gps|Time), and at the last of
    # several capitals (GPS|Latitude).
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)


def _find_time(
    plain: Sequence[str], find: Callable[[str, Sequence[str]], int | None]
) -> tuple[int, ...]:
    """Column of times, preceded by a column of dates if they may be times of day."""
    time = find("t", _TIME)
    if time is None:
        return ()
    # Times that may hold dates themselves, such as `timestamp`, are not joined with a date.
    date = next((plain.index(word) for word in _DATES if word in plain), None)
    if date is not None and date != time and plain[time] in _CLOCKS:
        return (date, time)
    return (time,)


def _find_hemispheres(
    names: Sequence[str],
    roles: Roles,
    find: Callable[[str, Sequence[str]], int | None],
    cells: Callable[[int], Sequence[str]] | None,
    where: str,
) -> tuple[int | None, ...]:
    """Columns of N, S, E and W, by name or else by content; empty if there are none.

    Raises
    ------
    InputError
        If only one axis has such a column by content: it may be something else.
    """
    # By name.
    # A role `lat side` is none that a user can name, so find() looks up synonyms only.
    named: dict[Axis, int | None] = {
        axis: find(f"{axis} side", words) for axis, words in _HEMISPHERE_NAMES.items()
    }

    # By content, in columns around the coordinate.
    by_content: dict[Axis, int] = {}
    for axis, column in zip(named, roles.axes, strict=True):
        if cells is None or named[axis] is not None:
            continue
        for candidate in _columns_near(column, {*roles.used, *named.values()}, len(names)):
            if _holds_hemispheres(cells(candidate), axis):
                by_content[axis] = candidate
                break

    # Refuse a single column found by its content alone: it may be something else.
    if len(by_content) == 1 and named == {"lat": None, "lon": None}:
        ((axis, index),) = by_content.items()
        sides = "N or S" if axis == "lat" else "E or W"
        raise InputError(
            f"column {names[index]!r} holds only {sides}, which may be the sign of {axis}",
            path=where,
            remedy=f"name all columns in their order, and this one {axis}_hemisphere, or - if it "
            "isn't: --columns t,lat,-,lon",
        )
    hemispheres = tuple((named | by_content)[axis] for axis in named)
    return hemispheres if any(column is not None for column in hemispheres) else ()


def _columns_near(column: int, taken: set[int | None], width: int) -> list[int]:
    """Free columns around a column, nearest first, right before left."""
    offsets = range(1, _MAX_HEMISPHERE_OFFSET + 1)
    around = [column + sign * offset for offset in offsets for sign in (1, -1)]
    return [i for i in around if 0 <= i < width and i not in taken]


def _holds_hemispheres(cells: Sequence[str], axis: Axis) -> bool:
    """Whether all cells are hemispheres of an axis."""
    # An empty column would pass all(), but it shows nothing.
    return len(cells) > 0 and all(cell.strip().lower() in HEMISPHERES[axis] for cell in cells)


def _describe_missing(axes: Sequence[int | None], time: Sequence[int]) -> str:
    if None in axes[:2]:
        return "no position" if time else "no time and no position"
    return "no time"


def _require_unique(names: Sequence[str], index: int, where: str) -> int:
    """Return the index of a column if no other column has the same name."""
    title = names[index].strip().lower()
    same = [i for i, name in enumerate(names) if name.strip().lower() == title]
    if len(same) > 1:
        raise InputError(
            f"columns {same[0] + 1} and {same[1] + 1} are both named {names[index]!r}",
            path=where,
            remedy="name all columns in their order: --columns t,lat,lon,-",
        )
    return index


def _find_named(names: Sequence[str], column: str, where: str) -> int:
    """Index of the column with a name; upper and lower case differ only if both exist."""
    lower = [name.strip().lower() for name in names]
    if list(names).count(column) == 1:
        return list(names).index(column)
    if column.strip().lower() in lower:
        return _require_unique(names, lower.index(column.strip().lower()), where)
    raise InputError(f"no column {column!r}; columns found: {_list_names(names)}", path=where)


def _find_attribute(names: Sequence[str], plain: Sequence[str], name: str, where: str) -> int:
    """Index of the column of an attribute, where all names of heights are synonyms."""
    if name not in names and name in HEIGHT_NAMES:
        for synonym in HEIGHT_NAMES:
            if synonym in plain:
                return list(plain).index(synonym)
    return _find_named(names, name, where)


def _canonical_role(role: str) -> str:
    """The role that a user names, by its short name.

    Raises
    ------
    OptionError
        If there is no such role.
    """
    known = {axis: axis for axis in _AXES}
    known |= {"id": "id", "track_id": "id", "t": "t", "time": "t", "timestamp": "t"}
    known |= {"latitude": "lat", "longitude": "lon", "lng": "lon", "heading": "heading"}
    name = role.strip().lower()
    if _NUMBERED.fullmatch(name):
        return name
    if name not in known:
        raise OptionError(
            f"--columns: {role!r} is not one of id, t, x, y, z, x0, x1, ..., lat, lon, heading"
        )
    return known[name]


def _list_names(names: Sequence[str]) -> str:
    shown = [
        name if len(name) <= _MAX_SHOWN_LETTERS else name[: _MAX_SHOWN_LETTERS - 3] + "..."
        for name in names[:_MAX_SHOWN_NAMES]
    ]
    more = len(names) - _MAX_SHOWN_NAMES
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
