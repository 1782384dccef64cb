"""The error bound of an archive holds for the columns of a file written from it, interpolated."""

import csv
import io
import json
from datetime import UTC, datetime
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from gpszip.archive import new_archive, with_error_bound
from gpszip.codec.numbering import number_by_visit
from gpszip.geo.planes import choose_plane, to_plane
from gpszip.io.logs.track_rows import metre_decimals
from gpszip.io.logs.write import write_tracks
from gpszip.model import GridWalk, GridWalks, Options, Plane, QuantisationGrid, Track
from gpszip.model.error_bound import rounded_bound, writing_error
from gpszip.model.grid import step_index
from gpszip.pipeline.compress import compress
from gpszip.testing.city import city
from random_tests import examples

FORMATS = ["csv", "parquet", "geojson", "gpx"]


def written(archive, format_):
    """Times, latitudes and longitudes of each line that decompress writes."""
    stream, error = io.BytesIO(), writing_error(archive.error_bound, geographic=True)
    write_tracks(
        archive.decompress(),
        stream,
        format_,
        decimals=metre_decimals(error),
        pieces=archive.pieces,
        max_deviation=error,
    )
    return {"csv": csv_lines, "parquet": parquet_lines, "geojson": geojson_lines, "gpx": gpx_lines}[
        format_
    ](stream.getvalue())


def csv_lines(data):
    rows = list(csv.DictReader(data.decode().splitlines()))
    return by_name(
        [row["track_id"] for row in rows],
        [[float(row[key]) for key in ("t", "lat", "lon")] for row in rows],
    )


def parquet_lines(data):
    table = pq.read_table(io.BytesIO(data))
    return by_name(
        table["track_id"].to_pylist(),
        np.stack([table[key].to_numpy() for key in ("t", "lat", "lon")], axis=1).tolist(),
    )


def by_name(names, rows):
    return [
        np.array([row for row_name, row in zip(names, rows, strict=True) if row_name == name])
        for name in dict.fromkeys(names)
    ]


def geojson_lines(data):
    lines = []
    for feature in json.loads(data)["features"]:
        coordinates = feature["geometry"]["coordinates"]
        times = feature["properties"]["times"]
        if feature["geometry"]["type"] != "MultiLineString":
            coordinates, times = [coordinates], [times]
        for line, line_times in zip(coordinates, times, strict=True):
            lines.append(np.column_stack([line_times, np.array(line)[:, ::-1]]))
    return lines


def gpx_lines(data):
    space = {"g": "http://www.topografix.com/GPX/1/1"}
    lines = []
    for segment in ElementTree.fromstring(data).findall(".//g:trkseg", space):
        times = [seconds(point.findtext("g:time", namespaces=space)) for point in segment]
        positions = [[float(point.get("lat")), float(point.get("lon"))] for point in segment]
        lines.append(np.column_stack([times, positions]))
    return lines


