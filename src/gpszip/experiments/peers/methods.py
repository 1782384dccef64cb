"""All simplifiers, each with a parameter that trades knots for error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.experiments.peers.by_halves import significances
from gpszip.experiments.peers.by_removal import (
    effective_areas,
    merge_costs,
    squish_priorities,
    sttrace,
)
from gpszip.experiments.peers.by_windows import dead_reckoning, opening_window
from gpszip.experiments.peers.knots import Knots
from gpszip.experiments.peers.least_squares import fit_line
from gpszip.experiments.peers.libraries import movingpandas_td_tr, shapely_simplify, vw_and_rdp
from gpszip.model import Track

__all__ = ["SAMPLES", "SIMPLIFIERS", "Method"]

Ints = NDArray[np.int64]

#: Makes lines of tracks with a parameter.
Simplify = Callable[[float], list[Knots]]


@dataclass(frozen=True)
class Method:
    """One way to make a line with few knots.

    Parameters
    ----------
    name : str
        What tables and figures call it.
    prepare : callable
        Of the tracks, returns a function of the parameter that returns their lines. A larger
        parameter gives fewer knots.
    unit : str
        Unit of the parameter: ``m``, ``m2``, or ``samples`` for each knot.
    package : str
        Package that it needs; empty for none.
    most : int or None
        Points of a log up to which it ends in reasonable time; None for any.
    """

    name: str
    prepare: Callable[[Sequence[Track]], Simplify]
    unit: str = "m"
    package: str = ""
    most: int | None = None


def _ranked(rank: Callable[[Track], NDArray[np.float64]]) -> Callable[[Sequence[Track]], Simplify]:
    """Return a method of which each sample has a parameter from which on it is dropped."""

    def prepare(tracks: Sequence[Track]) -> Simplify:
        ranks = [rank(track) for track in tracks]
        return lambda tolerance: [
            _kept(track, np.flatnonzero(each > tolerance))
            for track, each in zip(tracks, ranks, strict=True)
        ]

    return prepare


def _online(keep: Callable[[Track, float], Ints]) -> Callable[[Sequence[Track]], Simplify]:
    """Return a method that runs anew for each parameter."""
    return lambda tracks: (
        lambda parameter: [_kept(track, keep(track, parameter)) for track in tracks]
    )


def _kept(track: Track, samples: Ints) -> Knots:
    return Knots(track.times[samples], track.positions[samples])


def _bottom_up(tracks: Sequence[Track]) -> Simplify:
    """Keep what bottom-up merging keeps, and place these knots by least squares."""
    ranks = [merge_costs(track) for track in tracks]
    return lambda cost: [
        fit_line(track, np.flatnonzero(each > cost))
        for track, each in zip(tracks, ranks, strict=True)
    ]


def _share(track: Track, samples: float) -> int:
    """Number of knots of a track with one for so many samples."""
    return max(round(len(track) / samples), 1)


#: Keeps all samples, whatever the parameter.
SAMPLES = Method("all samples", _online(lambda track, _: np.arange(len(track))))

#: Simplifiers, those of other packages last.
SIMPLIFIERS = (
    Method("Douglas-Peucker", _ranked(lambda track: significances(track, by_time=False))),
    Method("TD-TR", _ranked(lambda track: significances(track, by_time=True))),
    Method("opening window", _online(opening_window)),
    Method("dead reckoning", _online(dead_reckoning)),
    Method("SQUISH-E", _ranked(squish_priorities)),
    Method("STTrace", _online(lambda track, each: sttrace(track, _share(track, each))), "samples"),
    Method("Visvalingam", _ranked(effective_areas), "m2"),
    Method("bottom-up", _bottom_up, "m2"),
    Method("shapely", _online(shapely_simplify), package="shapely"),
    Method(
        "simplification, RDP", _online(vw_and_rdp("simplify_coords_idx")), package="simplification"
    ),
    Method(
        "simplification, VW",
        _online(vw_and_rdp("simplify_coords_vw_idx")),
        "m2",
        package="simplification",
    ),
    Method("movingpandas, TD-TR", _online(movingpandas_td_tr), package="movingpandas", most=1_000),
)
