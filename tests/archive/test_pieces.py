import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.archive.pieces import pieces_by_track, plain_names
from gpszip.model import Walk

IDS = st.lists(st.text("a/01", max_size=4), unique=True, max_size=8)


def walks_of(ids, torn):
    nodes, times = np.arange(4, dtype=np.int32), np.arange(4.0)
    return [
        Walk(id, nodes, times, np.array([tear, False, tear]))
        for id, tear in zip(ids, torn, strict=False)
    ]


@given(IDS, st.lists(st.booleans(), min_size=8, max_size=8))
def test_no_two_pieces_have_one_name(ids, torn):
    walks = walks_of(ids, torn)
    found = pieces_by_track(walks)
    names = [name for pieces in found.values() for name, _ in pieces]
    assert len(set(names)) == len(names)
    for walk in walks:
        pieces = found[walk.id]
        if not walk.gaps.any():
            assert pieces == [(walk.id, slice(0, 4))]
            continue
        assert [knots for _, knots in pieces] == [slice(0, 1), slice(1, 3), slice(3, 4)]
        stems = {name.removesuffix(str(i)).rstrip("/") for i, (name, _) in enumerate(pieces)}
        assert stems == {walk.id.rstrip("/")}


def test_names_are_the_plain_ones_where_nothing_else_is_called_so():
    found = pieces_by_track(walks_of(["a", "b", "a/"], [True, False, True]))
    assert [[name for name, _ in pieces] for pieces in found.values()] == [
        ["a/0", "a/1", "a/2"],
        ["b"],
        ["a//0", "a//1", "a//2"],
    ]


@given(IDS, st.lists(st.booleans(), min_size=8, max_size=8))
def test_names_given_to_one_track_alone_are_those_among_all(ids, torn):
    walks = walks_of(ids, torn)
    for id, pieces in pieces_by_track(walks).items():
        alone = plain_names(id, len(pieces), set(ids))
        assert alone is None or alone == [name for name, _ in pieces]
