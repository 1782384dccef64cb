from hypothesis import given
from hypothesis import strategies as st

from gpszip.live import Fix
from gpszip.live.seen import Seen, Verdict, _Table


def fix(time=7.0, east=0.0, accuracy=None, agent="bus"):
    return Fix(agent, "test", time, 9.0, (48.0, east), accuracy=accuracy)


@given(st.lists(st.tuples(st.integers(1, 40), st.integers(1, 2**64 - 1)), max_size=24))
def test_the_table_is_a_dict(pairs):
    table, twin = _Table(24), {}
    for key, value in pairs:
        # Keys that share their low bits share slots.
        table.put(key << 32, value)
        twin[key << 32] = value
    assert table.count == len(twin)
    assert all(table.find(key << 32) == twin.get(key << 32, 0) for key in range(1, 60))


def test_verdicts():
    seen = Seen(8)
    seen.add(fix(accuracy=5.0))
    assert seen.judge(fix(accuracy=3.0)) is Verdict.REPEAT
    assert seen.judge(fix(east=1.0)) is Verdict.WORSE
    assert seen.judge(fix(east=1.0, accuracy=5.0)) is Verdict.WORSE
    assert seen.judge(fix(east=1.0, accuracy=4.0)) is Verdict.BETTER
    assert seen.judge(fix(agent="tram")) is Verdict.NEW
    assert seen.judge(fix(time=7.5)) is Verdict.NEW
    seen.add(fix(time=8.0))
    assert seen.judge(fix(time=8.0, east=1.0, accuracy=90.0)) is Verdict.BETTER


def test_times_and_places_below_zero_are_told_apart():
    # Python's hashes of -1 and -2 are the same.
    seen = Seen(8)
    seen.add(fix(time=-1.0, east=-1.0))
    assert seen.judge(fix(time=-2.0, east=-1.0)) is Verdict.NEW
    assert seen.judge(fix(time=-1.0, east=-2.0)) is Verdict.WORSE
    seen.add(fix(time=0.0, east=0.0))
    assert seen.judge(fix(time=-0.0, east=-0.0)) is Verdict.REPEAT


@given(st.integers(1, 60))
def test_as_many_as_one_generation_are_remembered(count):
    seen = Seen(16)
    for number in range(count):
        seen.add(fix(time=float(number)))
    lately = range(max(count - 16, 0), count)
    assert all(seen.judge(fix(time=float(number))) is Verdict.REPEAT for number in lately)
    assert all(seen.judge(fix(time=float(n))) is Verdict.NEW for n in range(count - 32))
