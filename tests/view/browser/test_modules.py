"""Modules of the script beside what Python computes."""

import json

import numpy as np
import pytest

from gpszip.model import Plane
from gpszip.model.projection import projection, to_geographic
from gpszip.view.blocks import pack_numbers
from view.browser.driving import module


@pytest.fixture(scope="module")
def evaluate(browser):
    """Evaluate an expression with the names of a module."""
    browser.get("about:blank")

    def call(name, expression, *values):
        script = f"{module(name)}; const v = arguments; const done = v[v.length - 1];"
        script += f"Promise.resolve({expression}).then(done, (error) => done(String(error)));"
        return browser.execute_async_script(script, *values)

    return call


@pytest.mark.parametrize("center", [(525000000, 134000000), (-700000000, 1799000000), (0, 0)])
def test_planes_are_those_of_pyproj(evaluate, center):
    rng = np.random.default_rng(1)
    positions = rng.uniform(-300_000, 300_000, (50, 2))
    degrees = [value / 1e7 for value in center]
    found = evaluate(
        "geodesy.js", "v[0].map(([x, y]) => toDegrees(x, y, v[1]))", positions.tolist(), degrees
    )
    lat, lon = to_geographic(positions, Plane((center,)))
    apart = np.array(found) - np.column_stack([lat, lon])
    apart[:, 1] = (apart[:, 1] + 180) % 360 - 180
    assert np.abs(apart).max() < 1e-9

    # And back.
    back = evaluate("geodesy.js", "v[0].map(([a, o]) => toPlane(a, o, v[1]))", found, degrees)
    east, north = projection(center).transform(lon, lat)
    np.testing.assert_allclose(back, np.column_stack([east, north]), atol=1e-4)


@pytest.mark.parametrize(
    "values",
    [
        [],
        [5.0],
        [3.0, -2.0, 1e6, 1e6 + 1, 0.0],
        (np.cumsum(np.arange(300)) % 977 * 0.25).tolist(),
        (1.7e9 + np.arange(1000) * 5.0).tolist(),
    ],
)
def test_blocks_come_back(evaluate, values):
    found = evaluate(
        "blocks.js", "decodeBlock(v[0]).then((b) => [...b])", pack_numbers(values, 0.25)
    )
    np.testing.assert_allclose(found, values, atol=0.126)


def test_nan_comes_back(evaluate):
    values = np.array([np.nan, 0.5, 1e5, np.nan, 2.25])
    block = json.loads(json.dumps(pack_numbers(values, 0.25, with_nan=True)))
    found = evaluate(
        "blocks.js",
        "decodeBlock(v[0]).then((b) => [...b].map((x) => (x === x ? x : 'NaN')))",
        block,
    )
    assert found == ["NaN", 0.5, 1e5, "NaN", 2.25]


@pytest.mark.parametrize(
    ("text", "zone", "expected"),
    [
        ("2024-03-31 03:30", "Europe/Berlin", 1711848600),
        ("2024-03-31 01:30", "Europe/Berlin", 1711845000),
        ("2024-07-01 12:00:01.5", "UTC", 1719835201.5),
        ("00:30", "UTC", 1719880200),
        ("23:30", "UTC", 1719876600),
        ("1719876600", "UTC", 1719876600),
        ("25 o'clock", "UTC", None),
        ("", "UTC", None),
    ],
)
def test_times_are_read_in_their_zone(evaluate, text, zone, expected):
    extent = [1719870000, 1719900000]  # from 2024-07-01 21:40 UTC on, past midnight
    assert (
        evaluate("times.js", "parseTime(v[0], 'unix', v[1], v[2])", text, zone, extent) == expected
    )


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        ("formatLength(0.123, 'm')", "12.3 cm"),
        ("formatLength(1609.344, 'mi')", "1 mi"),
        ("formatLength(999.4, 'km')", "999 m"),
        ("formatLength(999.7, 'km')", "1 km"),
        ("formatSpeed(10, 'km')", "36 km/h"),
        ("formatDuration(59.96)", "1 min"),
        ("formatDuration(3725)", "1 h 2 min"),
        ("formatDuration(0.25)", "0.25 s"),
        ("formatNumber(-1234.5)", "-1,235"),
        ("formatNumber(NaN)", "\u2013"),
        ("formatDegrees(-33.86, 'lat', 2)", "33.86\u00b0 S"),
    ],
)
def test_numbers_are_written_for_people(evaluate, expression, text):
    written = evaluate("format.js", expression).replace("\u202f", " ").replace("\u2212", "-")
    assert written == text


