"""The one line, or the JSON object, that says what a compression did."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from gpszip.cli.output import STDOUT, print_json, print_status
from gpszip.cli.units import format_bytes, format_duration, format_length
from gpszip.model import Report
from gpszip.model.read_result import LeftOut, ReadResult, Repair

__all__ = [
    "describe_compression",
    "describe_repairs",
    "losses_as_dict",
    "output_label",
    "print_left_out",
    "print_losses",
    "print_summary",
    "repairs_as_dict",
    "summary_as_dict",
]


#: The plural with which most repairs begin.
_PLURAL = re.compile(r"^((?:repeated )?(?:row|point|position|spike|road|feature|track|time))s\b")

#: So many losses are named in the first line; JSON names them all.
_MAX_NAMED = 5


def print_summary(target: str, read_result: ReadResult, report: Report, *, as_json: bool) -> None:
    """Show what was done: text for the person on standard error, JSON on standard output unless that carries the archive."""
    if as_json:
        print_json({"output": target, **summary_as_dict(read_result, report)}, err=target == STDOUT)
        return
    print_losses(read_result)
    print_left_out(read_result)
    print_status(f"{output_label(target)}: {describe_compression(read_result, report)}")


def output_label(target: str) -> str:
    """What a person calls the output."""
    return "standard output" if target == STDOUT else target


def print_losses(read_result: ReadResult) -> None:
    """One line, which comes first, for the tracks that lost many of their points."""
    if not read_result.losses:
        return
    words = [str(loss) for loss in read_result.losses[:_MAX_NAMED]]
    more = len(read_result.losses) - _MAX_NAMED
    words += [f"and of {more:,} more, which --json names"] if more > 0 else []
    print_status(f"gpszip: lost {'; '.join(words)}")


def print_left_out(read_result: ReadResult) -> None:
    """One line for each log that was left out."""
    for left in read_result.left_out:
        print_status(f"gpszip: left out {left.name}: {left.reason}")


def describe_repairs(repairs: Iterable[Repair]) -> list[str]:
    """What was mended while reading, a few words for each."""
    return [
        f"{one.where}: {one.count:,} {_in_number(one)}" + (f" ({one.value})" if one.value else "")
        for one in repairs
    ]


def _in_number(repair: Repair) -> str:
    """What was mended, in the singular where it is one."""
    return _PLURAL.sub(r"\1", repair.what) if repair.count == 1 else repair.what


def repairs_as_dict(repairs: Iterable[Repair], left_out: Iterable[LeftOut] = ()) -> dict[str, Any]:
    """What was mended and what was left out while reading, as values for programs."""
    return {
        "repairs": [asdict(one) for one in repairs],
        "left_out": [asdict(one) for one in left_out],
    }


def losses_as_dict(read_result: ReadResult) -> dict[str, Any]:
    """How many points were read and lost, and which tracks lost many, as values for programs."""
    return {
        "points_read": read_result.points,
        "points_lost": read_result.lost,
        "losses": [asdict(one) for one in read_result.losses],
    }


def describe_compression(read_result: ReadResult, report: Report) -> str:
    """One line: points, bytes in and out, ratio, errors, seconds, then what is not in the archive."""
    ratio = read_result.bytes / max(report.bytes_out, 1)
    facts = [
        f"{_format_count(report.points, 'point')} in {_format_count(report.tracks, 'track')}",
        f"{format_bytes(read_result.bytes)} -> {format_bytes(report.bytes_out)} (1:{ratio:,.{0 if ratio >= 10 else 1}f})",
        f"RMSE {format_length(report.rmse)}",
        f"maximum {format_length(report.max_error)}",
        f"{report.seconds:.1f} s",
    ]
    return "; ".join([", ".join(facts), *_describe_remarks(read_result, report)])


def _describe_remarks(read_result: ReadResult, report: Report) -> list[str]:
    remarks = [f"asked for: {report.bound}"] if report.bound.startswith("size") else []
    remarks += [] if report.gap == float("inf") else [f"gaps over {format_duration(report.gap)}"]
    remarks += report.notes
    remarks += describe_repairs(read_result.repairs)
    if read_result.dropped_columns:
        remarks.append(f"not kept: {', '.join(read_result.dropped_columns)}")
    return remarks


def _format_count(number: int, word: str) -> str:
    return f"{number:,} {word}" + ("" if number == 1 else "s")


def summary_as_dict(read_result: ReadResult, report: Report) -> dict[str, Any]:
    """The same as values for programs; lengths in metres, times in seconds, sizes in bytes."""
    return {
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
        "parts": report.segments,
        "nodes": report.nodes,
        "edges": report.edges,
        "notes": list(report.notes),
        **losses_as_dict(read_result),
        **repairs_as_dict(read_result.repairs, read_result.left_out),
        "dropped": list(read_result.dropped_columns),
    }
