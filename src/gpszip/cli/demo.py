"""gpszip demo: generate the log of a robot patrol, compress, decompress and draw it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gpszip.cli.options import Settings, common_options, force, seed_option
from gpszip.cli.outcome import Outcome

if TYPE_CHECKING:
    from gpszip.archive import Archive
    from gpszip.model import Report, Track
    from gpszip.model.read_result import ReadResult

__all__ = ["command"]

#: Files that the demo writes; the picture needs the extra ``plot``.
_FILES = ("patrol.csv", "patrol.gpsz", "knots.csv", "map.geojson", "map.png", "page.html")

#: RMSE in metres, that of the thesis's ground robot.
_RMSE = 0.24


@click.command("demo", short_help="Compress a generated robot patrol and draw its map.")
@click.option(
    "--out", metavar="FOLDER", default="gpszip-demo", show_default=True, help="Folder to write to."
)
@seed_option("the building and the patrol")
@click.option(
    "--points",
    type=click.IntRange(2),
    default=72_273,
    show_default=True,
    help="Length of the patrol, at 13 points a second.",
)
@force
@common_options
@click.pass_obj
def command(settings: Settings, out: str, seed: int, points: int, force: bool) -> Outcome:
    """Generate the patrol of a robot, compress it within 24 cm, decompress it, and write its map.

    A page shows it in a browser. With the extra 'plot', the map is drawn over the log, too.
    """
    from gpszip.cli.output import print_json, print_status
    from gpszip.cli.progress import progress_bar
    from gpszip.cli.summary import summary_as_dict
    from gpszip.io.logs.read import read_logs
    from gpszip.model import Options
    from gpszip.pipeline.compress import compress

    # Generate, compress, decompress, draw.
    folder = _prepare_folder(Path(out), force=force)
    print_status(f"generating {points:,} points of a robot on its rounds")
    _write_log(folder / "patrol.csv", points, seed)
    with progress_bar(quiet=settings.json) as listener:
        read_result = read_logs([folder / "patrol.csv"])
        archive, report = compress(read_result.tracks, Options(rmse=_RMSE), progress=listener)
    archive.save(folder / "patrol.gpsz", force=True)
    _write_decompressed(archive, folder)
    _write_page(archive, read_result, folder)
    missing = _draw(folder, read_result.tracks, archive)

    # Say what was written.
    written = sorted(path.name for path in folder.iterdir() if path.name in _FILES)
    if settings.json:
        print_json({"folder": out, "written": written, **summary_as_dict(read_result, report)})
        return Outcome.DONE
    for line in _report_lines(read_result, report):
        click.echo(line)
    click.echo(f"in {out}: {', '.join(written)}")
    if missing:
        print_status(missing)
    else:
        click.echo(f"look at {folder / 'map.png'}: the learned map over the points")
    click.echo(f"open {folder / 'page.html'} in a browser: the robot drives, errors are charted")
    return Outcome.DONE


def _prepare_folder(folder: Path, *, force: bool) -> Path:
    """Make the folder, and remove the files of an earlier demo."""
    from gpszip.cli.output import make_folder
    from gpszip.errors import OutputError

    # Refuse to replace files of an earlier demo unless --force is given.
    existing = [name for name in _FILES if (folder / name).exists()]
    if existing and not force:
        raise OutputError(
            "exists already",
            path=folder / existing[0],
            remedy="add --force to replace it, or name another folder with --out",
        )

    # Make the folder, then remove all earlier files: one that isn't written again, such as a
    # picture without the extra 'plot', would be listed as written.
    make_folder(folder, "--out")
    for name in existing:
        (folder / name).unlink()
    return folder


def _write_page(archive: Archive, read_result: ReadResult, folder: Path) -> None:
    """Write the page of ``gpszip view``."""
    from gpszip.view.write import write_page

    write_page(archive, folder / "page.html", raw=read_result, title="patrol.gpsz", force=True)


def _write_log(path: Path, points: int, seed: int) -> None:
    from gpszip.io.logs.write import write_tracks
    from gpszip.testing import patrol

    write_tracks([patrol(points, seed=seed)], path)


def _write_decompressed(archive: Archive, folder: Path) -> None:
    """Write the knots and the map that was learned."""
    from gpszip.io.logs.track_rows import metre_decimals
    from gpszip.io.logs.write import write_tracks
    from gpszip.io.maps.write import write_map
    from gpszip.model.error_bound import writing_error

    # Round by a share of the error bound, which the log that is written still holds.
    error = writing_error(archive.error_bound, geographic=archive.grid.plane is not None)
    write_tracks(
        archive.decompress(),
        folder / "knots.csv",
        decimals=metre_decimals(error),
        max_deviation=error,
    )
    write_map(archive.trimmed_map, folder / "map.geojson")


def _draw(folder: Path, tracks: Sequence[Track], archive: Archive) -> str:
    """Draw the map over the log, or return what is missing for it."""
    from gpszip.errors import MissingExtraError
    from gpszip.view.plot import plot

    points = sum(len(track) for track in tracks)
    title = f"{points:,} points as {archive.size:,} bytes"
    try:
        plot(archive, folder / "map.png", raw=tracks, title=title)
    except MissingExtraError as error:
        return f"no picture: {error}"
    return ""


def _report_lines(read_result: ReadResult, report: Report) -> list[str]:
    from gpszip.cli.units import format_bytes, format_length

    ratio = read_result.bytes / report.bytes_out
    rmse, asked, maximum = map(format_length, (report.rmse, _RMSE, report.max_error))
    return [
        f"log      {report.points:,} points, {format_bytes(read_result.bytes)} as CSV",
        f"archive  {report.bytes_out:,} bytes, 1:{ratio:,.0f}, in {report.seconds:.1f} s",
        f"map      nodes {report.nodes:,}, edges {report.edges:,}; "
        f"the walk on it has {report.segments:,} segments",
        f"error    RMSE {rmse} (asked for: {asked}), maximum {maximum}",
    ]
