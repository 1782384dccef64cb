"""Maps written as OpenStreetMap XML come back as networks."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.geo.planes import to_plane
from gpszip.io.maps.write import write_map
from gpszip.io.networks.read import read_road_graph
from gpszip.model import CleanMap, Plane, RoadMap
from random_tests import examples

#: Metres between places, far more than the centimetre to which a file is exact.
STEP = 10.0

PLACE = st.tuples(st.integers(-30, 30), st.integers(-30, 30))
PLANES = st.sampled_from(
    [Plane(((525000000, 134000000),)), Plane(((-335000000, -706000000),)), Plane(((0, 0),))]
)
COUNTS = st.tuples(st.integers(0, 5), st.integers(0, 5)).filter(any)


@st.composite
def road_maps(draw):
    places = draw(st.lists(PLACE, min_size=2, max_size=30, unique=True))
    node = st.integers(0, len(places) - 1)
    pairs = draw(
        st.lists(
            st.tuples(node, node).filter(lambda pair: pair[0] < pair[1]),
            min_size=1,
            max_size=12,
            unique=True,
        )
    )
    counts = draw(st.lists(COUNTS, min_size=len(pairs), max_size=len(pairs)))
    forward, backward = np.array(counts).T
    return RoadMap(
        STEP * np.array(places), np.array(sorted(pairs), np.int32), forward, backward, draw(PLANES)
    )


@st.composite
def clean_maps(draw):
    """Curved edges, among them parallel ones and rings; no two share a place inside them."""
    count = draw(st.integers(1, 8))
    sizes = draw(st.lists(st.integers(2, 5), min_size=count, max_size=count))
    places = draw(st.lists(PLACE, min_size=3 + sum(sizes), max_size=45, unique=True))
    junctions, rest = STEP * np.array(places[:3]), STEP * np.array(places[3:])
    junction = st.integers(0, 2)
    ends = draw(st.lists(st.tuples(junction, junction), min_size=count, max_size=count))
    lines, taken = [], 0
    for (u, v), size in zip(ends, sizes, strict=True):
        inner = rest[taken : taken + size]
        lines.append(np.concatenate([junctions[[u]], inner, junctions[[v]]]))
        taken += size
    counts = draw(st.lists(COUNTS, min_size=count, max_size=count))
    unknown = np.full(count, np.nan)
    return CleanMap(
        junctions=junctions,
        ends=np.array(ends, np.int32),
        offsets=np.append(0, np.cumsum([len(line) for line in lines])),
        points=np.concatenate(lines),
        length=unknown,
        forward=np.array(counts)[:, 0],
        backward=np.array(counts)[:, 1],
        speed=np.full((count, 3), np.nan),
        hourly=np.zeros((count, 0)),
        width=unknown,
        plane=draw(PLANES),
    )


def places_of(points):
    """Places on the grid; each position is within two centimetres of one."""
    places = np.rint(points / STEP).astype(int)
    assert np.abs(points - STEP * places).max() < 0.02
    return tuple(map(tuple, places.tolist()))


def travelled_lines(road_map, line_of):
    """The line of each direction that was travelled, from its start to its end."""
    directed = road_map.directed()
    return sorted(
        places_of(line_of(edge)[:: 1 if forward else -1])
        for edge, forward in zip(directed.edges, directed.forward, strict=True)
    )


def lines_read(path, plane):
    graph = read_road_graph(path)
    lon, lat = graph.coordinates.T
    points = to_plane(lat, lon, plane)
    lines = []
    for road, (start, stop) in enumerate(zip(graph.offsets[:-1], graph.offsets[1:], strict=True)):
        line = places_of(points[start:stop])
        lines += [line] * bool(graph.forward[road]) + [line[::-1]] * bool(graph.backward[road])
    return sorted(lines)


@examples(60)
@given(road_maps())
def test_nodes_and_directions_of_a_road_map_come_back(tmp_path_factory, road_map):
    path = tmp_path_factory.mktemp("osm") / "map.osm"
    write_map(road_map, path)
    assert lines_read(path, road_map.plane) == travelled_lines(
        road_map, lambda edge: road_map.nodes[road_map.edges[edge]]
    )


@examples(60)
@given(clean_maps())
def test_lines_and_directions_of_a_clean_map_come_back(tmp_path_factory, clean_map):
    path = tmp_path_factory.mktemp("osm") / "map.osm"
    write_map(clean_map, path)
    assert lines_read(path, clean_map.plane) == travelled_lines(clean_map, clean_map.__getitem__)
