import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.formats import format_for_reading
from gpszip.io.logs.npz import read_npz
from gpszip.io.logs.raw import Request
from gpszip.io.logs.read import read_logs
from gpszip.io.storage.source import Source

T = np.arange(5.0)
POSITIONS = np.column_stack([T * 3, T * 4, T])


def packed(save=np.savez, **arrays):
    file = io.BytesIO()
    save(file, **arrays)
    return file.getvalue()


def single(array):
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def raw(data, **request):
    return read_npz(Source("log.npz", data=data), Request(**request))


@given(
    st.sampled_from(["<f8", ">f8", "<f4", "<i4", ">i2", "<f2", "<u1"]),
    st.sampled_from("CF"),
    st.sampled_from([np.savez, np.savez_compressed]),
    st.lists(st.tuples(*[st.integers(0, 100)] * 3), min_size=1, max_size=9),
)
def test_arrays_of_any_type_and_order_are_read(kind, order, save, rows):
    values = np.array(rows).astype(kind)
    log = raw(packed(save, t=values[:, 0], pos=np.asarray(values, order=order)))
    assert log.coordinates.tolist() == np.array(rows, float).tolist()
    assert log.times.tolist() == [row[0] for row in rows]


@pytest.mark.parametrize(
    ("arrays", "axes"),
    [
        ({"time": T, "xy": POSITIONS[:, :2]}, ("x", "y")),
        ({"time": T, "positions": POSITIONS}, ("x", "y", "z")),
        ({"time": T, "latitude": T, "lng": T}, ("latitude", "lng")),
        ({"t": T, "position": POSITIONS}, ("position_x", "position_y", "position_z")),
    ],
)
def test_roles_are_found_by_names(arrays, axes):
    assert raw(packed(**arrays)).axes == axes


def test_columns_name_arrays_and_columns_of_arrays():
    states = np.column_stack([T, T + 1, T + 2, T + 3])
    data = packed(stamps=T, states=states)
    columns = {"t": "stamps", "x": "states_1", "y": "states_3"}
    log = raw(data, columns=columns, keep=("states_0",))
    assert log.coordinates.tolist() == states[:, [1, 3]].tolist()
    assert log.attributes["states_0"].tolist() == T.tolist()
    with pytest.raises(InputError, match="columns found: stamps, states_0, states_1"):
        raw(data)


def test_a_single_array_is_named_in_order_or_by_its_fields():
    data = single(np.column_stack([T, POSITIONS]))
    assert raw(data, columns=("t", "x", "y")).coordinates.tolist() == POSITIONS[:, :2].tolist()
    with pytest.raises(InputError, match=r"has 4 columns, but --columns names 5; it has: _0"):
        raw(data, columns=("t", "x", "y", "z", "a"))

    fields = np.zeros(5, [("t", "M8[ms]"), ("lat", "f8"), ("lon", "f8"), ("name", "U3")])
    fields["t"] = np.datetime64("2024-05-04") + np.arange(5)
    fields["name"] = ["a", "b", "a", "b", "ü"]
    log = raw(single(fields), keep=("name",))
    assert log.times.tolist() == [1714780800.0 + 86_400 * i for i in range(5)]
    assert log.attributes["name"].tolist() == ["a", "b", "a", "b", "ü"]


def test_arrays_of_other_lengths_are_refused_if_they_are_used():
    with pytest.raises(InputError, match=r"different lengths: 't' 5, 'x' 4"):
        raw(packed(t=T, x=T[1:], y=T))
    assert len(raw(packed(t=T, x=T, y=T, image=np.zeros((200, 200)), k=np.zeros(3))).times) == 5
    with pytest.raises(InputError, match="arrays without values"):
        raw(packed(t=T[:0], x=T[:0], y=T[:0]))
    with pytest.raises(InputError, match="no array of numbers"):
        raw(packed(a=np.zeros((2, 2, 2)), b=np.array(3)))


def test_objects_are_never_read():
    with pytest.raises(InputError, match="objects of Python"):
        raw(single(np.array([print, None], object)))
    data = packed(t=np.array([{}], object), x=T, y=T)
    with pytest.raises(InputError, match="array 't': an array that can't be read: it holds obj"):
        raw(data)


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-5,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -5), }",
        "{'descr': 'V0', 'fortran_order': False, 'shape': (10,), }",
        "__import__('os').abort()",
        "(" * 5000,
    ],
)
def test_headers_that_lie_are_refused(header):
    text = header.encode().ljust(117) + b"\n"
    data = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(40)
    with pytest.raises(InputError, match="an array that can't be read") as caught:
        raw(data)
    assert caught.value.location is None


def test_lengths_that_no_array_has_are_refused_beside_a_length_of_0():
    for shape in ((-1, 0), (10**30, 0), (1 << 62, 4, 0)):
        header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
        data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
        with pytest.raises(InputError, match="its header says a shape that no array has"):
            raw(data)


def test_archives_of_arrays_are_not_unpacked_as_logs():
    data = packed(t=T, x=T, y=T)
    assert format_for_reading(Source("a.zip", data=data)).name == "npz"
    assert len(read_logs(io.BytesIO(data)).tracks[0]) == 5
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("walk.csv", "t,x,y\n0,0,0\n1,1,1\n")
    assert len(read_logs(io.BytesIO(file.getvalue())).tracks[0]) == 2


def test_damaged_archives_are_refused():
    data = packed(np.savez_compressed, t=T, x=T, y=T)
    for damaged in (data[:-30], data[:60] + bytes(20) + data[80:]):
        with pytest.raises(InputError):
            raw(damaged)
