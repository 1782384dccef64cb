import json
from dataclasses import replace

import numpy as np
import pytest

from gpszip.io.maps.table import clean_map_table
from gpszip.io.maps.write import map_suffixes, write_map
from gpszip.model import Plane, Walk
from gpszip.simplification.bundling import bundle_edges
from gpszip.simplification.cell_grid import (
    build_cell_grid,
    find_cells,
    line_density,
    smooth_density,
)
from gpszip.simplification.kernels.density import blur
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
from oracle.clean_lines import blurred, distance_to_line, route_cost


def archive_like(paths, seconds=10.0, epoch=0.0, d=2):
    """One node for each place; nodes, walks and their road map."""
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
    rng = np.random.default_rng(seed)
    along = np.linspace(0, length, 9)
    paths = [np.column_stack([along, rng.normal(y, noise, 9)]) for _ in range(n)]
    return [path if i % 3 else path[::-1] for i, path in enumerate(paths)]


def test_a_street_driven_often_is_one_way_at_its_middle():
    road_map, walks = archive_like(street())
    made = clean_map(road_map, walks, 4.0)
    assert len(made) == 1
    assert sorted([int(made.forward[0]), int(made.backward[0])]) == [4, 8]
    assert np.abs(made[0][:, 1]).max() < 3.0
    assert made.length[0] == pytest.approx(600, abs=25)
    assert made.speed[0] == pytest.approx([7.5, 7.5, 7.5], rel=0.05)
    assert 1.0 < made.width[0] < 5.0
    assert made.hourly.shape == (1, 0)


def test_streets_apart_stay_two_ways():
    road_map, walks = archive_like(street() + street(y=60.0, seed=2))
    assert len(clean_map(road_map, walks, 4.0)) == 2


@pytest.mark.parametrize(("moves", "kept"), [(30, True), (2, False)])
def test_a_busy_street_swallows_only_what_may_have_gone_over_it_unseen(moves, kept):
    across = np.linspace(0, 1, moves + 1)
    curved = np.column_stack([900 * across, 150 * np.sin(np.pi * across)])
    straight = np.array([[0.0, 0.0], [900.0, 0.0]])
    road_map, walks = archive_like([curved] * 20 + [straight], seconds=300 / moves)
    walks[-1] = replace(walks[-1], times=np.array([0.0, 280.0]))
    made = clean_map(road_map, walks, 8.0)
    curve, middle = (
        min(distance_to_line(np.array(point), made[i]) for i in range(len(made)))
        for point in ([450.0, 150.0], [450.0, 0.0])
    )
    assert curve < 8
    assert (middle < 8) == kept


def test_carriageways_15_m_apart_stay_two_ways():
    rng = np.random.default_rng(3)
    paths = []
    for i in range(60):
        along = np.sort(np.r_[0, rng.uniform(0, 3000, 10), 3000])
        across = (7.5 if i % 2 else -7.5) + rng.normal(0, 2.0, len(along))
        paths.append(np.column_stack([along, across])[:: 1 if i % 2 else -1])
    road_map, walks = archive_like(paths, seconds=24.0)
    made = clean_map(road_map, walks, 3.0, sampling=1.0)
    assert made.length.sum() == pytest.approx(6000, rel=0.02)
    assert made.length[np.minimum(made.forward, made.backward) > 2].sum() < 60


def test_only_what_is_on_the_map_tells_widths():
    # A way that is left out for its few travels had lent its knots to the first one.
    road_map, walks = archive_like([*street(noise=0.0), *street(1, noise=0.0, y=300.0)])
    made = clean_map(road_map, walks, 4.0, min_traversals=2)
    assert len(made) == 1
    assert made.width[0] < 1.0


def test_a_crossing_is_shared():
    paths = street() + [path[:, ::-1] + [297.0, -300.0] for path in street(seed=3)]
    road_map, walks = archive_like(paths)
    made = clean_map(road_map, walks, 4.0)
    assert len(made) == 4
    assert np.bincount(made.ends.ravel()).max() == 4
    for way in range(len(made)):
        assert made[way][0].tolist() == made.junctions[made.ends[way, 0]].tolist()
        assert made[way][-1].tolist() == made.junctions[made.ends[way, 1]].tolist()


def test_a_long_edge_follows_the_corner_that_others_show():
    corner = [
        np.array([[0, 0], [100, 0], [200, 0], [200, 100], [200, 200]])
        + np.random.default_rng(i).normal(0, 1, 2)
        for i in range(6)
    ]
    road_map, walks = archive_like([*corner, np.array([[100, 0], [200, 100]])])
    made = clean_map(road_map, walks, 4.0)
    assert len(made) == 1
    assert distance_to_line(np.array([150.0, 50.0]), made[0]) > 30


def test_a_town_of_rare_samples_has_its_streets():
    town = drives(4, vehicles=25, period=20.0, duration=1200.0, seed=4, noise=5.0, block=150.0)
    road_map, walks = archive_like([xy for _, xy in town.values()], seconds=20.0)
    made = clean_map(road_map, walks, 8.0, min_traversals=3)
    streets = np.arange(5) * 150.0 - 300.0
    off = np.abs(made.points[:, :, None] - streets).min(axis=(1, 2))
    assert np.median(off) < 4.0
    assert 4000 < made.length.sum() < 9000  # 6 km of streets; raw edges are some 200 km
    assert (made.forward + made.backward).min() >= 3
    again = clean_map(road_map, walks, 8.0, min_traversals=3)
    assert again.points.tobytes() == made.points.tobytes()


