"""What the columns of trajectory files are, and how a file is recognised by its first lines.

A file is taken only if its lines can hardly be anything else: quaternions of length 1 for TUM,
rotation matrices for KITTI, the names of the header for EuRoC.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError
from gpszip.io.logs.trajectories.clean_lines import clean_lines
from gpszip.io.logs.trajectories.headings import forward_of_quaternions, unit_vectors

__all__ = ["KITTI", "TUM", "Layout", "euroc_layout", "sniff_euroc", "sniff_kitti", "sniff_tum"]

#: Lines that a format is recognised from.
_SAMPLE_LINES = 50

#: Bytes among which these lines are: 50 lines of KITTI have 8 kB.
_SAMPLE_BYTES = 1 << 14

#: Least share of these lines that are poses: some files have damaged lines.
_MIN_POSES = 0.8

#: Largest difference from 1 of a quaternion's length, and from the unit matrix of R R^T. Files
#: with three decimals differ by up to 0.002.
_MAX_NORM_ERROR = 0.05

#: Names of EuRoC's columns of positions and orientations: p_RS_R_x, q_RS_w.
_EUROC_COLUMN = re.compile(r"([pq])_(?:\w+_)?([wxyz])")

#: Units behind names: p_RS_R_x [m], q_RS_w [].
_BRACKETS = re.compile(r"\s*\[.*?\]\s*$")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Layout:
    """The columns of a file.

    Parameters
    ----------
    format : str
        Name of the format in messages.
    columns : tuple of str
        Names of all columns.
    roles : mapping of str to str
        Columns of the time and the position: ``t``, ``x``, ``y`` and ``z``.
    orientation : tuple of str
        Columns of the quaternion x, y, z, w, or of the vector that points forward; empty if there
        are none.
    """

    format: str
    columns: tuple[str, ...]
    roles: dict[str, str]
    orientation: tuple[str, ...]

    def forward(self, cells: Sequence[Floats]) -> Floats:
        """Return unit vectors that point forward, from the columns of the orientation."""
        # A quaternion has four numbers, a vector three.
        if len(cells) == 4:
            return forward_of_quaternions(*cells)
        return unit_vectors(np.stack(cells, axis=1))


#: Times in seconds, positions, quaternions.
TUM = Layout(
    "TUM",
    ("t", "x", "y", "z", "qx", "qy", "qz", "qw"),
    {"t": "t", "x": "x", "y": "y", "z": "z"},
    ("qx", "qy", "qz", "qw"),
)

#: The first three rows of the matrix of a pose, row by row. Cameras look along their z axis.
KITTI = Layout(
    "KITTI",
    ("r11", "r12", "r13", "x", "r21", "r22", "r23", "y", "r31", "r32", "r33", "z"),
    {"x": "x", "y": "y", "z": "z"},
    ("r13", "r23", "r33"),
)


def euroc_layout(head: bytes) -> Layout | None:
    """Return the columns of an EuRoC file from its first bytes; None if it is none of poses.

    Examples
    --------
    >>> layout = euroc_layout(b"#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]")
    >>> layout.columns, layout.orientation
    (('timestamp [ns]', 'p_RS_R_x', 'p_RS_R_y', 'p_RS_R_z'), ())
    """
    # The header is a comment with commas.
    start = head[:_SAMPLE_BYTES].removeprefix(b"\xef\xbb\xbf").lstrip()
    line = start.split(b"\n", 1)[0].decode("latin-1")
    names = [_BRACKETS.sub("", name.strip()) for name in line.lstrip("#").strip().split(",")]
    if not line.startswith("#") or names[0].lower() != "timestamp":
        return None

    # Positions and quaternions by their names; the first column of each kind counts.
    found: dict[str, str] = {}
    for name in names[1:]:
        if match := _EUROC_COLUMN.fullmatch(name):
            found.setdefault(match[1] + match[2], name)
    if not {"px", "py", "pz"} <= found.keys():
        return None
    quaternion = tuple(found[f"q{axis}"] for axis in "xyzw" if f"q{axis}" in found)

    # Times of EuRoC are nanoseconds; not every header says so.
    time = "timestamp [ns]"
    return Layout(
        "EuRoC",
        (time, *names[1:]),
        {"t": time, "x": found["px"], "y": found["py"], "z": found["pz"]},
        quaternion if len(quaternion) == 4 else (),
    )


def sniff_euroc(head: bytes) -> bool:
    """Whether a file that starts like this has EuRoC's columns of positions."""
    return euroc_layout(head) is not None


