"""Synthetic logs and hypothesis strategies, for tests of GPSZip and of software that uses it."""

from gpszip.testing.changes import close_road, slow_road
from gpszip.testing.city import city, drives
from gpszip.testing.graphs import complete_graph, ring
from gpszip.testing.log_with_truth import LogWithTruth
from gpszip.testing.patrol import patrol, patrol_with_truth
from gpszip.testing.person import person, person_places
from gpszip.testing.quadrotor import quadrotor
from gpszip.testing.shuttle_lines import shuttles
from gpszip.testing.taxis import fleet, taxis

__all__ = [
    "LogWithTruth",
    "city",
    "close_road",
    "complete_graph",
    "drives",
    "fleet",
    "patrol",
    "patrol_with_truth",
    "person",
    "person_places",
    "quadrotor",
    "ring",
    "shuttles",
    "slow_road",
    "taxis",
]
