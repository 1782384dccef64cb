"""Roads from tables: GeoParquet and CSV."""

import struct

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.networks.read import read_network


def wkb(*points):
    return struct.pack("<BII", 1, 2, len(points)) + np.array(points, "<f8").tobytes()


LINES = [wkb((11, 48), (11.01, 48)), wkb((11.01, 48), (11.01, 48.01))]
GEO = '{"primary_column": "way", "columns": {"way": {"encoding": "WKB"%s}}}'


def parquet(path, columns, metadata=GEO % ""):
    table = pa.table(columns)
    pq.write_table(table.replace_schema_metadata({"geo": metadata} if metadata else None), path)
    return path


def test_geoparquet_has_directions_and_names(tmp_path):
    columns = {"way": LINES, "oneway": ["yes", "no"], "name": ["High Street", None]}
    network = read_network(parquet(tmp_path / "roads.parquet", columns))
    assert (len(network.nodes), len(network.starts)) == (3, 2)
    assert network.plane is not None
    assert network.names[0] == "High Street"
    assert network.forward.tolist() == [True, True]
    assert network.backward.tolist() == [False, True]


@pytest.mark.parametrize(
    ("columns", "metadata", "message"),
    [
        ({"name": ["a"]}, "", "a table without a column of geometries"),
        ({"way": [b"\x01"]}, GEO % "", "roads.parquet: "),
        ({"way": [struct.pack("<BIdd", 1, 1, 11, 48)]}, GEO % "", "no line that can be read"),
        ({"way": LINES}, GEO.replace("WKB", "polygon") % "", "holds geometries as polygon"),
        ({"way": LINES}, GEO % ', "crs": "EPSG:1"', "unknown coordinate system"),
        # Headers that say more or fewer vertices than follow.
        ({"way": [struct.pack("<BII", 1, 2, 2**32 - 1)]}, GEO % "", "can't be read"),
        ({"way": [struct.pack("<BII4d", 1, 2, n, 1, 2, 3, 4) for n in (3, 1)]}, GEO % "", "buffer"),
    ],
)
def test_other_parquet_files_are_refused(tmp_path, columns, metadata, message):
    with pytest.raises(InputError) as raised:
        read_network(parquet(tmp_path / "roads.parquet", columns, metadata))
    assert message in str(raised.value)


def test_a_damaged_parquet_file_is_refused(tmp_path):
    path = parquet(tmp_path / "roads.parquet", {"way": LINES})
    path.write_bytes(path.read_bytes()[:-40] + bytes(40))
    with pytest.raises(InputError, match="can't be read as lines"):
        read_network(path)


def test_csv_of_well_known_text(tmp_path):
    text = (
        'name,WKT,oneway\nHigh Street,"LINESTRING (11 48, 11.01 48)",yes\n'
        ',"MULTILINESTRING ((11.01 48, 11.01 48.01))",\n,,\n,POINT (11 48),\n'
    )
    (tmp_path / "roads.csv").write_text(text)
    network = read_network(tmp_path / "roads.csv")
    assert len(network.starts) == 2
    assert network.backward.tolist() == [False, True]


def test_a_line_of_csv_may_be_longer_than_a_block_of_arrow(tmp_path):
    vertices = ", ".join(f"{i} {i}" for i in range(100_000))
    (tmp_path / "roads.csv").write_text(f'line\n"LINESTRING ({vertices})"\n')
    network = read_network(tmp_path / "roads.csv")
    assert len(network.starts) == 1


def test_columns_of_one_name_are_refused_if_they_are_used(tmp_path):
    (tmp_path / "roads.csv").write_text("u_x,u_x,u_y,v_x,v_y\n0,0,0,1,1\n")
    with pytest.raises(InputError, match="2 columns are named 'u_x'"):
        read_network(tmp_path / "roads.csv")
    (tmp_path / "roads.csv").write_text("note,note,u_x,u_y,v_x,v_y\na,b,0,0,1,1\n")
    assert len(read_network(tmp_path / "roads.csv").starts) == 1


def test_csv_of_ends(tmp_path):
    (tmp_path / "roads.csv").write_text("u_x,u_y,v_x,v_y\n0,0,3,4\n3,4,3,9\n,,1,1\n")
    network = read_network(tmp_path / "roads.csv")
    assert (len(network.nodes), len(network.starts), network.plane) == (3, 2, None)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("t,lat,lon\n0,48,11\n", UnknownFormatError, "no network"),
        ("u_x,u_y,v_x,v_y\n0,0,a,4\n", InputError, "can't be read as lines"),
        ("u_x,u_y,v_x,v_y\n0,0,1\n", InputError, "can't be read as lines"),
        ("wkt\nPOINT (1 2)\n", InputError, "no line that can be read"),
    ],
)
def test_other_csv_files_are_refused(tmp_path, text, error, message):
    (tmp_path / "roads.csv").write_text(text)
    with pytest.raises(error) as raised:
        read_network(tmp_path / "roads.csv")
    assert message in str(raised.value)
