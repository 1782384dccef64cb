import pytest

from gpszip.merging import search

#: The work of a search without :func:`little_work`.
FULL_WORK = {
    name: getattr(search, name) for name in ("_WORK", "_MIN_WORK", "_ROUNDS", "_FEW_ROUNDS")
}


@pytest.fixture(scope="module", autouse=True)
def little_work():
    """Searches of few rounds, in short steps: results differ, but no property under test does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_WORK", 20_000)
        patch.setattr(search, "_MIN_WORK", 7000)
        patch.setattr(search, "_ROUNDS", 6)
        patch.setattr(search, "_FEW_ROUNDS", 4)
        yield


@pytest.fixture
def full_work(monkeypatch):
    """Searches of as many rounds as users get, for properties that short ones lack."""
    for name, value in FULL_WORK.items():
        monkeypatch.setattr(search, name, value)
