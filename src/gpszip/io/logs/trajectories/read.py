"""Readers of TUM, KITTI and EuRoC: a pose in each line.

All three are tables whose columns have fixed names (:mod:`gpszip.io.logs.trajectories.layouts`), so
that ``--columns`` and ``--keep`` work as for CSV. Headings come from the orientation. Lines are
read in blocks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from gpszip.errors import InputError
from gpszip.io.logs.csv import malformed_rows_repair, read_csv
from gpszip.io.logs.csv_batches import read_csv_batches
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import RawLog, Request
from gpszip.io.logs.table_batches import TableBatch, interpret_batches
from gpszip.io.logs.trajectories.clean_lines import clean_lines
from gpszip.io.logs.trajectories.clock import Clock, clock_of
from gpszip.io.logs.trajectories.headings import heading_of_vectors
from gpszip.io.logs.trajectories.layouts import KITTI, TUM, Layout, euroc_layout
from gpszip.io.logs.trajectories.number_lines import parse_lines, read_blocks
from gpszip.io.storage.source import Source
from gpszip.io.tables.roles import Roles, find_roles
from gpszip.io.tables.table import TableConventions, build_raw_log
from gpszip.io.values.arrow import is_text, to_floats

__all__ = [
    "read_euroc",
    "read_euroc_batches",
    "read_kitti",
    "read_kitti_batches",
    "read_tum",
    "read_tum_batches",
]

#: Word for a row in messages.
_NOUN = "pose"

#: Start of the names of attributes that hold the orientation until headings are made of it. No
#: column of a file has such a name.
_ORIENTATION = "\0orientation"

#: Letters of an error message of Arrow that are shown.
_MAX_REASON_LETTERS = 120


def read_tum(source: Source, request: Request) -> RawLog:
    r"""Read a log in TUM's format: time, position and quaternion in each line.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns, attributes (``qx``, ``qy``, ``qz``, ``qw``), and whether headings are kept. Columns
        that are named in their order make the file a table without a header, read as CSV.

    Raises
    ------
    InputError
        If there is no pose, or a column of the request doesn't exist.

    Examples
    --------
    >>> log = read_tum(Source("a.tum", data=b"0 1 2 3 0 0 0 1\n"), Request(heading=True))
    >>> log.times.tolist(), log.coordinates.tolist(), log.attributes["heading"].tolist()
    ([0.0], [[1.0, 2.0, 3.0]], [90.0])
    """
    return _read(source, request, TUM)


def read_tum_batches(source: Source, request: Request) -> LogBatches:
    """Open a log in TUM's format to be read in batches; see :func:`read_tum`."""
    return _read_batches(source, request, TUM)


def read_kitti(source: Source, request: Request) -> RawLog:
    r"""Read a log in KITTI's format: the first three rows of the matrix of a pose in each line.

    Parameters
    ----------
    source : Source
        The file or stream.
    request : Request
        Columns (``r11`` to ``r33``, ``x``, ``y``, ``z``), attributes, whether headings are kept,
        and where times come from: a file or a rate.

    Raises
    ------
    InputError
        If there is no pose, a line has other than 12 cells, or the request gives no times.

    Examples
    --------
    >>> request = Request(rate=10.0)
    >>> data = b"1 0 0 5 0 1 0 6 0 0 1 7\n1 0 0 6 0 1 0 6 0 0 1 7\n"
    >>> log = read_kitti(Source("00.txt", data=data), request)
    >>> log.times.tolist(), log.coordinates[0].tolist()
    ([0.0, 0.1], [5.0, 6.0, 7.0])
    """
    return _read(source, request, KITTI)


def read_kitti_batches(source: Source, request: Request) -> LogBatches:
    """Open a log in KITTI's format to be read in batches; see :func:`read_kitti`."""
    return _read_batches(source, request, KITTI)


