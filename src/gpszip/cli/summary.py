"""Describe what a command read and wrote, in lines for a person or as JSON."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict
from math import isinf
from typing import Any

from gpszip.cli.output import STDOUT, print_json, print_status
from gpszip.cli.units import format_bytes, format_count, format_duration, format_length
from gpszip.model import Report
from gpszip.model.read_result import LeftOut, ReadResult, Repair
from gpszip.model.text import count_phrase

__all__ = [
    "describe_compression",
    "describe_repairs",
    "losses_as_dict",
    "output_label",
    "print_json_result",
    "print_losses",
    "print_summary",
    "repairs_as_dict",
    "summary_as_dict",
]


#: How the description of a track with a new name begins, and that of many.
_RENAMED = re.compile(r"^track renamed to ")
_RENAMED_MANY = "tracks renamed to NAME-2, ..., as there are others of their names"

#: Repairs of one kind that are described one by one.
_MAX_ALIKE = 5

#: Losses that the first line names; JSON names them all.
_MAX_NAMED = 5

#: Ratio from which it is shown without a decimal.
_WHOLE_RATIO = 10


def print_summary(target: str, read_result: ReadResult, report: Report, *, as_json: bool) -> None:
    """Print what a compression did.

    A person reads text on standard error. JSON goes to standard output, or to standard error if
    the archive is on standard output.
    """
    if as_json:
        print_json({"output": target, **summary_as_dict(read_result, report)}, err=target == STDOUT)
        return

    # For a person, losses come first.
    print_losses(read_result)
    print_status(f"{output_label(target)}: {describe_compression(read_result, report)}")


def output_label(target: str) -> str:
    """Return the name of an output in messages."""
    return "standard output" if target == STDOUT else target


def print_json_result(
    target: str, facts: dict[str, Any], read_result: ReadResult, repairs: Iterable[Repair]
) -> None:
    """Print the facts of a command that read logs, and what reading lost, repaired or left out.

    JSON goes to standard output, or to standard error if the result is on standard output.
    """
    print_json(
        {
            "output": target,
            **facts,
            **losses_as_dict(read_result),
            **repairs_as_dict(repairs, read_result.left_out),
        },
        err=target == STDOUT,
    )


def print_losses(read_result: ReadResult) -> None:
    """Print what a person reads first: the selection, large losses, and logs left out."""
    # A selection; sizes and ratios are those of the whole logs.
    if read_result.not_selected:
        total = read_result.points + read_result.not_selected
        print_status(f"gpszip: selected {read_result.points:,} of {format_count(total, 'point')}")

    # Tracks stand in one line.
    losses = [str(loss) for loss in read_result.losses[:_MAX_NAMED]]
    more = len(read_result.losses) - _MAX_NAMED
    if more > 0:
        losses.append(f"and of {more:,} more, which --json names")
    if losses:
        print_status(f"gpszip: lost {'; '.join(losses)}")

    # Each log has a line with its reason; files that hold none are counted.
    for left in read_result.left_out:
        print_status(f"gpszip: left out {left.name}: {left.reason}")
    for others in read_result.other_files:
        print_status(f"gpszip: {others.where}: left out {others}")


def describe_repairs(repairs: Iterable[Repair]) -> list[str]:
    """Describe what was repaired while reading, a few words for each repair.

    What was repaired in many files is described once. JSON names each of them.
    """
    # Files of one export often need the same repair. New names of tracks differ.
    by_kind: dict[str, list[Repair]] = {}
    for repair in repairs:
        what = _RENAMED_MANY if _RENAMED.match(repair.what) else repair.what
        by_kind.setdefault(what, []).append(repair)

    lines = []
    for what, alike in by_kind.items():
        if len(alike) <= _MAX_ALIKE:
            lines += [_describe_repair(repair) for repair in alike]
            continue
        count = sum(repair.count for repair in alike)
        more = f"{alike[0].where} and {len(alike) - 1:,} more"
        lines.append(f"{more}: {count:,} {what}")
    return lines


def _describe_repair(repair: Repair) -> str:
    value = f" ({repair.value})" if repair.value else ""
    return f"{repair.where}: {count_phrase(repair.count, repair.what)}{value}"


def repairs_as_dict(repairs: Iterable[Repair], left_out: Iterable[LeftOut] = ()) -> dict[str, Any]:
    """Return what was repaired and left out while reading, for JSON."""
    return {
        "repairs": [asdict(repair) for repair in repairs],
        "left_out": [asdict(left) for left in left_out],
    }


def losses_as_dict(read_result: ReadResult) -> dict[str, Any]:
    """Return the points that were read, not selected and lost, and what lost many, for JSON."""
    return {
        "points_read": read_result.points,
        "points_not_selected": read_result.not_selected,
        "points_lost": read_result.lost,
        "losses": [asdict(loss) for loss in read_result.losses],
        "other_files": [
            {**asdict(others), "kinds": dict(others.kinds)} for others in read_result.other_files
        ],
    }


def describe_compression(read_result: ReadResult, report: Report) -> str:
    """Describe a compression in one line.

    It says points, bytes in and out, ratio, errors and seconds, then what is not in the archive.
    """
    ratio = read_result.bytes / max(report.bytes_out, 1)
    decimals = 0 if ratio >= _WHOLE_RATIO else 1
    sizes = f"{format_bytes(read_result.bytes)} -> {format_bytes(report.bytes_out)}"
    facts = [
        f"{format_count(report.points, 'point')} in {format_count(report.tracks, 'track')}",
        f"{sizes} (1:{ratio:,.{decimals}f})",
        f"RMSE {format_length(report.rmse)}",
        # Of a coreset, the largest error is not known.
        *([] if isinf(report.max_error) else [f"maximum {format_length(report.max_error)}"]),
        f"{report.seconds:.1f} s",
    ]
    return "; ".join([", ".join(facts), *_describe_remarks(read_result, report)])


def _describe_remarks(read_result: ReadResult, report: Report) -> list[str]:
    remarks = []
    # A bound on the error is visible in the errors; one on the size is not, as a ratio may have set
    # it.
    if report.bound.startswith("size"):
        remarks.append(f"asked for: {report.bound}")
    if not isinf(report.gap):
        remarks.append(f"gaps over {format_duration(report.gap)}")
    remarks += report.notes
    remarks += describe_repairs(read_result.repairs)
    if read_result.dropped_columns:
        remarks.append(f"not kept: {', '.join(read_result.dropped_columns)}")
    return remarks


def summary_as_dict(read_result: ReadResult, report: Report) -> dict[str, Any]:
    """Return the summary of a compression for JSON: lengths in m, times in s, sizes in bytes."""
    # What is in the archive: size and errors, the bounds asked for, walks and map.
    compression = {
        "points": report.points,
        "tracks": report.tracks,
        "bytes_in": read_result.bytes,
        "bytes_out": report.bytes_out,
        "ratio": read_result.bytes / max(report.bytes_out, 1),
        "rmse": report.rmse,
        "max_error": report.max_error,
        "bound": report.bound,
        "gap": report.gap,
        "seconds": round(report.seconds, 3),
        "segments": report.segments,
        "nodes": report.nodes,
        "edges": report.edges,
        "notes": list(report.notes),
    }

    # What is not in the archive.
    return {
        **compression,
        **losses_as_dict(read_result),
        **repairs_as_dict(read_result.repairs, read_result.left_out),
        "dropped": list(read_result.dropped_columns),
    }
