"""Wandering of standing receivers is taken out of routes; travel stays."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.history.turning import Legs, remove_wandering


def to_legs(rows: list[tuple[int, float, float]], pieces: list[int] | None = None) -> Legs:
    """Legs of one second each from edge, begin and end."""
    count = len(rows)
    edge, begin, end = map(np.array, zip(*rows, strict=True))
    times = np.arange(count + 1, dtype=np.float64)
    piece = np.array(pieces or [0] * count)
    return Legs(
        piece,
        piece.astype(np.int32),
        edge,
        end >= begin,
        times[:-1],
        times[1:],
        begin.astype(np.float64),
        end.astype(np.float64),
        np.full(count, 0.25),
    )


def to_rows(legs: Legs) -> list[tuple[int, float, float]]:
    columns = (legs.edge.tolist(), legs.begin.tolist(), legs.end.tolist())
    return list(zip(*columns, strict=True))


def test_travel_stays() -> None:
    # Over three edges, a dead end, and back.
    rows = [(0, 0, 90), (1, 40, 0), (2, 0, 60), (2, 60, 0), (1, 0, 40)]
    assert to_rows(remove_wandering(to_legs(rows), 10)) == rows


def test_a_look_into_a_side_street_is_none() -> None:
    legs = remove_wandering(to_legs([(0, 0, 90), (7, 0, 6), (7, 6, 0), (1, 40, 0)]), 10)
    assert to_rows(legs) == [(0, 0, 90), (1, 40, 0)]
    # Its time was spent at the node, before the next edge.
    assert legs.enter.tolist() == [0, 3]
    assert legs.leave.tolist() == [3, 4]
    assert legs.standing.tolist() == [0.75, 0.25]


def test_a_look_at_the_start_or_the_end_is_none() -> None:
    legs = remove_wandering(to_legs([(7, 0, 6), (7, 6, 0), (1, 40, 0)]), 10)
    assert to_rows(legs) == [(1, 40, 0)]
    assert legs.enter.tolist() == [0]
    legs = remove_wandering(to_legs([(1, 40, 0), (7, 0, 6), (7, 6, 0)]), 10)
    assert to_rows(legs) == [(1, 40, 0)]
    assert legs.leave.tolist() == [3]


def test_nested_looks_are_none() -> None:
    # A street, two edges aside and back, and on.
    rows = [(0, 0, 90), (7, 0, 3), (8, 0, 4), (8, 4, 0), (7, 3, 0), (0, 90, 200)]
    assert to_rows(remove_wandering(to_legs(rows), 10)) == [(0, 0, 200)]


def test_wandering_on_an_edge_is_one_leg() -> None:
    places = [0, 50, 46, 53, 48, 49, 44, 120]
    rows = [(3, a, b) for a, b in zip(places[:-1], places[1:], strict=True)]
    assert to_rows(remove_wandering(to_legs(rows), 10)) == [(3, 0, 120)]


def test_a_standing_agent_keeps_one_leg() -> None:
    legs = remove_wandering(to_legs([(3, 50, 52), (3, 52, 49), (3, 49, 50)]), 10)
    assert len(legs.edge) == 1
    assert (legs.enter[0], legs.leave[0]) == (0, 3)
    assert to_rows(remove_wandering(to_legs([(3, 5, 5)]), 10)) == [(3, 5, 5)]


def test_legs_without_a_length_join_others_of_their_piece() -> None:
    rows = [(0, 9, 9), (1, 0, 50), (2, 0, 0), (3, 0, 30), (4, 5, 5), (5, 8, 8)]
    legs = remove_wandering(to_legs(rows, [0, 0, 0, 0, 1, 2]), 10)
    assert to_rows(legs) == [(1, 0, 50), (3, 0, 30), (4, 5, 5), (5, 8, 8)]
    assert legs.piece.tolist() == [0, 0, 1, 2]
    assert legs.enter.tolist() == [0, 3, 4, 5]


@st.composite
def wanderings(draw: st.DrawFn) -> Legs:
    """Random walks of several agents on a star of edges of 100 m that meet at their starts."""
    rows, pieces = [], []
    for piece in range(draw(st.integers(1, 3))):
        edge, place = draw(st.integers(0, 2)), float(draw(st.integers(0, 100)))
        for _ in range(draw(st.integers(1, 12))):
            if place == 0:
                edge = draw(st.integers(0, 2))
            target = float(draw(st.sampled_from([0, 2, 5, 9, 30, 60, 100])))
            rows.append((edge, place, target))
            pieces.append(piece)
            place = target
    return to_legs(rows, pieces)


@given(wanderings())
def test_what_holds_for_any_walk(legs: Legs) -> None:
    clean = remove_wandering(legs, 10.0)

    # Time is neither lost nor made, and each piece keeps a leg.
    assert set(clean.piece) == set(legs.piece)
    assert np.isclose(clean.standing.sum(), legs.standing.sum())
    for piece in set(legs.piece.tolist()):
        mine, theirs = clean.piece == piece, legs.piece == piece
        assert clean.enter[mine][0] == legs.enter[theirs][0]
        assert clean.leave[mine][-1] == legs.leave[theirs][-1]
        assert (clean.enter[mine][1:] == clean.leave[mine][:-1]).all()

        # Legs go on from each other, on one edge or over the middle of the star.
        edge, begin, end = clean.edge[mine], clean.begin[mine], clean.end[mine]
        assert (end[:-1] == begin[1:]).all()
        assert ((edge[:-1] == edge[1:]) | (end[:-1] == 0)).all()

    # Directions are told, no traversal is longer than the edge, and nothing is left to take out.
    assert ((clean.end >= clean.begin) | ~clean.forward).all()
    assert ((clean.end <= clean.begin) | clean.forward).all()
    again = remove_wandering(clean, 10.0)
    assert to_rows(again) == to_rows(clean)


@given(wanderings())
def test_large_turns_stay(legs: Legs) -> None:
    # The farthest place of each piece on each edge stays within the tolerance.
    clean = remove_wandering(legs, 10.0)
    for piece in set(legs.piece.tolist()):
        for edge in range(3):
            far = [
                max(b, e)
                for p, g, b, e in zip(legs.piece, legs.edge, legs.begin, legs.end, strict=True)
                if (p, g) == (piece, edge)
            ]
            kept = [
                max(b, e)
                for p, g, b, e in zip(clean.piece, clean.edge, clean.begin, clean.end, strict=True)
                if (p, g) == (piece, edge)
            ]
            if far and max(far) > 10:
                assert kept
                assert max(kept) >= max(far) - 10


def test_a_log_without_legs_stays_empty():
    none = np.zeros(0)
    whole = none.astype(np.int64)
    legs = Legs(whole, whole.astype(np.int32), whole, none > 0, none, none, none, none, none)
    assert len(remove_wandering(legs, 5.0).edge) == 0
