"""A damaged GeoJSON file gives a consistent log, or an InputError in one line."""

import json

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.geojson.read import read_geojson
from gpszip.io.logs.raw import Request
from gpszip.io.storage.source import Source
from random_tests import examples

LINE = {"type": "LineString", "coordinates": [[8, 50, 300], [8.1, 50.1, 301], [8.2, 50.2]]}
SEVERAL = {"type": "MultiLineString", "coordinates": [[[8, 50]], [[8.1, 50.1], [8.2, 50.2]]]}
FEATURES = [
    {"type": "Feature", "id": 7, "properties": {"coordTimes": [0, 1.5, "2"]}, "geometry": LINE},
    {
        "type": "Feature",
        "properties": {"times": ["2024-05-04T08:00:00Z"] * 3, "name": "a"},
        "geometry": LINE,
    },
    {
        "type": "Feature",
        "properties": {"times": [[0], [1, 2]], "track_id": "b"},
        "geometry": SEVERAL,
    },
    {"type": "Feature", "properties": {"time": "2024-05-04", "id": "c"}, "geometry": SEVERAL},
    {
        "type": "Feature",
        "properties": None,
        "geometry": {"type": "GeometryCollection", "geometries": [LINE, SEVERAL]},
    },
    {
        "type": "Feature",
        "properties": {"time": 5, "vehicle": "d"},
        "geometry": {"type": "Point", "coordinates": [8, 50, 1]},
    },
    {
        "type": "Feature",
        "properties": {"times": [5]},
        "geometry": {"type": "Point", "coordinates": [8, 50]},
    },
]

ODD = st.sampled_from(
    [
        None,
        True,
        0,
        -1,
        1e308,
        10**400,
        "",
        "x",
        "\ud800",
        "NaN",
        "2024-02-31",
        "LineString",
        "Point",
        "GeometryCollection",
    ]
) | (
    st.sampled_from(
        [[], [[]], [None], {}, {"a": 1}, [8, 50], [[8, 50], [8, 51]], LINE, FEATURES[0]]
    )
)
TEXTS = st.sampled_from(
    [
        "NaN",
        "Infinity",
        "9" * 5000,
        "1e999",
        "[" * 2000,
        "\x1e",
        "\ufeff",
        "{",
        "]",
        ",",
        '"',
        "\\ud800",
        "\0",
        "null",
        "1.",
    ]
)

REQUESTS = st.builds(
    Request,
    columns=st.sampled_from([None, {"t": "time"}, {"t": "times", "id": "name"}, ("a", "b")]),
    time_unit=st.sampled_from([None, "ms"]),
    keep=st.sampled_from([(), ("alt",), ("vehicle",)]),
    heading=st.booleans(),
    skip_bad=st.booleans(),
)


def places(value, above=()):
    """All places in a document, as the keys that lead there."""
    yield above
    items = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, item in items:
        yield from places(item, (*above, key))


@st.composite
def documents(draw):
    """A collection in which some values are replaced, left out, doubled or renamed."""
    document = {
        "type": "FeatureCollection",
        "features": draw(st.lists(st.sampled_from(FEATURES), max_size=4)),
    }
    document = json.loads(json.dumps(document))
    for _ in range(draw(st.integers(0, 4))):
        inner = list(places(document))[1:]
        if not inner:
            break
        where = draw(st.sampled_from(inner))
        holder = document
        for key in where[:-1]:
            holder = holder[key]
        change = draw(st.sampled_from(["replace", "remove", "double", "rename"]))
        if change == "replace":
            holder[where[-1]] = json.loads(json.dumps(draw(ODD)))
        elif change == "remove":
            del holder[where[-1]]
        elif isinstance(holder, list):
            holder.insert(where[-1], holder[where[-1]])
        else:
            holder[
                draw(
                    st.sampled_from(["type", "times", "time", "coordinates", "id", "crs", "gpszip"])
                )
            ] = holder[where[-1]]
    return json.dumps(document, ensure_ascii=draw(st.booleans()))


@st.composite
def texts(draw):
    """The text of a document in which some letters are left out or put in."""
    text = draw(documents())
    for _ in range(draw(st.integers(0, 2))):
        first = draw(st.integers(0, len(text)))
        text = (
            text[:first] + draw(TEXTS) + text[draw(st.integers(first, min(len(text), first + 3))) :]
        )
    return text


def check(data, request):
    """Read it; a log that comes out has all of its parts in order."""
    try:
        log = read_geojson(Source("log", data=data), request)
    except InputError as error:
        assert "\n" not in str(error)
        return
    rows = len(log.times)
    assert rows > 0
    assert log.coordinates.shape[0] == rows
    assert np.isfinite(log.coordinates[:, :2]).all()
    assert all(len(values) == rows for values in log.attributes.values())
    codes = np.zeros(rows, int) if log.codes is None else log.codes
    assert set(codes.tolist()) == set(range(max(len(log.ids), 1)))
    assert not np.isfinite(log.times[np.isin(codes, list(log.untimed))]).any()
    assert all(0 <= unread.row < rows for unread in log.unreadable)
    for text in (
        *log.ids,
        *(left.name + left.reason for left in log.left_out),
        *(repair.value for repair in log.repairs),
    ):
        text.encode()


@examples(150)
@given(text=texts(), request=REQUESTS)
@example(
    text='{"type":"Point","coordinates":[8,50],"properties":{"time":' + "9" * 4000 + "}}",
    request=Request(),
)
def test_no_change_of_a_document_breaks_the_reader(text, request):
    check(text.encode("utf-8", "surrogatepass"), request)


@examples(80)
@given(
    text=documents(),
    changes=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=4),
    cut=st.integers(0, 10**6),
)
def test_no_change_of_a_byte_breaks_the_reader(text, changes, cut):
    data = bytearray(text.encode("utf-8", "surrogatepass"))
    for place, byte in changes:
        data[place % len(data)] = byte
    data = bytes(data[: cut % (2 * len(data)) + 1])
    check(data, Request())
    try:
        format_for_reading(Source("log", data=data))
    except InputError as error:
        assert "\n" not in str(error)
