import json
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from gpszip.io.maps.table import clean_map_table
from gpszip.io.maps.write import find_map_format, map_suffixes, write_map
from gpszip.model import Plane, Walk
from gpszip.simplification import bundling
from gpszip.simplification.bundling import bundle_edges
from gpszip.simplification.cell_grid import (
    build_cell_grid,
    count_cells,
    find_cells,
    line_density,
    smooth_density,
)
from gpszip.simplification.kernels.density import blur
from gpszip.simplification.kernels.grid_paths import cheapest_monotone_paths
from gpszip.simplification.kernels.routes import cheapest_paths
from gpszip.simplification.kernels.smoothing import simplify_lines
from gpszip.simplification.simplify import clean_map
from gpszip.simplification.skeleton import (
    Skeleton,
    build_chains,
    build_skeleton,
    consolidate_junctions,
    prune_spurs,
)
from gpszip.testing.city import drives
from gpszip.walks.counting import build_road_map
from oracle.clean_lines import blurred, cells_near, distance_to_line, path_cost


def archive_like(paths, seconds=10.0, epoch=0.0, d=2):
    """Road map and walks with one node for each position of the paths."""
    nodes = np.concatenate(paths).astype(float)[:, :d]
    starts = np.cumsum([0, *map(len, paths)])
    walks = [
        Walk(
            str(i),
            np.arange(a, b, dtype=np.int32),
            epoch + seconds * np.arange(b - a),
            np.zeros(b - a - 1, bool),
        )
        for i, (a, b) in enumerate(zip(starts[:-1], starts[1:], strict=True))
    ]
    return build_road_map(nodes, walks), walks


def street(n=12, *, noise=3.0, seed=1, length=600.0, y=0.0):
    """Noisy paths along one street, every third of them the other way round."""
    rng = np.random.default_rng(seed)
    along = np.linspace(0, length, 9)
    paths = [np.column_stack([along, rng.normal(y, noise, 9)]) for _ in range(n)]
    return [path if i % 3 else path[::-1] for i, path in enumerate(paths)]


def test_a_busy_street_becomes_one_edge_at_its_centre():
    road_map, walks = archive_like(street())
    streets = clean_map(road_map, walks, 4.0)
    assert len(streets) == 1
    assert sorted([int(streets.forward[0]), int(streets.backward[0])]) == [4, 8]
    assert np.abs(streets[0][:, 1]).max() < 3.0
    assert streets.length[0] == pytest.approx(600, abs=25)
    assert streets.speed[0] == pytest.approx([7.5, 7.5, 7.5], rel=0.05)
    assert 1.0 < streets.width[0] < 5.0
    assert streets.hourly.shape == (1, 0)


def test_distant_streets_stay_two_edges():
    road_map, walks = archive_like(street() + street(y=60.0, seed=2))
    assert len(clean_map(road_map, walks, 4.0)) == 2


@pytest.mark.parametrize(("segments", "stays"), [(30, True), (2, False)])
def test_an_edge_joins_a_busy_street_only_if_travel_there_was_unobserved(segments, stays):
    across = np.linspace(0, 1, segments + 1)
    curved = np.column_stack([900 * across, 150 * np.sin(np.pi * across)])
    straight = np.array([[0.0, 0.0], [900.0, 0.0]])
    road_map, walks = archive_like([curved] * 20 + [straight], seconds=300 / segments)
    walks[-1] = replace(walks[-1], times=np.array([0.0, 280.0]))
    streets = clean_map(road_map, walks, 8.0)
    curve, middle = (
        min(distance_to_line(np.array(point), streets[i]) for i in range(len(streets)))
        for point in ([450.0, 150.0], [450.0, 0.0])
    )
    assert curve < 8
    assert (middle < 8) == stays


def test_carriageways_15_m_apart_stay_two_edges():
    rng = np.random.default_rng(3)
    paths = []
    for i in range(60):
        along = np.sort(np.r_[0, rng.uniform(0, 3000, 10), 3000])
        across = (7.5 if i % 2 else -7.5) + rng.normal(0, 2.0, len(along))
        paths.append(np.column_stack([along, across])[:: 1 if i % 2 else -1])
    road_map, walks = archive_like(paths, seconds=24.0)
    streets = clean_map(road_map, walks, 3.0, sampling=1.0)
    assert streets.length.sum() == pytest.approx(6000, rel=0.02)
    assert streets.length[np.minimum(streets.forward, streets.backward) > 2].sum() < 60