def sniff_tum(head: bytes) -> bool:
    r"""Whether a file that starts like this has a time, a position and a quaternion in each line.

    Examples
    --------
    >>> sniff_tum(b"# time x y z qx qy qz qw\n0.0 1 2 3 0 0 0 1\n")
    True
    >>> sniff_tum(b"0.0 1 2 3 4 5 6 7\n"), sniff_tum(b"t x y z qx qy qz qw\n0 1 2 3 0 0 0 1\n")
    (False, False)
    """
    rows = _first_rows(head, len(TUM.columns))
    if rows is None or _names_other_columns(head):
        return False
    norms = np.sqrt((rows[:, 4:] ** 2).sum(axis=1))
    return _most(np.abs(norms - 1) <= _MAX_NORM_ERROR)


def sniff_kitti(head: bytes) -> bool:
    r"""Whether a file that starts like this has a rotation matrix and a position in each line.

    Examples
    --------
    >>> sniff_kitti(b"1 0 0 5 0 1 0 6 0 0 1 7\n"), sniff_kitti(b"1 2 3 4 5 6 7 8 9 10 11 12\n")
    (True, False)
    """
    rows = _first_rows(head, len(KITTI.columns))
    if rows is None:
        return False
    # Lines without a pose are no rotation either.
    rotations = np.nan_to_num(rows.reshape(-1, 3, 4)[:, :, :3])
    products = rotations @ rotations.transpose(0, 2, 1)
    errors = np.abs(products - np.eye(3)).max(axis=(1, 2))
    return _most((errors <= _MAX_NORM_ERROR) & (np.linalg.det(rotations) > 0))


def _most(flags: NDArray[np.bool_]) -> bool:
    # The first line is no header of a table, so it has to be a pose.
    return bool(flags[0] and flags.mean() >= _MIN_POSES)


def _first_rows(head: bytes, width: int) -> Floats | None:
    """Return the numbers of the first lines, NaN for lines that have other cells.

    None if the first line has none, so that it may be a header.
    """
    # Text of two bytes a letter and binary files have zeros, which no line of numbers has.
    start = head[:_SAMPLE_BYTES]
    if b"\0" in start:
        return None

    # Most files are of other formats, as their first line shows.
    lines = start.splitlines()
    first = next(filter(None, map(clean_lines, lines)), b"")
    if not np.isfinite(_numbers(first.split(b" "), width)).all():
        return None

    # The last line may be cut off.
    is_whole = len(head) <= _SAMPLE_BYTES or start.endswith((b"\n", b"\r"))
    cleaned = clean_lines(b"\n".join(lines if is_whole else lines[:-1])).split(b"\n")
    cells = [line.split(b" ") for line in cleaned if line][:_SAMPLE_LINES]
    # A long comment may be followed by one line that is cut off.
    return np.array([_numbers(line, width) for line in cells]) if cells else None


def _numbers(cells: Sequence[bytes], width: int) -> list[float]:
    """Return a line as numbers; NaN if it has other cells, or numbers out of any use."""
    if len(cells) == width:
        try:
            numbers = [float(cell) for cell in cells]
        except ValueError:
            return [np.nan] * width
        # Squares of larger numbers are infinite.
        if max(map(abs, numbers[1:])) < 1e100:
            return numbers
    return [np.nan] * width


def _names_other_columns(head: bytes) -> bool:
    """Whether a comment above the first line names columns in another order than TUM's.

    Then the file is a table, and is left to the reader of tables, which knows such headers.
    """
    # The last comment before the first line.
    comments: list[str] = []
    for line in head[:_SAMPLE_BYTES].removeprefix(b"\xef\xbb\xbf").splitlines():
        text = line.decode("latin-1").strip()
        if text and not text.startswith("#"):
            break
        comments += [text.lstrip("# \t")] if text else []
    names = re.split(r"[\s,;]+", comments[-1]) if comments else []
    if len(names) != len(TUM.columns):
        return False

    # Few files come this far, so recognising others imports no Arrow.
    from gpszip.io.tables.roles import find_roles

    # A comment that is no header names no columns.
    try:
        roles = find_roles(names, None, (), "")
    except InputError:
        return False
    in_order = roles.time == (0,) and roles.axes == (1, 2, 3) and not roles.geographic
    return not in_order or names[4].lower().endswith("w")
