"""The table of map formats, and formats that other packages add."""

import numpy as np
import pytest

from gpszip.errors import OutputError
from gpszip.io.maps.write import map_suffixes, write_map
from gpszip.model import RoadMap

TOY_FORMAT = """
from gpszip.io.maps.write import MapFormat

def write(table, path):
    ends = zip(table.properties["u"].tolist(), table.properties["v"].tolist())
    path.write_text("".join(f"{u} -- {v}\\n" for u, v in ends))

FORMAT = MapFormat("toy", (".toy",), write)
"""


@pytest.fixture
def road_map():
    nodes = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 9.0]])
    edges = np.array([[0, 1], [1, 2]], np.int32)
    return RoadMap(nodes, edges, np.array([2, 1]), np.array([0, 1]))


@pytest.mark.parametrize(("name", "format"), [("map.toy", None), ("map.TOY", None), ("map", "toy")])
def test_a_format_of_another_package_is_written(install_plugin, tmp_path, road_map, name, format):
    with pytest.raises(OutputError):
        write_map(road_map, tmp_path / name, format=format)
    install_plugin("gpszip.map_formats", TOY_FORMAT)
    write_map(road_map, tmp_path / name, format=format)
    assert (tmp_path / name).read_text() == "0 -- 1\n1 -- 2\n"


def test_messages_name_the_formats_of_other_packages(install_plugin, tmp_path, road_map):
    install_plugin("gpszip.map_formats", TOY_FORMAT)
    assert map_suffixes()[-1] == ".toy"
    with pytest.raises(OutputError, match=r"end it with one of \.geojson, .*, \.pdf, \.toy"):
        write_map(road_map, tmp_path / "map.bmp")
    with pytest.raises(OutputError, match=r"no format 'bmp' for maps; there are geojson.* toy"):
        write_map(road_map, tmp_path / "map", format="bmp")
