"""gpszip info: describe the contents of an archive."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from gpszip.cli.options import Settings, archive_argument, common_options, map_option
from gpszip.cli.outcome import Outcome

if TYPE_CHECKING:
    from gpszip.archive import Archive

__all__ = ["command"]

#: Names of error bounds.
_BOUND_NAMES = {"rmse": "RMSE", "max_error": "largest error"}

#: Tracks that are named.
_MAX_NAMED = 5


@click.command("info", short_help="Describe the contents of an archive.")
@archive_argument
@map_option
@click.option(
    "--detail",
    is_flag=True,
    help="Decode the walks, too: nodes, edges, segments, gaps, waypoints, bounds, time range.",
)
@common_options
@click.pass_obj
def command(settings: Settings, archive: str, map_name: str | None, detail: bool) -> Outcome:
    """Describe ARCHIVE: tracks, sizes, plane, resolution of positions and times."""
    from gpszip.cli.archives import explain_corruption, open_archive_bytes, read_archive_bytes
    from gpszip.cli.output import print_json

    # Read.
    data = read_archive_bytes(archive)
    with explain_corruption(archive, data):
        facts = _facts(data, open_archive_bytes(archive, data, map_name), detail=detail)
    if settings.json:
        print_json({"archive": archive, **facts})
        return Outcome.DONE

    # For a person: labels and texts in two columns.
    rows = _summary_rows(facts)
    width = max(len(label) for label, _ in rows)
    for label, text in rows:
        click.echo(f"{label:<{width}}  {text}")
    if not detail:
        click.echo("nodes, edges, bounds and times: gpszip info --detail")
    return Outcome.DONE


def _facts(data: bytes, archive: Archive, *, detail: bool) -> dict[str, Any]:
    """Return the contents for JSON: lengths in metres, times in seconds."""
    from gpszip.container.verify import verify_bytes

    # The file.
    # The version, the form and the sizes of sections are known of the bytes only.
    verdict = verify_bytes(data)
    facts = archive.info(decode=detail)
    facts["bytes"] = len(data)
    facts["version"] = verdict.version
    facts["form"] = verdict.form
    facts["ids"] = list(archive.ids)
    facts["sections"] = [
        {"kind": section.kind, "bytes": section.size} for section in verdict.sections
    ]

    # The grid, which counts milliseconds, millimetres and 1e-7 degrees.
    grid = archive.grid
    centers = grid.plane.centers if grid.plane else ()
    facts["epoch"] = grid.epoch / 1000
    facts["origin"] = [value / 1000 for value in grid.origin]
    facts["planes"] = [[lat / 1e7, lon / 1e7] for lat, lon in centers]
    if detail:
        facts["bounds"] = _bounds(archive)
    return facts


def _bounds(archive: Archive) -> dict[str, list[float]]:
    """Return the smallest and largest coordinates of the map: degrees if it is on the earth."""
    import numpy as np

    # A map without nodes has no bounds: NumPy has no minimum of an empty array.
    nodes, plane = archive.road_map.nodes, archive.grid.plane
    if not len(nodes):
        return {}

    # Name the axes: degrees on the earth, else metres along x, y, z, or numbered above three.
    dimension = nodes.shape[1]
    if plane is not None:
        from gpszip.geo.planes import to_geographic

        # Nodes are in metres on the plane, bounds in degrees.
        names, columns = ["lat", "lon"], list(to_geographic(nodes, plane))
    elif dimension <= 3:
        names, columns = list("xyz"[:dimension]), list(nodes.T)
    else:
        names, columns = [f"x{axis}" for axis in range(dimension)], list(nodes.T)
    return {
        name: [float(np.min(column)), float(np.max(column))]
        for name, column in zip(names, columns, strict=True)
    }


def _summary_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Return label and text of each line for a person."""
    from gpszip.io.logs.raw import name_heights

    # The file.
    layer = f", packed with {facts['layer']}" if facts["layer"] else ""
    rows = [
        ("format", f"version {facts['version']}, {facts['form']}{layer}"),
        ("size", f"{facts['bytes']:,} bytes, groups {facts['groups']:,}"),
        ("tracks", f"{facts['tracks']:,}{_list_ids(facts['ids'])}"),
    ]

    # Its walks, positions and times.
    if "nodes" in facts:
        rows += _detail_rows(facts)
    rows += _resolution_rows(facts)

    # What else is known.
    if facts["map"]:
        rows.append(("map", f"kept elsewhere, {facts['map']}"))
    if facts["error_bound"]:
        rows.append(("error bound", _describe_error_bound(facts)))
    if facts["sampling_s"]:
        rows.append(("sampling", f"about every {facts['sampling_s']:.2g} s"))
    for curve in facts["curves"]:
        unit = " m" if name_heights([curve["name"]]) else ""
        text = f"within {curve['bound']:g}{unit} at every point, {curve['bytes']:,} bytes"
        rows.append((f"column {curve['name']}", text))
    return [*rows, *_kept_rows(facts["kept"], facts["exact_logs"])]


