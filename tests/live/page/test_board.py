"""What a page shows: the newest state within bounds."""

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.live import Marks
from gpszip.live.page import board as module
from gpszip.live.page.board import TAIL_SECONDS, Board
from live.page.running import TIME, event, fix


def send(board, *events):
    asyncio.run(board.send(events))


@given(
    st.lists(st.lists(st.sampled_from("abcdef"), max_size=8), max_size=12),
    st.integers(1, 4),
)
def test_a_slow_reader_gets_the_newest_state_of_all(batches, count):
    board, cursor, seen, newest = Board(), 0, {}, {}
    for t, batch in enumerate(batches):
        board.take([fix(agent, t) for agent in batch])
        newest |= dict.fromkeys(batch, TIME + t)
        agents, cursor = board.agents_since(cursor, count)
        assert len(agents) <= count
        seen |= {agent.fix.agent: agent.fix.time for agent in agents}
    while cursor != board.revision:
        agents, cursor = board.agents_since(cursor, count)
        seen |= {agent.fix.agent: agent.fix.time for agent in agents}
    assert seen == newest


def test_the_agent_that_was_heard_of_least_recently_is_forgotten(monkeypatch):
    monkeypatch.setattr(module, "_MAX_AGENTS", 3)
    board = Board()
    for agent in "abcad":
        board.take([fix(agent)])
    assert [agent.fix.agent for agent in board.recent_agents(9)] == ["d", "a", "c"]
    assert len(board) == 3


def test_tails_are_thinned_and_end():
    board = Board()
    board.take([fix("ann", t, (48 + t / 1e5, 11.5)) for t in range(3000)])
    (ann,) = board.recent_agents(1)
    times = ann.tail[::3]
    assert times[-1] == TIME + 2999
    assert TAIL_SECONDS - 20 <= times[-1] - times[0] <= TAIL_SECONDS
    assert len(times) <= 100
    assert list(ann.tail[-3:]) == [TIME + 2999, 48.02999, 11.5]


def test_what_comes_late_moves_nobody_and_a_break_begins_a_tail():
    board = Board()
    board.take([fix("ann", 0), fix("ann", 60), fix("ann", 30)])
    (ann,) = board.recent_agents(1)
    assert (ann.fix.time, len(ann.tail)) == (TIME + 60, 6)
    board.take([fix("ann", 90, quality=Marks.BREAK)])
    assert (ann.fix.time, len(ann.tail)) == (TIME + 90, 3)


def test_a_clock_of_its_own_may_begin_anew():
    board = Board()
    board.take([fix("robot", 500 - TIME, (1, 2), geographic=False)])
    board.take([fix("robot", 5 - TIME, (3, 4), geographic=False)])
    (robot,) = board.recent_agents(1)
    assert list(robot.tail) == [5, 3, 4]


def test_events_are_kept_apart_from_those_of_all_travel():
    board = Board()
    send(board, event("stay.start", "first"))
    send(board, *(event("edge.enter", f"{i}") for i in range(1200)))
    found, is_whole = board.events_since(0)
    assert not is_whole
    assert [pair[0] for pair in found] == [1, *range(702, 1202)]
    assert board.events_since(1199) == (found[-2:], True)
    assert board.events_since(1201) == ([], True)


@pytest.mark.parametrize(
    ("last", "holds"),
    [
        (event("edge.enter", "2"), True),
        (event("trip.end", "2"), False),
        (event("trip.end", "2", withdrawn=True), True),
        (event("trip.end", "2", agent="basil"), True),
        (event("predicted", "2", withdrawn=True), False),
    ],
)
def test_a_prediction_holds_until_the_agent_is_there(last, holds):
    board = Board()
    board.take([fix("ann"), fix("basil")])
    send(board, event("predicted", "1"), last)
    known = {agent.fix.agent: agent.outlook for agent in board.recent_agents(2)}
    assert (known["ann"] is not None) is holds
