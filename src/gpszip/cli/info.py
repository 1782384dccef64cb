"""gpszip info: say what an archive holds."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.options import Settings, archive_argument, common_options, map_option
from gpszip.cli.outcome import Outcome

if TYPE_CHECKING:
    from gpszip.archive import Archive

__all__ = ["command"]

_BOUND_NAMES = {"rmse": "RMSE", "max_error": "largest error"}

_EPOCH_SECONDS = (1e8, 1e11)  # what lies between is seconds since 1970, as for a log's time column


@click.command("info", short_help="Say what an archive holds.")
@archive_argument
@map_option
@click.option(
    "--detail",
    is_flag=True,
    help="Decode the walks, too: nodes, ways, parts, gaps, waypoints, bounds, time range.",
)
@common_options
@click.pass_obj
def command(settings: Settings, archive: str, map_name: str | None, detail: bool) -> Outcome:
    """Say what ARCHIVE holds: tracks, sizes, plane, and how finely places and times are kept."""
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.cli.output import print_json

    data = read_archive_bytes(archive)
    with explain_corruption(archive, data):
        facts = _facts(data, open_archive_bytes(archive, data, map_name), detail=detail)
    if settings.json:
        print_json({"archive": archive, **facts})
        return Outcome.DONE
    rows = _summary_rows(facts)
    width = max(len(label) for label, _ in rows)
    for label, text in rows:
        click.echo(f"{label:<{width}}  {text}")
    if not detail:
        click.echo("nodes, ways, bounds and times: gpszip info --detail")
    return Outcome.DONE


def _facts(data: bytes, archive: Archive, *, detail: bool) -> dict[str, Any]:
    from gpszip.container.verify import verify_bytes

    verdict = verify_bytes(data)
    facts = archive.info(decode=detail)
    facts["bytes"] = len(data)
    facts |= {"version": verdict.version, "form": verdict.form, "ids": list(archive.ids)}
    facts |= {"sections": [{"kind": one.kind, "bytes": one.size} for one in verdict.sections]}
    grid = archive.grid
    facts["epoch"] = grid.epoch / 1000
    facts["origin"] = [value / 1000 for value in grid.origin]
    facts["planes"] = (
        [[lat / 1e7, lon / 1e7] for lat, lon in grid.plane.centers] if grid.plane else []
    )
    return facts | {"bounds": _bounds(archive)} if detail else facts


def _bounds(archive: Archive) -> dict[str, list[float]]:
    """Smallest and largest coordinates of the map, in degrees where it lies on the earth."""
    import numpy as np

    nodes, plane = archive.road_map.nodes, archive.grid.plane
    if not len(nodes):
        return {}
    if plane is None:
        names = (
            ("x", "y", "z")[: nodes.shape[1]]
            if nodes.shape[1] <= 3
            else tuple(f"x{axis}" for axis in range(nodes.shape[1]))
        )
        columns = list(nodes.T)
    else:
        from gpszip.geo.planes import to_geographic

        names, columns = ("lat", "lon"), list(to_geographic(nodes, plane))
    return {
        name: [float(np.min(column)), float(np.max(column))]
        for name, column in zip(names, columns, strict=True)
    }


def _summary_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Label and text of each line for a person."""
    from gpszip.cli.units import format_length

    layer = f", packed with {facts['layer']}" if facts["layer"] else ""
    rows = [
        ("format", f"version {facts['version']}, {facts['form']}{layer}"),
        ("size", f"{facts['bytes']:,} bytes, groups {facts['groups']:,}"),
        ("tracks", f"{facts['tracks']:,}{_list_ids(facts['ids'])}"),
    ]
    if "nodes" in facts:
        rows += _detail_rows(facts)
    rows.append(
        ("positions", f"{_describe_axes(facts)}, to {format_length(facts['node_quantum_m'])}")
    )
    rows += [
        (f"plane {i}", f"about latitude {lat:.5f}, longitude {lon:.5f}")
        for i, (lat, lon) in enumerate(facts["planes"])
    ]
    if facts["timed"]:
        rows.append(
            (
                "times",
                f"to {facts['time_quantum_s']:.3g} s, from epoch {_format_time(facts['epoch'])}",
            )
        )
    else:
        rows.append(("times", "none: the shapes of the tracks alone"))
    if facts.get("untimed") and facts["timed"]:
        rows.append(("no times", f"tracks {len(facts['untimed']):,}{_list_ids(facts['untimed'])}"))
    if facts["map"]:
        rows.append(("map", f"kept elsewhere, {facts['map']}"))
    if facts["promise"]:
        beside = (
            ""
            if facts["promise_max_m"] is None
            else f", largest error at most {format_length(facts['promise_max_m'])}"
        )
        rows.append(
            (
                "promise",
                f"{_BOUND_NAMES[facts['promise']]} at most {format_length(facts['promise_m'])}{beside}",
            )
        )
    if facts["sampling_s"]:
        rows.append(("sampling", f"about every {facts['sampling_s']:.2g} s"))
    return [*rows, *_kept_rows(facts["kept"])]


def _kept_rows(kept: list[str] | None) -> list[tuple[str, str]]:
    if kept is None:
        return [("not kept", "further columns, and the exact instants of the samples")]
    return [("kept", ", ".join(["instants of the samples", *kept])), ("not kept", "other columns")]


def _detail_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("map", f"nodes {facts['nodes']:,}, ways {facts['edges']:,}"),
        ("walks", f"parts {facts['parts']:,}, gaps {facts['gaps']:,}"),
        ("waypoints", f"{facts['waypoints']:,}, between which shortest paths give the walks back"),
        (
            "bounds",
            "; ".join(
                f"{name} {low:.7g} to {high:.7g}" for name, (low, high) in facts["bounds"].items()
            ),
        ),
    ]
    if facts["t_start"] is None:
        return [*rows, ("time range", "times are not kept")]
    return [
        *rows,
        ("time range", f"{_format_time(facts['t_start'])} to {_format_time(facts['t_end'])}"),
    ]


def _list_ids(ids: list[str]) -> str:
    shown = ", ".join(ids[:5])
    return f" ({shown}{', ...' if len(ids) > 5 else ''})" if ids else ""


def _describe_axes(facts: dict[str, Any]) -> str:
    return (
        "latitude and longitude"
        if facts["geographic"]
        else f"{facts['dimension']} coordinates on a plane of the log's own"
    )


def _format_time(seconds: float) -> str:
    """Seconds in the log's own zero, and the date where that is 1970."""
    plain = f"{seconds:.3f}".rstrip("0").rstrip(".")
    if not _EPOCH_SECONDS[0] <= seconds < _EPOCH_SECONDS[1]:
        return f"{plain} s"
    return f"{plain} s ({datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S} UTC)"
