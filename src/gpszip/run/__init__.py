"""Executors: run work in this thread, in threads, in processes or on a Dask cluster."""

from gpszip.run.choosing import resolve_executor
from gpszip.run.dask import Dask
from gpszip.run.processes import Processes
from gpszip.run.serial import Serial
from gpszip.run.threads import Threads

__all__ = ["Dask", "Processes", "Serial", "Threads", "resolve_executor"]
