"""A log whose map is known: four laps about a rectangle of 40 m by 30 m, and a way home."""

from functools import cache

import numpy as np

import gpszip

#: Corners of the rectangle in metres.
CORNERS = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [0.0, 30.0]])

#: Ends of the way home, which is travelled once.
HOME = np.array([[0.0, 0.0], [-20.0, -20.0]])


def _laps():
    way = np.vstack([np.tile(CORNERS, (4, 1)), HOME])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
    seconds = np.arange(0.0, along[-1], 0.5)
    return np.stack([np.interp(seconds, along, axis) for axis in way.T], axis=1)


LAPS = gpszip.Track("laps", 100.0 + np.arange(len(_laps())) / 2, _laps())


@cache
def laps_archive(max_error=0.5):
    return gpszip.compress(LAPS, max_error=max_error, effort=1)