def _detail_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the lines about decoded walks."""
    from gpszip.cli.units import format_time

    bounds = "; ".join(
        f"{name} {low:.7g} to {high:.7g}" for name, (low, high) in facts["bounds"].items()
    )
    if facts["t_start"] is None:
        time_range = "times are not kept"
    else:
        time_range = f"{format_time(facts['t_start'])} to {format_time(facts['t_end'])}"

    return [
        ("map", f"nodes {facts['nodes']:,}, edges {facts['edges']:,}"),
        ("walks", f"segments {facts['segments']:,}, gaps {facts['gaps']:,}"),
        ("waypoints", f"{facts['waypoints']:,}; shortest paths between them give the walks"),
        ("bounds", bounds),
        ("time range", time_range),
    ]


def _resolution_rows(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the lines about the resolution of positions and times."""
    from gpszip.cli.units import format_length, format_time

    rows = [("positions", f"{_describe_axes(facts)}, to {format_length(facts['node_step_m'])}")]
    for number, (lat, lon) in enumerate(facts["planes"]):
        rows.append((f"plane {number}", f"about latitude {lat:.5f}, longitude {lon:.5f}"))
    if not facts["timed"]:
        return [*rows, ("times", "none: the shapes of the tracks alone")]

    epoch = format_time(facts["epoch"])
    rows.append(("times", f"to {facts['time_step_s']:.3g} s, from epoch {epoch}"))
    if facts.get("untimed"):
        rows.append(("no times", f"tracks {len(facts['untimed']):,}{_list_ids(facts['untimed'])}"))
    return rows


def _describe_error_bound(facts: dict[str, Any]) -> str:
    from gpszip.cli.units import format_length

    text = f"{_BOUND_NAMES[facts['error_bound']]} at most {format_length(facts['error_bound_m'])}"
    if facts["error_bound_max_m"] is not None:
        text += f", largest error at most {format_length(facts['error_bound_max_m'])}"
    return text


def _kept_rows(kept: list[str] | None, exact_logs: list[str]) -> list[tuple[str, str]]:
    """Return the lines about what is kept of the samples, and what is not."""
    # Logs that are kept byte by byte hold everything.
    if exact_logs:
        has_parquet = any(name.lower().endswith((".parquet", ".pq")) for name in exact_logs)
        of_parquet = ", of Parquet every value" if has_parquet else ""
        return [("kept", f"every byte of the logs{of_parquet}{_list_ids(exact_logs)}")]
    if kept is None:
        return [("not kept", "further columns, and the exact times of the samples")]
    return [("kept", ", ".join(["times of the samples", *kept])), ("not kept", "other columns")]


def _list_ids(ids: list[str]) -> str:
    shown = ", ".join(ids[:_MAX_NAMED])
    return f" ({shown}{', ...' if len(ids) > _MAX_NAMED else ''})" if ids else ""


def _describe_axes(facts: dict[str, Any]) -> str:
    if facts["geographic"]:
        return "latitude and longitude"
    return f"{facts['dimension']} coordinates on the log's own plane"
