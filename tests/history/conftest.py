"""Histories that several tests share."""

import pytest

import gpszip
from gpszip.history.traversals import History, read_history
from gpszip.testing import LogWithTruth, fleet


@pytest.fixture(scope="session")
def vans() -> LogWithTruth:
    """Three vehicles on two lines of a small town, with samples every five seconds."""
    return fleet(3, lines=2, points=700, blocks=4, seed=3)


@pytest.fixture(scope="session")
def van_archive(vans: LogWithTruth) -> gpszip.Archive:
    return gpszip.compress(vans.tracks, rmse=6.0, effort=1)


@pytest.fixture(scope="session")
def van_history(van_archive: gpszip.Archive) -> History:
    return read_history(van_archive)
