"""Executors: where work runs."""

from gpszip.run.choosing import executor_of
from gpszip.run.dask import Dask
from gpszip.run.processes import Processes
from gpszip.run.serial import Serial
from gpszip.run.threads import Threads

__all__ = ["Dask", "Processes", "Serial", "Threads", "executor_of"]