def seconds(text):
    return (datetime.fromisoformat(text) - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()


def deviation(archive, lines, times):
    """Largest distance in metres between an archive's tracks and lines, and the times compared."""
    largest, compared = 0.0, 0
    for track in archive.ids:
        positions = archive.position(track, times)
        for line in lines:
            is_within = (times >= line[0, 0]) & (times <= line[-1, 0])
            is_within &= ~np.isnan(positions[:, 0])
            distances = metres(interpolate(line, times[is_within]), positions[is_within])
            largest = max(largest, distances.max(initial=0.0))
            compared += is_within.sum()
    return largest, compared


def interpolate(line, times):
    """Latitudes and longitudes of a line, each linear in time."""
    return np.stack([np.interp(times, line[:, 0], axis) for axis in line[:, 1:].T], axis=1)


def metres(a, b):
    """Distances on a sphere whose radius is the largest radius of curvature of the earth."""
    (lat, lon), (north, east) = np.radians(a).T, np.radians(b).T
    half = (
        np.sin((lat - north) / 2) ** 2 + np.cos(lat) * np.cos(north) * np.sin((lon - east) / 2) ** 2
    )
    return 2 * 6_400_000 * np.arcsin(np.sqrt(half))


def archive_of(positions, times, plane, bound):
    """An archive of one walk, on a grid of metres and hundredths of a second."""
    nodes, number = np.unique(np.rint(positions).astype(np.int64), axis=0, return_inverse=True)
    time_steps = np.rint(times * 100).astype(np.int64)
    no_breaks = np.zeros(len(time_steps) - 1, np.bool_)
    walk = GridWalk(number.reshape(-1).astype(np.int32), time_steps, no_breaks)
    grid = QuantisationGrid((0, 0), 1_700_000_000_000, step_index(1.0), step_index(0.01), plane)
    grid_walks = number_by_visit(GridWalks(nodes, (walk,)))
    return with_error_bound(
        new_archive(grid, ["a"], grid_walks), rounded_bound(bound, maximum=True)
    )


@examples(25, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from([(48.0, 11.0), (-17.0, 180.0), (80.0, 20.0), (0.0, -179.5), (-80.0, 179.9)]),
    st.lists(
        st.tuples(st.integers(-250_000, 250_000), st.integers(-250_000, 250_000)),
        min_size=2,
        max_size=4,
        unique=True,
    ),
    st.sampled_from([1.0, 10.0, 200.0]),
    st.sampled_from(FORMATS),
    st.integers(0, 2**32 - 1),
)
def test_files_stay_within_a_small_share_of_the_error_bound(
    center, positions, bound, format_, seed
):
    rng = np.random.default_rng(seed)
    plane = Plane(((round(center[0] * 1e7), round(center[1] * 1e7)),))
    times = np.cumsum(rng.uniform(600, 9000, len(positions)))
    archive = archive_of(np.array(positions), times, plane, bound)
    lines = written(archive, format_)
    (knots,) = archive.decompress()
    assert all((np.diff(line[:, 0]) > 0).all() for line in lines)
    assert (lines[0][0, 0], lines[-1][-1, 0]) == pytest.approx(
        (knots.times[0], knots.times[-1]), abs=6e-4
    )

    # Rows on both sides of the antimeridian are a microsecond apart. Between them, interpolation
    # goes round the world.
    crossings = np.concatenate([line[:-1][np.abs(np.diff(line[:, 2])) > 180, 0] for line in lines])
    times = rng.uniform(knots.times[0], knots.times[-1], 2000)
    times = times[~(np.abs(times[:, None] - crossings) < 1e-5).any(axis=1)]
    largest, compared = deviation(archive, lines, times)
    assert compared > 1900
    # On the sphere, distances are up to 1 % too long.
    assert largest <= 1.01 * bound / 500


def flight(n=45, km=3000.0):
    """A flight along a great circle from 48 N, 10 W to the east, sampled every five minutes."""
    start, north = (
        np.array([np.cos(np.radians(48)), 0, np.sin(np.radians(48))]),
        np.array([0.0, 1.0, 0.0]),
    )
    angle = np.linspace(0, km / 6371, n)[:, None]
    x, y, z = (start * np.cos(angle) + north * np.sin(angle)).T
    return (
        1.7e9 + 300.0 * np.arange(n),
        np.degrees(np.arcsin(z)),
        np.degrees(np.arctan2(y, x)) - 10.0,
    )


def test_samples_of_a_long_flight_are_within_the_bound_of_every_file():
    times, lat, lon = flight()
    plane, bound = choose_plane(lat, lon), 10.0
    assert len(plane.centers) > 2
    track = Track("flight", times, to_plane(lat, lon, plane), plane=plane)
    archive, _ = compress([track], Options(max_error=bound, effort=1))
    for format_ in FORMATS:
        covered = np.zeros(len(times), np.bool_)
        for line in written(archive, format_):
            is_within = (times >= line[0, 0] - 1e-3) & (times <= line[-1, 0] + 1e-3)
            covered |= is_within
            samples = np.stack([lat[is_within], lon[is_within]], axis=1)
            # On the sphere, distances are up to 1 % too long.
            distances = metres(interpolate(line, times[is_within]), samples)
            assert distances.max() <= 1.01 * bound
        assert covered.all()


def test_files_of_a_town_have_the_knots_and_no_more():
    logs = city(vehicles=1, duration=3600.0, period=60.0)
    ((times, degrees),) = logs.values()
    plane = choose_plane(*degrees.T)
    archive = archive_of(to_plane(*degrees.T, plane), times, plane, 10.0)
    for format_ in FORMATS:
        assert sum(map(len, written(archive, format_))) == len(times)
