"""What an experiment is given, and what it returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpszip.drawing.style import FigureType
from gpszip.experiments.table import Table
from gpszip.model import Network, Track

__all__ = ["Outcome", "Picture", "Setting", "first_samples"]


@dataclass(frozen=True)
class Setting:
    """What an experiment is run on.

    Parameters
    ----------
    logs : tuple of Track
        Tracks of the user, instead of generated ones; none by default.
    rmse : float, optional
        RMSE in metres that the thesis's pipeline is to reach. By default that of the thesis for
        generated logs, and that at the elbow of the cost (algorithms 3 and 4) for the user's.
    seed : int
        Seed of generated logs.
    quick : bool
        Whether to take small logs, few settings and the least effort, to try the experiment.
    network : Network, optional
        Roads about the user's tracks; those of generated logs are known.
    """

    logs: tuple[Track, ...] = ()
    rmse: float | None = None
    seed: int = 1
    quick: bool = False
    network: Network | None = None


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of an experiment.

    Parameters
    ----------
    name : str
        Follows the name of the experiment in the name of the file; may be empty.
    caption : str
        What it shows, in one sentence.
    figure : matplotlib.figure.Figure
        The picture.
    """

    name: str
    caption: str
    figure: FigureType


@dataclass(frozen=True, eq=False)
class Outcome:
    """What an experiment found.

    Parameters
    ----------
    tables : tuple of Table
        Its numbers.
    pictures : tuple of Picture
        Its figures.
    notes : tuple of str
        What a reader has to know, one sentence each.
    """

    tables: tuple[Table, ...]
    pictures: tuple[Picture, ...] = ()
    notes: tuple[str, ...] = ()


def first_samples(track: Track, count: int) -> Track:
    """Return the first samples of a track, all if it has fewer.

    Examples
    --------
    >>> first_samples(Track("a", [0, 1, 2], [[0, 0], [1, 0], [2, 0]]), 2).times.tolist()
    [0.0, 1.0]
    """
    if count >= len(track):
        return track
    return Track(track.id, np.asarray(track.times[:count]), track.positions[:count])
