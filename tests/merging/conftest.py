import pytest

from gpszip.merging import search


@pytest.fixture(scope="module", autouse=True)
def little_work():
    """Searches of few rounds, in short steps: results differ, but no property under test does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_WORK", 20_000)
        patch.setattr(search, "_MIN_WORK", 7000)
        patch.setattr(search, "_ROUNDS", 6)
        patch.setattr(search, "_FEW_ROUNDS", 4)
        yield