def read_euroc(source: Source, request: Request) -> RawLog:
    r"""Read a log in EuRoC's format: CSV with nanoseconds, position and quaternion.

    Parameters
    ----------
    source : Source
        The file or stream; of 4, 8, 17 or any other number of columns.
    request : Request
        Columns, attributes (any column, without its unit), and whether headings are kept.

    Raises
    ------
    InputError
        If the header names no position, or there is no pose.

    Examples
    --------
    >>> data = b"#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]\n1500000000,1,2,3\n"
    >>> read_euroc(Source("data.csv", data=data), Request()).times.tolist()
    [1.5]
    """
    return _read(source, request, _euroc_layout(source))


def read_euroc_batches(source: Source, request: Request) -> LogBatches:
    """Open a log in EuRoC's format to be read in batches; see :func:`read_euroc`."""
    return _read_batches(source, request, _euroc_layout(source))


def _euroc_layout(source: Source) -> Layout:
    head = source.head()
    layout = euroc_layout(head)
    if layout is None:
        raise InputError(
            "its header names no position",
            path=source.name,
            remedy="EuRoC's begins with #timestamp and has p_RS_R_x, p_RS_R_y and p_RS_R_z; "
            "for other headers, --format csv",
        )
    return layout


# Reading


def _read(source: Source, request: Request, layout: Layout) -> RawLog:
    """Read a file at once."""
    # Find its columns.
    if _is_plain_table(request):
        return read_csv(source, request)
    reader = _reader(source, request, layout)
    clock = clock_of(layout, request, source.name)

    # The whole file is one block.
    block = b"".join(read_blocks(source))
    table, malformed = reader.parse(block, 0, clock)
    if not table.num_rows:
        raise reader.no_pose_error(malformed)
    raw = build_raw_log(
        table.columns,
        layout.columns,
        reader.roles,
        request,
        source.name,
        conventions=TableConventions(),
        repairs=malformed_rows_repair(malformed, source.name),
    )
    (raw,) = _complete([raw], reader, clock)
    return raw


def _read_batches(source: Source, request: Request, layout: Layout) -> LogBatches:
    """Open a file to be read in batches."""
    if _is_plain_table(request):
        return read_csv_batches(source, request)
    reader = _reader(source, request, layout)
    clock = clock_of(layout, request, source.name)
    reader = replace(reader, clock=clock)
    return LogBatches(
        _complete(interpret_batches(reader, request), reader, clock),
        CoordinateKind(geographic=False, dimension=len(reader.roles.axes)),
    )


def _is_plain_table(request: Request) -> bool:
    """Whether the user says that columns are others than those of the format."""
    columns = request.columns
    return isinstance(columns, tuple) or bool(columns and columns.keys() & {"lat", "lon"})


