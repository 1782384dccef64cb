"""Events, their ids and their lines."""

import json
import math

from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from gpszip.cli.schemas import EVENT
from gpszip.live.events import KINDS, Event, event_id, standing
from random_tests import examples

numbers = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e9, max_value=1e9)

events = st.builds(
    Event,
    kind=st.sampled_from(sorted(KINDS)),
    id=st.text("0123456789abcdef", min_size=16, max_size=16),
    agent=st.text(max_size=20),
    time=numbers,
    received=numbers,
    seq=st.integers(0, 1 << 40),
    revises=st.none() | st.text("0123456789abcdef", min_size=16, max_size=16),
    withdrawn=st.booleans(),
    edge=st.none() | st.integers(0, 1000),
    forward=st.booleans(),
    position=st.none() | st.tuples(numbers, numbers, numbers),
    geographic=st.just(False),
    confidence=st.none() | st.floats(0, 1),
    why=st.text(max_size=20),
    details=st.dictionaries(st.text(max_size=5), st.floats() | st.text(max_size=5), max_size=3),
)


@examples(30)
@given(event=events)
def test_a_line_has_the_form_of_the_schema_and_can_be_read_again(event):
    line = event.to_json()
    assert line.isascii()
    assert line.isprintable()
    Draft202012Validator(EVENT).validate(json.loads(line))
    again = Event.from_json(line)
    assert (again.kind, again.id, again.agent) == (event.kind, event.id, event.agent)
    assert (again.revises, again.withdrawn, again.seq) == (
        event.revises,
        event.withdrawn,
        event.seq,
    )
    assert math.isclose(again.time, event.time, abs_tol=6e-4)
    assert again.to_json() == line


def test_ids_depend_on_each_fact_and_where_it_ends():
    ids = {
        event_id("a", "bc"),
        event_id("ab", "c"),
        event_id("a", "b", "c"),
        event_id("a", "bc", None),
        event_id("a", "bc", 1.0),
    }
    assert len(ids) == 5
    assert event_id("\ud800") != event_id("?")
    assert event_id("a", 7.0001) == event_id("a", 7.0)


def test_what_stands_is_neither_revised_nor_withdrawn():
    first = Event("stay.start", "1", "bus", 7.0, 9.0)
    other = Event("stay.start", "2", "ann", 3.0, 9.0)
    moved = Event("stay.start", "3", "bus", 8.0, 10.0, revises="1")
    gone = Event("stay.start", "4", "bus", 8.0, 11.0, revises="3", withdrawn=True)
    assert standing([first, other]) == [other, first]
    assert standing([first, other, moved]) == [other, moved]
    assert standing([first, other, moved, gone]) == [other]