def test_widths_ignore_streets_that_are_left_out():
    # The knots of a rare street once counted for the width of another.
    road_map, walks = archive_like([*street(noise=0.0), *street(1, noise=0.0, y=300.0)])
    streets = clean_map(road_map, walks, 4.0, min_traversals=2)
    assert len(streets) == 1
    assert streets.width[0] < 1.0


def test_crossing_streets_share_a_junction():
    paths = street() + [path[:, ::-1] + [297.0, -300.0] for path in street(seed=3)]
    road_map, walks = archive_like(paths)
    streets = clean_map(road_map, walks, 4.0)
    assert len(streets) == 4
    assert np.bincount(streets.ends.ravel()).max() == 4
    for i in range(len(streets)):
        assert streets[i][[0, -1]].tolist() == streets.junctions[streets.ends[i]].tolist()


def test_a_long_edge_follows_the_corner_of_others():
    corner = [
        np.array([[0, 0], [100, 0], [200, 0], [200, 100], [200, 200]])
        + np.random.default_rng(i).normal(0, 1, 2)
        for i in range(6)
    ]
    road_map, walks = archive_like([*corner, np.array([[100, 0], [200, 100]])])
    streets = clean_map(road_map, walks, 4.0)
    assert len(streets) == 1
    assert distance_to_line(np.array([150.0, 50.0]), streets[0]) > 30


def test_sparse_samples_of_a_town_give_its_streets():
    town = drives(4, vehicles=25, period=20.0, duration=1200.0, seed=4, noise=5.0, block=150.0)
    road_map, walks = archive_like([xy for _, xy in town.values()], seconds=20.0)
    streets = clean_map(road_map, walks, 8.0, min_traversals=3)
    centrelines = np.arange(5) * 150.0 - 300.0
    off = np.abs(streets.points[:, :, None] - centrelines).min(axis=(1, 2))
    assert np.median(off) < 4.0
    assert 4000 < streets.length.sum() < 9000  # 6 km of streets; raw edges are some 200 km
    assert (streets.forward + streets.backward).min() >= 3
    again = clean_map(road_map, walks, 8.0, min_traversals=3)
    assert again.points.tobytes() == streets.points.tobytes()


def test_outliers_and_gaps_are_no_edges():
    paths = street()
    road_map, walks = archive_like(paths)
    far = np.array([[0.0, 9000.0]])
    nodes = np.concatenate([road_map.nodes, far, far + np.array([300.0, 0])])
    count = len(road_map.nodes)
    walks.append(
        Walk("outlier", np.array([0, count], np.int32), np.array([0.0, 1.0]), np.array([False]))
    )
    walks.append(
        Walk("gap", np.array([0, count + 1], np.int32), np.array([0.0, 5000.0]), np.array([True]))
    )
    streets = clean_map(build_road_map(nodes, walks), walks, 4.0)
    assert streets.points[:, 1].max() < 100


def test_speeds_by_daytime_need_times_since_1970():
    morning, evening = 86_400.0 * 19_000 + 7 * 3600, 86_400.0 * 19_000 + 19 * 3600
    paths = street(4)
    road_map, walks = archive_like(paths * 2)
    moved = [
        Walk(w.id, w.nodes, morning + w.times if i < 4 else evening + 2 * w.times, w.gaps)
        for i, w in enumerate(walks)
    ]
    streets = clean_map(road_map, moved, 4.0)
    assert streets.hourly.shape == (1, 4)
    assert np.isnan(streets.hourly[0, [0, 2]]).all()
    assert streets.hourly[0, 1] == pytest.approx(2 * streets.hourly[0, 3], rel=0.05)
    timeless = [Walk(w.id, w.nodes, None, w.gaps) for w in walks]
    assert np.isnan(clean_map(road_map, timeless, 4.0).speed).all()


