"""Generators of logs and strategies for property tests, for our own tests and for those who build on GPSZip."""

from gpszip.testing.city import city, drives
from gpszip.testing.patrol import patrol

__all__ = ["city", "drives", "patrol"]
