"""Executors: where work runs."""

from gpszip.run.serial import Serial
from gpszip.run.threads import Threads

__all__ = ["Serial", "Threads"]
