import numpy as np
import pyarrow as pa
import pytest

from gpszip.io.logs.raw import Request
from gpszip.io.logs.xml.facts import find_facts
from gpszip.io.logs.xml.log_points import LogPoints
from gpszip.io.storage.source import Source


def points(lat, hr=None, parents=(0,), starts=(0,), *, continues=False):
    """Points of one nameless track without times."""
    texts = pa.chunked_array([lat])
    fields = {} if hr is None else {"hr": pa.chunked_array([pa.array(hr, pa.string())])}
    return LogPoints(
        lat=texts,
        lon=texts,
        fields=fields,
        present={"hr": "hr"},
        names=(None,),
        plans=np.zeros(1, np.bool_),
        parents=np.array(parents),
        starts=np.array(starts),
        continues=continues,
    )


def facts(*batches, **request):
    return find_facts(batches, Source("walk.gpx", data=b""), Request(**request))


@pytest.mark.parametrize(
    ("batches", "comma"),
    [
        ((["48,1"], ["48,2"]), True),
        ((["48"], ["48,2"]), True),
        ((["48,1"], ["48.2"]), False),
        ((["48.1"], ["48,2"]), False),
        ((["48"] * 200 + ["48.5"], ["48,2"]), False),
        ((["48"],), False),
    ],
)
def test_decimal_commas_are_those_of_the_whole_file(batches, comma):
    assert facts(*map(points, batches)).decimal_comma == comma


@pytest.mark.parametrize(
    ("batches", "is_number"),
    [
        ((["60"], ["61.5"]), True),
        ((["60"], [None]), True),
        ((["NaN"], ["61"]), True),
        ((["60"], ["high"]), False),
        ((["high"], ["60"]), False),
    ],
)
def test_a_column_is_numbers_only_if_all_batches_have_numbers(batches, is_number):
    found = facts(*(points(["48.1"] * len(hr), hr) for hr in batches), keep=("hr",))
    assert ("hr" in found.numbers) == is_number


def test_a_decimal_comma_of_coordinates_holds_for_columns():
    assert facts(points(["48,1"], ["3,5"]), keep=("hr",)).numbers == {"hr"}
    assert facts(points(["48.1"], ["3,5"]), keep=("hr",)).numbers == frozenset()


def test_a_segment_that_goes_on_in_the_next_batch_is_one_shape():
    first = points(["48.1"] * 3, parents=(0, 0), starts=(0, 2))
    second = points(["48.1"] * 3, parents=(0, 0), starts=(0, 1), continues=True)
    found = facts(first, second)
    assert found.ids == ("walk", "walk-2", "walk-3")
    assert found.codes.tolist() == [0, 1, 2]
    assert found.is_shape.all()
