"""merge, match and patch --dry-run: say what would be read and done, and write nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gpszip.cli.dry_run import cpu_time_text, print_plan, row_count_text
from gpszip.cli.output import print_json
from gpszip.cli.summary import describe_repairs, losses_as_dict, print_losses, repairs_as_dict
from gpszip.cli.units import format_bytes, format_count, format_duration, format_length

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.io.networks.read import NetworkReadResult
    from gpszip.model import ReadResult
    from gpszip.pipeline.merge import MergePlan
    from gpszip.pipeline.plans import MatchPlan, PatchPlan

__all__ = ["print_match_plan", "print_merge_plan", "print_patch_plan"]


def print_match_plan(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    plan: MatchPlan,
    *,
    as_json: bool,
) -> None:
    """Print what matching would do."""
    if as_json:
        facts = {**asdict(plan), "cpu_seconds": round(plan.cpu_seconds, 3)}
        _print_json(target, read_result, roads, facts)
        return
    share = f"{plan.matched:,} of {format_count(plan.sampled, 'point')}"
    rows = [
        (
            "tried",
            f"{share} at the starts of tracks are on roads, error {format_length(plan.error)}",
        ),
        ("CPU time", f"{cpu_time_text(plan.cpu_seconds)} to match, estimated"),
    ]
    _print_rows(target, read_result, roads, rows)


def print_patch_plan(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    plan: PatchPlan,
    *,
    as_json: bool,
) -> None:
    """Print what patching would do."""
    if as_json:
        _print_json(target, read_result, roads, asdict(plan))
        return
    over = "" if math.isinf(plan.gap) else f" over {format_duration(plan.gap)}"
    total = f", {format_duration(plan.seconds)} in all" if plan.gaps else ""
    rows = [("gaps", f"{plan.gaps:,}{over}{total}")]
    _print_rows(target, read_result, roads, rows)


def print_merge_plan(
    target: str,
    archives: Mapping[str, Archive],
    plan: MergePlan,
    bad: Mapping[str, str],
    *,
    as_json: bool,
) -> None:
    """Print what a merge would do."""
    if as_json:
        facts = {
            "dry_run": True,
            "output": target,
            "archives": [
                {"name": name, "bytes": archive.size, "tracks": len(archive.ids)}
                for name, archive in archives.items()
            ],
            "bytes_in": sum(archive.size for archive in archives.values()),
            "allowed": plan.limit,
            "allowed_kind": "max" if plan.maximum else "rms",
            "bound_at_most_m": plan.bound,
            "notes": list(plan.notes),
            "left_out": dict(bad),
        }
        print_json(facts)
        return

    # The archives.
    texts = [
        f"{name} ({format_bytes(archive.size)}, {format_count(len(archive.ids), 'track')}, "
        f"{archive.error_bound or 'no error bound'})"
        for name, archive in archives.items()
    ]
    rows = [("read", texts[0])] + [("", text) for text in texts[1:]]
    rows += [("left out", reason) for reason in bad.values()]
    total = sum(archive.size for archive in archives.values())
    rows.append(("together", format_bytes(total)))

    # What may become of them.
    kind = "at most" if plan.maximum else "in the root mean square at most"
    rows.append(("deviation", f"tracks may be moved by {format_length(plan.limit)} {kind}"))
    if plan.bound is not None:
        kind = "maximum" if plan.bound_is_maximum else "RMSE"
        rows.append(("bound", f"{kind} {format_length(plan.bound)} at most, about"))
    rows += [("note", note) for note in plan.notes]
    print_plan(rows, target)


def _print_json(
    target: str, read_result: ReadResult, roads: NetworkReadResult, facts: Mapping[str, Any]
) -> None:
    """Print facts, and what was read, for programs."""
    print_json(
        {
            "dry_run": True,
            "output": target,
            "bytes_in": read_result.bytes,
            "tracks": len(read_result.tracks),
            "roads": len(roads.network),
            "roads_read": roads.read,
            **facts,
            **losses_as_dict(read_result),
            **repairs_as_dict([*read_result.repairs, *roads.repairs], read_result.left_out),
        }
    )


def _print_rows(
    target: str,
    read_result: ReadResult,
    roads: NetworkReadResult,
    rows: Sequence[tuple[str, str]],
) -> None:
    """Print what was read, and further rows, for a person."""
    print_losses(read_result)
    tracks = format_count(len(read_result.tracks), "track")
    length = format_length(float(roads.network.lengths.sum()))
    repairs = describe_repairs([*read_result.repairs, *roads.repairs])
    read = [
        ("read", f"{format_bytes(read_result.bytes)}, {tracks}"),
        ("rows", row_count_text(read_result)),
        ("roads", f"{len(roads.network):,} of {roads.read:,} near the log, {length}"),
        *(("repair", text) for text in repairs),
    ]
    print_plan([*read, *rows], target)
