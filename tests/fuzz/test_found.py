"""Files that fuzzing found: they were read wrongly, or refused as if the program had a fault."""

import contextlib
import io
import struct
import zlib

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fuzz.targets import ROADS_GEOJSON, ROADS_GRAPHML, ROADS_OSM, TARGETS
from gpszip.cli.times import parse_times
from gpszip.errors import CorruptArchiveError, InputError, OptionError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.read import read_logs
from gpszip.io.maps.write import write_map
from gpszip.io.networks.read import read_network
from gpszip.model import RoadMap


def _parquet(**columns):
    out = io.BytesIO()
    pq.write_table(
        pa.table({"t": [0.0, 1.0], "x": [0.0, 1.0], "y": [0.0, 1.0], **columns}),
        out,
        compression="none",
    )
    return out.getvalue()


@pytest.mark.parametrize(
    ("word", "torn"),
    [(b"walk", b"wal\xff"), (b"vehicle", b"vehicl\xff")],
    ids=["value", "column"],
)
def test_parquet_with_texts_that_are_no_utf8(tmp_path, word, torn):
    data = _parquet(vehicle=["walk", "walk"]).replace(word, torn)
    (tmp_path / "log.parquet").write_bytes(data)
    with pytest.raises(InputError, match="damaged Parquet file"):
        read_logs(tmp_path / "log.parquet")
    with pytest.raises(InputError, match=r"log.parquet: (damaged|can't be read): "):
        store_logs(str(tmp_path / "log.parquet"), rows=1000)


def test_parquet_with_lists_for_names():
    with pytest.raises(InputError, match=r"holds list<.*; name another one"):
        read_logs(io.BytesIO(_parquet(id=[["a"], ["b"]])))
    with pytest.raises(InputError, match=r"holds list<.*; name another one"):
        read_logs(io.BytesIO(_parquet(note=[["a"], ["b"]])), keep=["note"])


def test_roads_with_texts_that_are_no_utf8():
    data = ROADS_GEOJSON[0].encode().replace(b'"yes"', b'"y\xffs"')
    with pytest.raises(InputError, match="damaged JSON file: no UTF-8 after character"):
        read_network(io.BytesIO(data))


@pytest.mark.parametrize("encoding", ["UTF-48", "cp037", "utf-16"])
def test_graphml_of_unknown_encodings(encoding):
    data = ROADS_GRAPHML[0].replace("UTF-8", encoding).encode()
    with pytest.raises(InputError, match="damaged XML"):
        read_network(io.BytesIO(data))


def test_osm_with_a_blank_latitude(tmp_path):
    pytest.importorskip("osmium")
    path = tmp_path / "roads.osm"
    path.write_text(ROADS_OSM[0].replace('lat="48.1"', 'lat=" "'))
    with pytest.raises(InputError, match="can't be read as OpenStreetMap data"):
        read_network(path)


def _resealed(data, change):
    """Change the body of a prepared network of one block, and correct its checksums."""
    index = 48 + int.from_bytes(data[40:48], "little")
    body = bytearray(data[index + 68 :])
    change(body)
    front = data[: index + 24] + struct.pack("<I", zlib.crc32(body)) + data[index + 28 : index + 64]
    return front + struct.pack("<I", zlib.crc32(front)) + bytes(body)


@pytest.mark.parametrize("seed", [0, 1], ids=["degrees", "metres"])
def test_prepared_roads_without_a_valid_position(tmp_path, seed):
    data, path = TARGETS["roads prepared"].seeds()[seed], tmp_path / "roads.gpsz"
    no_position = np.array([2**31 - 1] * 2, "<i4") if seed == 0 else np.array([np.nan])

    def change(body):
        body[: no_position.nbytes] = no_position.tobytes()

    path.write_bytes(_resealed(data, lambda body: None))
    assert len(read_network(path))
    path.write_bytes(_resealed(data, change))
    with pytest.raises(CorruptArchiveError, match="no valid position or speed"):
        read_network(path)


def test_a_prepared_network_of_nothing(tmp_path):
    data, path = TARGETS["roads prepared"].seeds()[0], tmp_path / "roads.gpsz"
    index = 48 + int.from_bytes(data[40:48], "little")
    front = data[:32] + bytes(8) + data[40:index]
    path.write_bytes(front + struct.pack("<I", zlib.crc32(front)))
    with pytest.raises(InputError, match="holds no road"):
        read_network(path)


def test_a_map_in_metres_as_geopackage_is_a_network(tmp_path):
    road_map = RoadMap(
        np.array([[0.0, 0.0], [40.0, 30.0]]), np.array([[0, 1]]), np.array([3]), np.array([1])
    )
    write_map(road_map, tmp_path / "house.gpkg")
    network = read_network(tmp_path / "house.gpkg")
    assert network.plane is None
    assert network.lengths.tolist() == pytest.approx([50.0])


def test_times_longer_than_any_name():
    with pytest.raises(OptionError, match="is no time"):
        parse_times("5," * 3000 + "noon")


def test_text_of_broken_utf_16_is_read_or_refused():
    good = ('t,x,y\n"0",0,0\n' + "".join(f"{i},{i},{i}\n" for i in range(1, 30))).encode("utf-16")
    for i in range(8, 120, 2):
        with contextlib.suppress(InputError):
            read_logs(io.BytesIO(good[:i] + b"\x00\xd8" + good[i + 2 :]), format="csv")
    with pytest.raises(InputError, match="damaged text: not all of it is UTF-16"):
        read_logs(io.BytesIO(good[:100] + b"\x00\xd8" + good[102:]), format="csv")
