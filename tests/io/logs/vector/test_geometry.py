import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.vector.geometry import geometry_kinds, parse_lines, parse_points
from oracle.geometries import line, lines, point, read_point

numbers = st.floats(allow_nan=False, allow_infinity=False, width=32)


@st.composite
def points(draw):
    axes = draw(st.sampled_from(["", "z", "m", "zm"]))
    style = draw(st.sampled_from(["iso", "flags"]))
    values = draw(st.lists(numbers, min_size=2 + len(axes), max_size=2 + len(axes)))
    srid = draw(st.sampled_from([None, 4326])) if style == "flags" else None
    data = point(
        values,
        order=draw(st.sampled_from("<>")),
        axes=axes,
        style=style,
        srid=srid,
        kind=draw(st.sampled_from([1, 4])),
    )
    return data[: len(data) - draw(st.sampled_from([0, 0, 0, 1, 9, 20]))]


@given(st.lists(st.one_of(points(), st.none(), st.binary(max_size=40)), max_size=12))
def test_points_of_any_type_are_read_as_the_twin_reads_them(cells):
    array = pa.array([None, *cells], pa.binary())[1:]
    parsed = parse_points(array)
    expected = np.array([read_point(cell) for cell in cells]).reshape(-1, 4)
    np.testing.assert_array_equal(parsed.table, expected)


def test_native_points_have_the_numbers_that_they_name():
    struct = pa.array([{"x": 1.0, "y": 2.0, "m": 5.0}, None])
    assert parse_points(struct).table[0, [0, 1, 3]].tolist() == [1, 2, 5]
    assert parse_points(struct).is_point.tolist() == [True, False]
    pairs = pa.array([[1.0, 2.0, 3.0], None, [4.0, 5.0, 6.0]], pa.list_(pa.float64(), 3))
    assert parse_points(pairs).table[[0, 2], :3].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert np.isnan(parse_points(pairs).table[1]).all()


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("style", ["iso", "flags"])
def test_lines_have_their_m(order, style):
    data = line([(1, 2, 3, 4), (5, 6, 7, 8)], order=order, axes="zm", style=style)
    [table] = parse_lines(pa.scalar(data), "a", "row 1")
    assert table.tolist() == [[1, 2, 3, 4], [5, 6, 7, 8]]


def test_members_of_a_multilinestring_are_lines():
    data = lines([line([(1, 2, 9), (3, 4, 10)], axes="m"), line([(5, 6), (7, 8)])])
    first, second = parse_lines(pa.scalar(data), "a", "row 1")
    assert first[:, 3].tolist() == [9, 10]
    assert np.isnan(second[:, 3]).all()


def test_native_lines_are_read():
    kind = pa.list_(pa.struct([("x", pa.float64()), ("y", pa.float64())]))
    [table] = parse_lines(pa.scalar([{"x": 1.0, "y": 2.0}, {"x": 3.0, "y": 4.0}], kind), "a", "")
    assert table[:, :2].tolist() == [[1, 2], [3, 4]]


@given(st.integers(1, 60))
def test_a_line_that_is_cut_short_is_refused(length):
    data = lines([line([(1, 2), (3, 4)])])
    assert len(data) == 50
    if length >= len(data):
        return
    with pytest.raises(InputError, match=r"a\.gpkg: row 7: its geometry is cut short"):
        parse_lines(pa.scalar(data[:length]), "a.gpkg", "row 7")


def test_kinds_are_those_of_the_file():
    cells = [point((1, 2)), None, line([(1, 2), (3, 4)], axes="m"), point((1, 2, 3), axes="z")]
    assert geometry_kinds(pa.array(cells)) == ["Point", "LineString"]
    assert geometry_kinds(pa.array([None, None], pa.binary())) == []