def test_a_pyramid_keeps_one_point_in_a_cell_and_the_worst_of_them(evaluate):
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0, 100, (2, 20_000))
    weight = rng.uniform(0, 1, 20_000)
    box = {"minX": 0, "minY": 0, "maxX": 100, "maxY": 100}
    levels = evaluate(
        "pyramid.js",
        "buildPyramid(Float64Array.from(v[0]), Float64Array.from(v[1]), Float64Array.from(v[2]),"
        "v[3]).levels.map(({cell, points}) => ({cell, points: [...points]}))",
        x.tolist(),
        y.tolist(),
        weight.tolist(),
        box,
    )
    assert sorted(levels[-1]["points"]) == list(range(20_000))
    for level in levels[:-1]:
        points = np.array(level["points"])
        cells = np.floor(y / level["cell"]) * 10_000 + np.floor(x / level["cell"])
        assert len(np.unique(cells[points])) == len(points) == len(np.unique(cells))
        best = {cell: weight[cells == cell].max() for cell in np.unique(cells)[:200]}
        kept = dict(zip(cells[points], weight[points], strict=True))
        assert all(kept[cell] >= best[cell] - 1 / 128 for cell in best)


def test_all_points_in_a_window_are_visited(evaluate):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 100, (2, 5000))
    seen = {"minX": 20, "minY": 30, "maxX": 60, "maxY": 45}
    visited = evaluate(
        "pyramid.js",
        "(() => { const p = buildPyramid(Float64Array.from(v[0]), Float64Array.from(v[1]),"
        "new Float64Array(5000), {minX: 0, minY: 0, maxX: 100, maxY: 100}); const found = [];"
        "visitPoints(p, v[2], 1e-6, (points, a, b) => found.push(...points.subarray(a, b)));"
        "return found; })()",
        x.tolist(),
        y.tolist(),
        seen,
    )
    inside = (x >= 20) & (x <= 60) & (y >= 30) & (y <= 45)
    assert set(np.flatnonzero(inside)) <= set(visited)
    assert len(visited) == len(set(visited)) < 2500


@pytest.mark.parametrize(
    ("segment", "expected"),
    [
        ([10, 10, 20, 20], [10, 10, 20, 20]),
        ([-10, 5, 10, 5], [0, 5, 10, 5]),
        ([5, -10, 5, 200], [5, 0, 5, 99]),
        ([-5, -5, -1, -9], None),
        ([-10, 10, 10, -50], None),
    ],
)
def test_segments_are_clipped_to_the_canvas(evaluate, segment, expected):
    found = evaluate(
        "pixels.js", "(() => { const e = clip(...v[0], 100, 100); return e && [...e]; })()", segment
    )
    assert found == (expected and pytest.approx(expected))


def test_the_first_view_is_where_travel_is(evaluate):
    # A street of a kilometre, and three fixes off the coast of Africa.
    rng = np.random.default_rng(2)
    street = np.column_stack([rng.uniform(0, 1000, 2000), rng.uniform(0, 5, 2000)])
    far = np.array([[4e6, -5e6], [4e6, -5e6], [-3e6, 10.0]])

    def areas(positions):
        columns = dict(zip("xy", positions.T.tolist(), strict=True))
        scene = {"planes": [], "spread": 0, "archives": [{"nodes": columns, "knots": columns}]}
        (area,) = evaluate("viewport.js", "findAreas(v[0])", scene)
        return [
            [area[name][side] for side in ("minX", "minY", "maxX", "maxY")]
            for name in ("box", "main")
        ]

    box, main = areas(np.concatenate([street, far]))
    assert box == [-3e6, -5e6, 4e6, 10.0]
    assert main == [*street.min(axis=0), *street.max(axis=0)]

    # Without them, or where they are a good part of all travel, all is shown.
    assert areas(street)[1] == areas(street)[0] == main
    box, main = areas(np.concatenate([street[:100], far]))
    assert box == main


def test_jumps_are_no_top_speed(evaluate):
    # Forty seconds at 10 m/s, and a jump of two kilometres.
    x = np.append(10.0 * np.arange(40), 2400.0)
    knots = {"x": x.tolist(), "y": [0.0] * 41, "time": list(range(41)), "line": [0] * 41}
    found = evaluate(
        "walks.js",
        "(v[0].x = Float64Array.from(v[0].x), measureWalk({knots: {...v[0], z: null, "
        "joined: v[0].line.map(() => true)}, tracks: {offsets: [0, 41], timed: [true]}}, 0, "
        "[0, 41]))",
        knots,
    )
    assert found == {"distance": 2400, "moving": 40, "fastest": 10, "jumps": 1}
