"""Synthetic logs and hypothesis strategies, for tests of GPSZip and of software that uses it."""

from gpszip.testing.city import city, drives
from gpszip.testing.patrol import patrol

__all__ = ["city", "drives", "patrol"]