@pytest.mark.parametrize("d", [1, 3])
def test_any_number_of_axes(d):
    climbing = [np.column_stack([path, 0.1 * path[:, 0]]) for path in street()]
    road_map, walks = archive_like(climbing, d=d)
    streets = clean_map(road_map, walks, 4.0)
    assert streets.points.shape[1] == d
    if d == 1:
        assert streets.forward.sum() + streets.backward.sum() >= 12
    else:
        assert np.abs(streets.points[:, 2] - 0.1 * streets.points[:, 0]).max() < 2.0


def test_map_of_a_parked_vehicle_is_empty():
    parked = [Walk("0", np.array([0, 0], np.int32), np.array([0.0, 9.0]), np.array([False]))]
    streets = clean_map(build_road_map([[5.0, 5.0]], parked), parked, 1.0)
    assert len(streets) == 0
    assert streets.points.shape == (0, 2)


@pytest.mark.parametrize("suffix", map_suffixes())
@pytest.mark.parametrize("plane", [None, Plane(((525000000, 134000000),))])
def test_every_format_takes_a_clean_map(tmp_path, suffix, plane):
    road_map, walks = archive_like(street())
    streets = clean_map(build_road_map(road_map.nodes, walks, plane=plane), walks, 4.0)
    path = tmp_path / f"map{suffix}"
    if plane is None and find_map_format(path).degrees_only:
        return
    write_map(streets, path)
    assert path.stat().st_size > 0
    if suffix == ".geojson":
        (feature,) = json.loads(path.read_text())["features"]
        assert len(feature["geometry"]["coordinates"]) == len(streets.points)
        assert list(feature["properties"]) == list(clean_map_table(streets).properties)


def test_cells_have_neighbours_and_a_line_has_density_1():
    starts, ends = np.array([[0.0, 0.0]]), np.array([[60.0, 25.0]])
    grid = build_cell_grid(starts, ends, 1.0, 9)
    assert find_cells(grid, grid.centers).tolist() == list(range(len(grid)))
    step = np.where(
        grid.neighbours[:, 1, None] >= 0, grid.centers[grid.neighbours[:, 1]] - grid.centers, 1.0
    )
    assert np.allclose(step, 1.0)
    height = smooth_density(grid, line_density(grid, starts, ends, np.ones(1)), 2.5)
    assert height[find_cells(grid, np.array([[30.0, 12.5]]))] == pytest.approx(1.0, rel=0.1)
    values = np.random.default_rng(0).random(len(grid))
    assert np.allclose(blur(values, grid.neighbours, 3), blurred(values, grid.neighbours, 3))


@pytest.mark.parametrize(("lines", "margin"), [(1, 3), (6, 0), (12, 1), (25, 5)])
def test_a_grid_has_all_cells_near_its_lines_and_their_neighbours(lines, margin):
    rng = np.random.default_rng(lines)
    starts = rng.normal(0, 15, (lines, 2))
    ends = starts + rng.normal(0, 10, (lines, 2))
    ends[0] = starts[0]
    grid = build_cell_grid(starts, ends, 0.7, margin)
    cells = list(map(tuple, np.rint(grid.centers / 0.7).astype(int).tolist()))
    assert cells == sorted(cells_near(starts, ends, 0.7, margin))
    assert count_cells(starts, ends, 0.7, margin) == len(cells)

    # counterclockwise from the east
    number = {cell: index for index, cell in enumerate(cells)}
    steps = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    assert grid.neighbours.tolist() == [
        [number.get((column + i, row + j), -1) for i, j in steps] for column, row in cells
    ]


def test_a_map_finer_than_its_cells_is_cleaned_without_building_finer_grids(monkeypatch):
    # Such maps once came out empty, after grids of eight times as many cells were built.
    monkeypatch.setattr(bundling, "_MAX_CELLS", 20_000)
    rng = np.random.default_rng(5)
    path = np.cumsum(rng.normal([30, 0], [1, 30], (60, 2)), axis=0)
    road_map, walks = archive_like([path])
    clean_map(road_map, walks, 0.01)  # compiles
    tracemalloc.start()
    streets = clean_map(road_map, walks, 0.01)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    driven = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert (streets.forward + streets.backward).tolist() == [1] * len(streets)
    assert streets.length.sum() == pytest.approx(driven, rel=0.05)
    assert peak < 400 * 20_000


