"""Files with a few changes: each is read, or refused by an error that GPSZip raises on purpose.

The same changes at every run. ``make fuzz MINUTES=60`` tries others for as long as asked, and looks at memory and time, too.
"""

import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzz.mutations import BINARY, TEXT, Mutation, applied, drawn
from fuzz.run import Lost, Worker, fuzz
from fuzz.targets import TARGETS, Target, run
from fuzz.worker import answer, input_of

_SHARE = st.floats(0, 1, exclude_max=True)


def _changes(kinds):
    return st.lists(st.builds(Mutation, st.sampled_from(kinds), _SHARE, _SHARE), max_size=5)


@pytest.mark.parametrize("name", TARGETS)
def test_changed_files_are_read_or_refused(name):
    target = TARGETS[name]

    @settings(
        max_examples=25,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, 5), _changes(target.kinds))
    def attempt(number, changes):
        run(name, target.made(number, changes))

    attempt()


@pytest.mark.parametrize("name", ["archive, sealed", "roads prepared, sealed", "coreset, table"])
def test_within_bounds_of_memory_and_time(name):
    counts, failed, _ = fuzz(name, seed=1 << 40, seconds=60, most=100)
    assert not failed
    assert counts.total() == 100
    assert counts["accepted"] >= 5, "changes that readers look into, not only refuse"


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_are_valid(name):
    found = [run(name, seed) for seed in TARGETS[name].seeds()]
    assert sum(found) * 2 >= len(found)


def test_inputs_are_the_same_every_time():
    assert input_of("csv", 5) == input_of("csv", 5) != input_of("csv", 6)
    assert drawn(random.Random(3), TEXT) == drawn(random.Random(3), TEXT)


@pytest.mark.parametrize("kind", TEXT)
def test_any_change_of_anything(kind):
    for data in (b"", b"a", b"\n", b"a,1\nb,2\n", bytes(range(256))):
        for at in (0.0, 0.5, 0.999):
            for to in (0.0, 0.5, 0.999):
                assert isinstance(applied(data, [Mutation(kind, at, to)]), bytes)
    assert set(BINARY) < set(TEXT)


@pytest.mark.parametrize("says", ["KeyError", "MemoryError"])
def test_unexpected_exceptions_are_reported(says, monkeypatch):
    def take(data):
        raise {"KeyError": KeyError, "MemoryError": MemoryError}[says]

    monkeypatch.setitem(TARGETS, "leaking", Target(take, list))
    found = answer("leaking", b"data")
    assert says in found["leak"]
    assert found["data"]


def test_a_killed_worker_is_noticed():
    worker = Worker("times")
    try:
        worker.process.kill()
        with pytest.raises((Lost, BrokenPipeError)):
            worker.take(1)
    finally:
        worker.close()
