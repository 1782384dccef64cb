"""The one line, or the JSON object, that says what a compression did."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from gpszip.cli.output import STDOUT, say, show_json
from gpszip.cli.units import format_bytes, format_duration, format_length
from gpszip.model import Report
from gpszip.model.read_result import LeftOut, Reading, Repair

__all__ = [
    "account_of",
    "describe",
    "losses_of",
    "name_left_out",
    "name_losses",
    "place_of",
    "repairs_in_words",
    "show_summary",
    "summarise",
]


#: The plural with which most repairs begin.
_PLURAL = re.compile(r"^((?:repeated )?(?:row|point|position|spike|road|feature|track|time))s\b")

#: So many losses are named in the first line; JSON names them all.
_NAMED = 5


def show_summary(target: str, reading: Reading, report: Report, *, as_json: bool) -> None:
    """Show what was done: text for the person on standard error, JSON on standard output unless that carries the archive."""
    if as_json:
        show_json({"output": target, **summarise(reading, report)}, err=target == STDOUT)
        return
    name_losses(reading)
    name_left_out(reading)
    say(f"{place_of(target)}: {describe(reading, report)}")


def place_of(target: str) -> str:
    """What a person calls the output."""
    return "standard output" if target == STDOUT else target


def name_losses(reading: Reading) -> None:
    """One line, which comes first, for the tracks that lost many of their points."""
    if not reading.losses:
        return
    words = [str(loss) for loss in reading.losses[:_NAMED]]
    more = len(reading.losses) - _NAMED
    words += [f"and of {more:,} more, which --json names"] if more > 0 else []
    say(f"gpszip: lost {'; '.join(words)}")


def name_left_out(reading: Reading) -> None:
    """One line for each log that was left out."""
    for left in reading.left_out:
        say(f"gpszip: left out {left.name}: {left.reason}")


def repairs_in_words(repairs: Iterable[Repair]) -> list[str]:
    """What was mended while reading, a few words for each."""
    return [f"{one.where}: {one.count:,} {_agreeing(one)}" + (f" ({one.value})" if one.value else "") for one in repairs]


def _agreeing(repair: Repair) -> str:
    """What was mended, in the singular where it is one."""
    return _PLURAL.sub(r"\1", repair.what) if repair.count == 1 else repair.what


def account_of(repairs: Iterable[Repair], left_out: Iterable[LeftOut] = ()) -> dict[str, Any]:
    """What was mended and what was left out while reading, as values for programs."""
    return {"repairs": [asdict(one) for one in repairs], "left_out": [asdict(one) for one in left_out]}


def losses_of(reading: Reading) -> dict[str, Any]:
    """How many points were read and lost, and which tracks lost many, as values for programs."""
    return {"points_read": reading.points, "points_lost": reading.lost, "losses": [asdict(one) for one in reading.losses]}


def describe(reading: Reading, report: Report) -> str:
    """One line: points, bytes in and out, ratio, errors, seconds, then what is not in the archive."""
    ratio = reading.bytes / max(report.bytes_out, 1)
    facts = [
        f"{_count(report.points, 'point')} in {_count(report.tracks, 'track')}",
        f"{format_bytes(reading.bytes)} -> {format_bytes(report.bytes_out)} (1:{ratio:,.{0 if ratio >= 10 else 1}f})",
        f"RMSE {format_length(report.rmse)}",
        f"maximum {format_length(report.max_error)}",
        f"{report.seconds:.1f} s",
    ]
    return "; ".join([", ".join(facts), *_remarks(reading, report)])


def _remarks(reading: Reading, report: Report) -> list[str]:
    remarks = [f"asked for: {report.bound}"] if report.bound.startswith("size") else []
    remarks += [] if report.gap == float("inf") else [f"gaps over {format_duration(report.gap)}"]
    remarks += report.notes
    remarks += repairs_in_words(reading.repairs)
    if reading.dropped:
        remarks.append(f"not kept: {', '.join(reading.dropped)}")
    return remarks


def _count(number: int, word: str) -> str:
    return f"{number:,} {word}" + ("" if number == 1 else "s")


def summarise(reading: Reading, report: Report) -> dict[str, Any]:
    """The same as values for programs; lengths in metres, times in seconds, sizes in bytes."""
    return {
        "points": report.points,
        "tracks": report.tracks,
        "bytes_in": reading.bytes,
        "bytes_out": report.bytes_out,
        "ratio": reading.bytes / max(report.bytes_out, 1),
        "rmse": report.rmse,
        "max_error": report.max_error,
        "bound": report.bound,
        "gap": report.gap,
        "seconds": round(report.seconds, 3),
        "parts": report.parts,
        "nodes": report.nodes,
        "edges": report.edges,
        "notes": list(report.notes),
        **losses_of(reading),
        **account_of(reading.repairs, reading.left_out),
        "dropped": list(reading.dropped),
    }
