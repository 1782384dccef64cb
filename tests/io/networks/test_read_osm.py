import osmium
import pytest

from gpszip.errors import InputError
from gpszip.io.networks.read import read_network, read_network_result

PLACES = {
    1: (11.0, 48.0),
    2: (11.001, 48.0),
    3: (11.002, 48.0),
    4: (11.001, 48.001),
    5: (11.001, 47.999),
    6: (11.003, 48.0),
}
WAYS = {
    10: ([1, 2, 3], {"highway": "residential", "name": "Weg"}),
    11: ([4, 2, 5], {"highway": "primary", "oneway": "-1", "maxspeed": "60", "ref": "B 2"}),
    12: ([3, 6, 4, 3], {"highway": "tertiary", "junction": "roundabout"}),
    13: ([5, 6], {"highway": "motorway"}),
    14: ([1, 5], {"highway": "proposed"}),
    15: ([1, 4], {"building": "yes"}),
    16: ([6, 7], {"highway": "service"}),
    17: ([1, 7, 4, 5], {"highway": "service"}),
}


@pytest.fixture(params=[".osm", ".osm.pbf", ".osm.gz", ".osm.bz2"])
def extract(request, tmp_path):
    path = tmp_path / f"town{request.param}"
    with osmium.SimpleWriter(str(path)) as writer:
        for number, place in PLACES.items():
            writer.add_node(osmium.osm.mutable.Node(id=number, location=place))
        for number, (nodes, tags) in WAYS.items():
            writer.add_way(osmium.osm.mutable.Way(id=number, nodes=nodes, tags=tags))
    return path


def test_ways_become_roads(extract):
    read = read_network_result(extract)
    network = read.network
    roads = {}
    for i, name in enumerate(network.ids):
        roads.setdefault(name, []).append(
            (
                bool(network.forward[i]),
                bool(network.backward[i]),
                round(float(network.speeds[i]) * 3.6),
            )
        )
    assert roads == {
        "10": [(True, True, 30)] * 2,
        "11": [(False, True, 51)] * 2,
        "12": [(True, False, 45)] * 3,
        "13": [(True, False, 100)],
        "17": [(True, True, 15)],
    }
    assert {(one, name) for one, name in zip(network.ids, network.names, strict=True) if name} == {
        ("10", "Weg"),
        ("11", "B 2"),
    }
    counts = {repair.what: repair.count for repair in read.repairs}
    assert counts["roads cut where the extract ends"] == 1
    assert counts["ways that are no roads (areas, planned, gone) dropped"] == 1


JOSM_FILE = """<?xml version='1.0' encoding='UTF-8'?>
<osm version='0.6' upload='false' generator='JOSM'>
  <node id='-101' action='modify' visible='true' lat='48.0' lon='11.0' />
  <node id='-102' action='modify' visible='true' lat='48.0' lon='11.001' />
  <node id='7' version='3' visible='true' lat='48.001' lon='11.001' />
  <node id='-103' action='modify' visible='true' lat='48.0' lon='11.003' />
  <way id='-104' action='modify' visible='true'>
    <nd ref='-101' /><nd ref='-102' /><nd ref='7' />
    <tag k='highway' v='residential' />
  </way>
  <way id='9' version='2' visible='true'>
    <nd ref='-102' /><nd ref='-103' /><nd ref='-999' />
    <tag k='highway' v='service' /><tag k='oneway' v='yes' />
  </way>
</osm>
"""


def test_objects_that_an_editor_has_not_uploaded(tmp_path):
    (tmp_path / "drawn.osm").write_text(JOSM_FILE)
    read = read_network_result(tmp_path / "drawn.osm")
    assert list(read.network.ids) == ["-104", "-104", "9"]
    assert read.network.backward.tolist() == [True, True, False]
    assert len(read.network.nodes) == 4  # the ways share one
    counts = {repair.what: repair.count for repair in read.repairs}
    assert counts["roads cut where the extract ends"] == 1


def test_a_file_without_roads(tmp_path):
    path = tmp_path / "none.osm"
    with osmium.SimpleWriter(str(path)) as writer:
        writer.add_node(osmium.osm.mutable.Node(id=1, location=(11, 48)))
    with pytest.raises(InputError, match="no way with the tag"):
        read_network(path)


def test_an_incomplete_file_is_refused(extract, tmp_path):
    path = tmp_path / f"log_with_gap{''.join(extract.suffixes)}"
    path.write_bytes(extract.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"can't be read|damaged"):
        read_network(path)