def test_jumps_and_gaps_are_no_way():
    paths = street()
    road_map, walks = archive_like(paths)
    far = np.array([[0.0, 9000.0]])
    nodes = np.concatenate([road_map.nodes, far, far + np.array([300.0, 0])])
    count = len(road_map.nodes)
    walks.append(
        Walk("jump", np.array([0, count], np.int32), np.array([0.0, 1.0]), np.array([False]))
    )
    walks.append(
        Walk("gap", np.array([0, count + 1], np.int32), np.array([0.0, 5000.0]), np.array([True]))
    )
    made = clean_map(build_road_map(nodes, walks), walks, 4.0)
    assert made.points[:, 1].max() < 100


def test_times_of_day_are_told_where_times_are_since_1970():
    morning, evening = 86_400.0 * 19_000 + 7 * 3600, 86_400.0 * 19_000 + 19 * 3600
    paths = street(4)
    road_map, walks = archive_like(paths * 2)
    moved = [
        Walk(w.id, w.nodes, morning + w.times if i < 4 else evening + 2 * w.times, w.gaps)
        for i, w in enumerate(walks)
    ]
    made = clean_map(road_map, moved, 4.0)
    assert made.hourly.shape == (1, 4)
    assert np.isnan(made.hourly[0, [0, 2]]).all()
    assert made.hourly[0, 1] == pytest.approx(2 * made.hourly[0, 3], rel=0.05)
    timeless = [Walk(w.id, w.nodes, None, w.gaps) for w in walks]
    assert np.isnan(clean_map(road_map, timeless, 4.0).speed).all()


@pytest.mark.parametrize("d", [1, 3])
def test_any_number_of_axes(d):
    climbing = [np.column_stack([path, 0.1 * path[:, 0]]) for path in street()]
    road_map, walks = archive_like(climbing, d=d)
    made = clean_map(road_map, walks, 4.0)
    assert made.points.shape[1] == d
    if d == 1:
        assert made.forward.sum() + made.backward.sum() >= 12
    else:
        assert np.abs(made.points[:, 2] - 0.1 * made.points[:, 0]).max() < 2.0


def test_nobody_moved():
    still = [Walk("0", np.array([0, 0], np.int32), np.array([0.0, 9.0]), np.array([False]))]
    made = clean_map(build_road_map([[5.0, 5.0]], still), still, 1.0)
    assert len(made) == 0
    assert made.points.shape == (0, 2)


@pytest.mark.parametrize("suffix", map_suffixes())
@pytest.mark.parametrize("plane", [None, Plane(((525000000, 134000000),))])
def test_every_format_holds_ways(tmp_path, suffix, plane):
    road_map, walks = archive_like(street())
    made = clean_map(build_road_map(road_map.nodes, walks, plane=plane), walks, 4.0)
    path = tmp_path / f"map{suffix}"
    write_map(made, path)
    assert path.stat().st_size > 0
    if suffix == ".geojson":
        (feature,) = json.loads(path.read_text())["features"]
        assert len(feature["geometry"]["coordinates"]) == len(made.points)
        assert list(feature["properties"]) == list(clean_map_table(made).properties)


def test_cells_know_their_neighbours_and_lines_are_one_high():
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


def test_routes_are_the_cheapest_within_their_corridor():
    rng = np.random.default_rng(5)
    grid = build_cell_grid(np.array([[0.0, 0.0]]), np.array([[12.0, 4.0]]), 1.0, 3)
    price = rng.random(len(grid)) + 0.05
    starts, ends = rng.integers(0, len(grid), (2, 40)).astype(np.int32)
    far = 1.2 * np.linalg.norm(grid.centers[ends] - grid.centers[starts], axis=1) + 2.0
    wide = rng.uniform(0.1, 4.0, 40)
    offsets, cells = cheapest_paths(grid.centers, grid.neighbours, price, starts, ends, far, wide)
    assert 5 < (np.diff(offsets) > 0).sum() < 40
    for i in range(40):
        route = cells[offsets[i] : offsets[i + 1]]
        expected = route_cost(
            grid.centers, grid.neighbours, price, starts[i], ends[i], far[i], wide[i]
        )
        assert (len(route) > 0) == np.isfinite(expected)
        if len(route):
            assert (route[0], route[-1]) == (starts[i], ends[i])
            step = np.linalg.norm(np.diff(grid.centers[route], axis=0), axis=1)
            assert (step * (price[route[:-1]] + price[route[1:]]) / 2).sum() == pytest.approx(
                expected
            )


def test_a_loop_is_thinned_to_a_ring_and_a_small_hole_is_filled():
    turn = np.linspace(0, 2 * np.pi, 40)
    ring = 30 * np.column_stack([np.cos(turn), np.sin(turn)])
    grid = build_cell_grid(ring[:-1], ring[1:], 1.0, 5)
    density = line_density(grid, ring[:-1], ring[1:], np.full(39, 3.0))
    lines = build_skeleton(grid, density, 100.0)
    strings = build_chains(lines)
    assert (len(strings), lines.degrees.min(), lines.degrees.max()) == (1, 2, 2)
    assert np.abs(np.linalg.norm(lines.positions, axis=1) - 30).max() < 1.5
    assert len(build_skeleton(grid, density, 1e9).links) > 0


def test_the_longest_of_two_dead_ends_stays():
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
        left = line[a:b][kept[a:b]]
        assert kept[a]
        assert kept[b - 1]
        assert max(distance_to_line(point, left) for point in line[a:b]) <= 1.5
    assert kept.sum() < 150


def test_bundles_hold_all_travels():
    nodes = np.array([[0.0, 0], [100, 2], [0, 1], [100, -1]])
    ground = bundle_edges(
        nodes, np.array([[0, 1], [2, 3]], np.int32), np.array([5.0, 2.0]), np.full(2, 100.0), 3.0
    )
    assert ground.density.max() == 7.0