@pytest.mark.parametrize("may_turn_back", [True, False])
def test_paths_are_the_cheapest_within_their_corridor(may_turn_back):
    rng = np.random.default_rng(5)
    grid = build_cell_grid(np.array([[0.0, 0.0]]), np.array([[12.0, 6.0]]), 1.0, 3)
    price = rng.random(len(grid)) ** 3 + 0.01
    starts, ends = rng.integers(0, len(grid), (2, 60)).astype(np.int32)
    max_detour = 1.2 * np.linalg.norm(grid.centers[ends] - grid.centers[starts], axis=1) + 2.0
    max_offset = rng.uniform(0.1, 4.0, 60)
    corridors = (price, starts, ends, max_detour, max_offset)
    if may_turn_back:
        offsets, cells = cheapest_paths(grid.centers, grid.neighbours, *corridors)
    else:
        offsets, cells = cheapest_monotone_paths(
            grid.centers, grid.neighbours, grid.size, *corridors
        )

    assert 5 < (np.diff(offsets) > 0).sum() < 60
    for i in range(60):
        path = cells[offsets[i] : offsets[i + 1]]
        expected = path_cost(
            grid.centers,
            grid.neighbours,
            price,
            *(values[i] for values in corridors[1:]),
            may_turn_back,
        )
        assert (len(path) > 0) == np.isfinite(expected)
        if len(path):
            assert (path[0], path[-1]) == (starts[i], ends[i])
            assert (np.abs(np.diff(grid.centers[path], axis=0)) < 1.01).all()
            step = np.linalg.norm(np.diff(grid.centers[path], axis=0), axis=1)
            assert (step * (price[path[:-1]] + price[path[1:]]) / 2).sum() == pytest.approx(
                expected
            )


def test_a_loop_becomes_a_ring_and_a_small_hole_is_filled():
    turn = np.linspace(0, 2 * np.pi, 40)
    ring = 30 * np.column_stack([np.cos(turn), np.sin(turn)])
    grid = build_cell_grid(ring[:-1], ring[1:], 1.0, 5)
    density = line_density(grid, ring[:-1], ring[1:], np.full(39, 3.0))
    skeleton = build_skeleton(grid, density, 100.0)
    degrees = skeleton.degrees
    assert (len(build_chains(skeleton)), degrees.min(), degrees.max()) == (1, 2, 2)
    assert np.abs(np.linalg.norm(skeleton.positions, axis=1) - 30).max() < 1.5
    assert len(build_skeleton(grid, density, 1e9).links) > 0


def test_the_longer_of_two_dead_ends_stays():
    fork = Skeleton(
        np.array([[0.0, 0], [50, 0], [53, 1], [55, -2]]),
        np.array([[0, 1], [1, 2], [1, 3]], np.int32),
    )
    pruned = prune_spurs(fork, 20.0)
    assert pruned.positions.tolist() == [[0, 0], [50, 0], [55, -2]]
    assert len(consolidate_junctions(fork, 1.0).links) == 3


def test_lines_keep_their_shape_within_the_tolerance():
    rng = np.random.default_rng(2)
    line = np.cumsum(rng.normal(0, 1, (200, 2)), axis=0)
    kept = simplify_lines(line, np.array([0, 120, 200]), 1.5)
    for a, b in ((0, 120), (120, 200)):
        simplified = line[a:b][kept[a:b]]
        assert kept[a]
        assert kept[b - 1]
        assert max(distance_to_line(point, simplified) for point in line[a:b]) <= 1.5
    assert kept.sum() < 150


def test_bundles_add_up_traversals():
    nodes = np.array([[0.0, 0], [100, 2], [0, 1], [100, -1]])
    bundles = bundle_edges(
        nodes, np.array([[0, 1], [2, 3]], np.int32), np.array([5.0, 2.0]), np.full(2, 100.0), 3.0
    )
    assert bundles.density.max() == 7.0
