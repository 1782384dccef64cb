"""The table of network formats, and formats that other packages add."""

import io

import pytest

from gpszip.errors import InputError, UnknownFormatError
from gpszip.io.networks.formats import describe_network_formats, find_network_format
from gpszip.io.networks.read import read_network

#: Roads of two vertices in metres, one a line: x1 y1 x2 y2.
TOY_FORMAT = """
import numpy as np
import pyarrow as pa
from gpszip.io.networks.formats import NetworkFormat
from gpszip.io.networks.lines import RoadLines

def read(source, metric):
    rows = np.loadtxt(source.read().decode().splitlines()[1:], ndmin=2)
    count = len(rows)
    both = np.ones(count, bool)
    return RoadLines(
        source.name, rows.reshape(-1, 2), 2 * np.arange(count + 1), False, both, both,
        np.full(count, np.nan), np.zeros(count, np.uint8),
        pa.array(map(str, range(count)), pa.string()), pa.nulls(count, pa.string()),
    )

FORMAT = NetworkFormat("Toy", (".toy",), lambda head, name: head.startswith(TOY_START), read)
"""


def toy_format(start):
    return f"TOY_START = {start!r}\n{TOY_FORMAT}"


# The second start would be refused as unknown XML, and the third be read as GeoJSON.
@pytest.mark.parametrize("start", [b"toy roads", b"<toy>", b'{"toy"'])
def test_a_format_of_another_package_is_asked_before_anything_is_refused(install_plugin, start):
    content = start + b"\n0 0 30 40\n30 40 30 50\n"
    with pytest.raises(InputError):
        read_network(io.BytesIO(content))
    install_plugin("gpszip.network_formats", toy_format(start))
    assert read_network(io.BytesIO(content)).lengths.tolist() == [50.0, 10.0]


def test_messages_name_the_formats_of_other_packages(install_plugin):
    install_plugin("gpszip.network_formats", toy_format(b"toy roads"))
    assert describe_network_formats().startswith("Toy, OpenStreetMap")
    with pytest.raises(UnknownFormatError, match="known are Toy, OpenStreetMap"):
        read_network(io.BytesIO(b"no roads"))


def test_a_plugin_that_is_no_format_is_named(install_plugin):
    install_plugin("gpszip.network_formats", "FORMAT = 7\n")
    with pytest.raises(InputError, match="plugin 'toy' of toy: is a int, not a NetworkFormat"):
        read_network(io.BytesIO(b"0 0 30 40\n"))


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (b'<?xml version="1.0"?>\n<osm version="0.6">', "OpenStreetMap (PBF, XML)"),
        (b"\0\0\0\r\n\tOSMHeader", "OpenStreetMap (PBF, XML)"),
        (b"\xef\xbb\xbf <graphml>", "GraphML"),
        (b' {"type": "FeatureCollection"}', "GeoJSON"),
        (b"SQLite format 3\0", "GeoPackage"),
        (b"fgb\x03", "FlatGeobuf"),
        (b"\0\0\x27\x0a", "Shapefile"),
    ],
)
def test_the_content_decides_on_the_format(tmp_path, content, name):
    from gpszip.io.storage.source import Source

    assert find_network_format(Source("roads", data=content)).name == name
