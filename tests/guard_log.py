"""The log of a guard who makes rounds with stays between them, for tests of pages and reports."""

from functools import cache

import numpy as np

import gpszip
from gpszip.geo.planes import choose_plane
from gpszip.pipeline.findings import Findings, find_all

#: Seconds since 1970 at which the guard starts: Monday 2024-01-01 20:00:00 UTC.
START = 1_704_139_200.0

#: Corners of the usual round, and of the round that takes a short cut: metres.
USUAL = np.array([[0, 0], [240, 0], [240, 180], [0, 180], [0, 0]], float)
ODD = np.array([[0, 0], [120, 0], [120, 180], [0, 180], [0, 0]], float)

#: Metres a second, seconds between samples, and seconds of a stay at the station.
SPEED, PERIOD, STAY = 1.4, 20.0, 900.0

#: Rounds of the log, and the one with the short cut.
ROUNDS, ODD_ROUND = 16, 11

#: A name that a page must not take for markup.
NAME = "<img src=x onerror=alert(1)>"


def guard_track() -> gpszip.Track:
    """Sixteen rounds, one of them with a short cut, and a stay of 15 minutes before each."""
    times, places = [0.0], [[0.0, 0.0]]
    for number in range(ROUNDS):
        corners = ODD if number == ODD_ROUND else USUAL
        steps = np.linalg.norm(np.diff(corners, axis=0), axis=1) / SPEED
        clock = times[-1] + STAY + np.append(0.0, np.cumsum(steps))
        times += clock.tolist()
        places += corners.tolist()
    times.append(times[-1] + STAY)
    places.append([0.0, 0.0])

    # Samples, with errors of half a metre.
    clock = np.arange(0.0, times[-1], PERIOD)
    x, y = (np.interp(clock, times, axis) for axis in np.array(places).T)
    noise = np.random.default_rng(5).normal(0, 0.5, (len(clock), 2))
    plane = choose_plane(np.array([52.5]), np.array([13.4]))
    return gpszip.Track(NAME, START + clock, np.column_stack([x, y]) + noise, plane=plane)


@cache
def guard_archive() -> gpszip.Archive:
    return gpszip.compress(guard_track(), rmse=2.0, effort=1)


@cache
def guard_findings() -> Findings:
    return find_all(guard_archive(), timezone="Europe/Berlin")
