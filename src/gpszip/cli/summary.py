"""The one line, or the JSON object, that says what a compression did."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from gpszip.cli.output import STDOUT, say, show_json
from gpszip.cli.units import format_bytes, format_duration, format_length
from gpszip.model import Report
from gpszip.model.reading import LeftOut, Reading, Repair

__all__ = ["account_of", "describe", "name_left_out", "place_of", "repairs_in_words", "show_summary", "summarise"]


def show_summary(target: str, reading: Reading, report: Report, *, as_json: bool) -> None:
    """Show what was done: text for the person on standard error, JSON on standard output unless that carries the archive."""
    if as_json:
        show_json({"output": target, **summarise(reading, report)}, err=target == STDOUT)
        return
    name_left_out(reading)
    say(f"{place_of(target)}: {describe(reading, report)}")


def place_of(target: str) -> str:
    """What a person calls the output."""
    return "standard output" if target == STDOUT else target


def name_left_out(reading: Reading) -> None:
    """One line for each log that was left out."""
    for left in reading.left_out:
        say(f"gpszip: left out {left.name}: {left.reason}")


def repairs_in_words(repairs: Iterable[Repair]) -> list[str]:
    """What was mended while reading, a few words for each."""
    return [f"{one.where}: {one.count:,} {one.what}" + (f" ({one.value})" if one.value else "") for one in repairs]


def account_of(repairs: Iterable[Repair], left_out: Iterable[LeftOut] = ()) -> dict[str, Any]:
    """What was mended and what was left out while reading, as values for programs."""
    return {
        "repairs": [{"what": one.what, "count": one.count, "where": one.where, "drops": one.drops, "value": one.value} for one in repairs],
        "left_out": [{"name": one.name, "reason": one.reason} for one in left_out],
    }


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
        **account_of(reading.repairs, reading.left_out),
        "dropped": list(reading.dropped),
    }