@dataclass(frozen=True)
class _PoseReader:
    """Reads batches of cells, see :class:`gpszip.io.logs.table_batches.TableReader`."""

    source: Source
    layout: Layout
    roles: Roles
    clock: Clock | None = None
    first_row_number: int = 1

    @property
    def name(self) -> str:
        return self.source.name

    @property
    def column_names(self) -> tuple[str, ...]:
        return self.layout.columns

    def read(self) -> Iterator[TableBatch]:
        """Yield all poses."""
        first = 0
        for block in read_blocks(self.source):
            table, malformed = self.parse(block, first, self.clock)
            first += table.num_rows
            yield TableBatch(table, malformed)

    def parse(self, block: bytes, first: int, clock: Clock | None) -> tuple[Any, int]:
        """Return the poses of a block as a table, and the number of lines with other cells.

        Parameters
        ----------
        block : bytes
            Lines of the file.
        first : int
            Index of the first pose of the block.
        clock : Clock, optional
            Where times come from if the file has none.
        """
        # Nanoseconds as floats would lose some; Arrow falls back to texts where a time is no
        # integer.
        types = {} if clock is not None else self._time_types(block)
        columns = self.roles.used
        table, malformed, first_bad = parse_lines(block, len(self.column_names), columns, types)

        # Times that are found by the number of a pose can't pass over a line.
        if malformed and clock is not None:
            line = "a pose" if first_bad is None else f"{_NOUN} {first + first_bad + 1}"
            raise InputError(
                f"has too many or too few numbers: {len(self.column_names)} are a pose",
                path=self.name,
                location=line,
                remedy="correct the line, as poses take their times by their number",
            )

        # Attributes are numbers, whatever stands in some line.
        texts = {str(i) for i in (*self.roles.axes, *self.roles.time)}
        for i, name in enumerate(table.column_names):
            column = table.column(i)
            if name not in texts and is_text(column.type):
                table = table.set_column(i, name, pa.array(to_floats(column)))
        return table, malformed

    def _time_types(self, block: bytes) -> Mapping[int, Any]:
        """Return the type of the column of times, as the first line suggests it."""
        # Enough bytes for a long comment and a line.
        (time,) = self.roles.time
        cells = clean_lines(block[: 1 << 14]).strip().split(b"\n", 1)[0].split(b" ")
        is_whole = len(cells) > time and cells[time].isdigit()
        return {time: pa.int64()} if is_whole else {}

    def read_as_text(self) -> Iterator[Any]:
        """Yield all poses as tables of texts."""
        types = dict.fromkeys(self.roles.used, pa.string())
        for block in read_blocks(self.source):
            yield parse_lines(block, len(self.column_names), self.roles.used, types).table

    def uses_decimal_comma(self) -> bool:
        """Commas separate numbers."""
        return False

    def explain_error(self, error: Exception) -> str:
        return f"can't be read: {str(error).splitlines()[0][:_MAX_REASON_LETTERS]}"

    def no_pose_error(self, malformed: int) -> InputError:
        """Return the error for a file without a pose."""
        width = len(self.column_names)
        what = f"no line has {width} numbers" if malformed else "has no poses"
        return InputError(
            what,
            path=self.name,
            remedy=f"name a file with {width} numbers in each line, or another --format",
        )


def _reader(source: Source, request: Request, layout: Layout) -> _PoseReader:
    """Find the columns that are read."""
    # The user may name other columns for some roles. Whoever names x or y leaves out z.
    stated = request.columns if isinstance(request.columns, Mapping) else {}
    named = {**layout.roles, **stated}
    if stated.keys() & {"x", "y"} and "z" not in stated:
        del named["z"]
    roles = find_roles(layout.columns, named, request.keep, source.name, times="t" in layout.roles)
    axes = roles.axes if "z" in named else roles.axes[:2]
    time = roles.time if "t" in named else ()
    roles = replace(roles, axes=axes, time=time)

    # Headings need the columns of the orientation.
    if not request.heading:
        return _PoseReader(source, layout, roles)
    orientation = {
        f"{_ORIENTATION}{i}": layout.columns.index(name)
        for i, name in enumerate(layout.orientation)
    }
    return _PoseReader(source, layout, replace(roles, keep={**roles.keep, **orientation}))


def _complete(raws: Any, reader: _PoseReader, clock: Clock | None) -> Iterator[RawLog]:
    """Add headings and times to logs."""
    row = 0
    for raw in raws:
        completed = replace(_with_headings(raw, reader), row_noun=_NOUN)
        if clock is not None:
            completed = clock.add_times(completed, row)
        row += len(raw.times)
        yield completed
    if clock is not None:
        clock.check_end(row)


def _with_headings(raw: RawLog, reader: _PoseReader) -> RawLog:
    """Replace the columns of the orientation by headings, if they are asked for."""
    names = [name for name in raw.attributes if name.startswith(_ORIENTATION)]
    if not names:
        return raw
    attributes = dict(raw.attributes)
    forward = reader.layout.forward([np.asarray(attributes.pop(name), float) for name in names])

    # Headings are in the plane of the first two coordinates, which the user may have chosen.
    layout = reader.layout
    space = [layout.columns.index(layout.roles[axis]) for axis in "xyz"]
    order = [space.index(axis) for axis in reader.roles.axes[:2] if axis in space]
    if len(set(order)) == 2:
        up = ({0, 1, 2} - set(order)).pop()
        x, y, z = (forward[:, axis] for axis in (*order, up))
        attributes["heading"] = heading_of_vectors(x, y, z)
    return replace(raw, attributes=attributes)
