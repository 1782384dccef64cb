"""Files with a few changes: each is read, or refused by an error that GPSZip raises on purpose.

The changes are the same at every run. ``make fuzz MINUTES=60`` tries others, and also bounds memory
and time.
"""

import random
from itertools import product

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from fuzz.mutations import BINARY, TEXT, Mutation, apply, draw
from fuzz.run import WorkerLostError, WorkerProcess, fuzz
from fuzz.targets import TARGETS, Target, run
from fuzz.worker import answer, make_input
from gpszip.errors import GPSZipError
from random_tests import examples

_SHARE = st.floats(0, 1, exclude_max=True)

#: Targets that read a file or a stream by its name; others get text or bytes alone.
WITHOUT_FILES = ("archive", "exact logs", "times in text", "walks")
WITHOUT_FILES += ("live servers", "live mavlink")
TARGETS_WITH_FILES = [name for name in TARGETS if not name.startswith(WITHOUT_FILES)]


def _refusal(name, data):
    """Return the error of a target that refuses data; None if it takes it."""
    try:
        TARGETS[name].take(data)
    except GPSZipError as error:
        return error
    return None


def _changes(kinds):
    return st.lists(st.builds(Mutation, st.sampled_from(kinds), _SHARE, _SHARE), max_size=5)


@pytest.mark.parametrize("name", TARGETS)
def test_changed_files_are_read_or_refused(name):
    target = TARGETS[name]

    @examples(25, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(st.integers(0, 5), _changes(target.kinds))
    def attempt(number, changes):
        run(name, target.mutate(number, changes))

    attempt()


@pytest.mark.parametrize("name", TARGETS_WITH_FILES)
def test_errors_name_their_files_once(name):
    # The file is a field, and the message begins with it.
    refused = [error for seed in range(30) if (error := _refusal(name, make_input(name, seed)))]
    assert len(refused) >= 5
    for error in refused:
        # Of several files in a zip archive, the message names the first.
        if str(error).startswith("none of "):
            continue
        assert error.path, error
        assert str(error) == f"{error.path}: {error.detail}"

        # No other field repeats it.
        for text in (error.location or "", error.reason, error.remedy or ""):
            assert not text.startswith(error.path), error


@pytest.mark.parametrize("name", ["archive, sealed", "roads prepared, sealed", "coreset, table"])
def test_within_bounds_of_memory_and_time(name):
    counts, failures, _ = fuzz(name, seed=1 << 40, seconds=60, max_inputs=60)
    assert not failures
    assert counts.total() == 60
    assert counts["accepted"] >= 3, "some changes get past the checks at the start"


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_are_valid(name):
    accepted = [run(name, seed) for seed in TARGETS[name].seeds()]
    assert sum(accepted) * 2 >= len(accepted)


def test_inputs_are_the_same_every_time():
    assert make_input("csv", 5) == make_input("csv", 5) != make_input("csv", 6)
    assert draw(random.Random(3), TEXT) == draw(random.Random(3), TEXT)


@pytest.mark.parametrize("kind", TEXT)
def test_any_change_of_anything(kind):
    for data in (b"", b"a", b"\n", b"a,1\nb,2\n", bytes(range(256))):
        for position, amount in product((0.0, 0.5, 0.999), repeat=2):
            assert isinstance(apply(data, [Mutation(kind, position, amount)]), bytes)
    assert set(BINARY) < set(TEXT)


@pytest.mark.parametrize("says", ["KeyError", "MemoryError"])
def test_unexpected_exceptions_are_reported(says, monkeypatch):
    def take(data):
        raise {"KeyError": KeyError, "MemoryError": MemoryError}[says]

    monkeypatch.setitem(TARGETS, "leaking", Target(take, list))
    answered = answer("leaking", b"data")
    assert says in answered["leak"]
    assert answered["data"]


def test_a_killed_worker_is_noticed():
    worker = WorkerProcess("times")
    try:
        worker.process.kill()
        with pytest.raises((WorkerLostError, BrokenPipeError)):
            worker.take(1)
    finally:
        worker.close()
