"""Hidden Markov map matching: the roads that tracks took (Newson and Krumm 2009; thesis, chapters 5.2 and 7.1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OptionError
from gpszip.geo.gaps import estimate_gap, find_gaps
from gpszip.geo.outliers import find_outliers
from gpszip.matching.assemble import build_match
from gpszip.matching.averaging import choose_window, moving_average
from gpszip.matching.headings import read_headings
from gpszip.matching.index import RoadIndex, create_workspace, index_network, open_both_ways
from gpszip.matching.one_way import remove_wrong_way_travel
from gpszip.matching.outliers import reinsert_outliers, remove_samples
from gpszip.matching.parameters import MIN_GAP
from gpszip.matching.scales import estimate_robust_scales, guess_error
from gpszip.matching.viterbi import Observations, find_viterbi_path
from gpszip.model import Network, Track
from gpszip.model.match import Match, Matching

__all__ = ["match", "with_nominal_times"]

#: Metres a second at which a track without times is travelled. Any number does: speeds are compared with each other only.
_PACE = 10.0


def match(
    tracks: Sequence[Track] | Track,
    network: Network | RoadIndex,
    *,
    sigma: float | None = None,
    beta: float | None = None,
    gap: float | None = None,
    heading: float | None = None,
    ignore_oneway: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Matching:
    """Find the roads that tracks took.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        On the plane of the network; they are not modified.
    network : Network or RoadIndex
        The roads; :func:`~gpszip.matching.index.index_network` prepares a network for several calls.
    sigma, beta : float, optional
        Scales in metres, see :class:`~gpszip.model.match.Scales`; estimated from the log by default.
    gap : float, optional
        Silences longer than this, in seconds, are breaks; ``math.inf`` for none. By default two minutes, or what is estimated from
        the log, if that is longer.
    heading : float, optional
        Spread in degrees of the headings in the tracks' attribute ``heading`` (degrees clockwise from north, NaN where not known);
        ``math.inf`` to leave them out. Estimated by default, and left out where they don't follow the roads.
    ignore_oneway : bool, default False
        Whether all roads may be travelled both ways, as by those who walk. Otherwise samples that travel against a one-way road are
        on no road, and their break has the reason ``"one-way"``.
    progress : callable, optional
        Called with the share of the samples that is done.

    Returns
    -------
    Matching
        A match for each track. Samples that leap far away and back (:func:`~gpszip.geo.outliers.find_outliers`) are on no road; the piece
        goes on.

    Raises
    ------
    InputError
        If there are no tracks or no roads.
    OptionError
        If tracks and roads are not on one plane, or a scale is no positive number.

    Examples
    --------
    >>> nodes = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0]])
    >>> corner = Network(
    ...     nodes, np.array([0, 1], np.int32), np.array([1, 2], np.int32), np.array([0, 2, 4]), nodes[[0, 1, 1, 2]],
    ...     np.ones(2, bool), np.ones(2, bool), np.full(2, np.nan),
    ... )
    >>> found = match(Track("car", [0, 5, 10, 15], [[10, 2], [60, -1], [98, 20], [101, 60]]), corner)
    >>> found[0].edge.tolist(), found[0].offset.round().tolist(), round(found[0].pieces[0].length)
    ([0, 0, 1, 1], [10.0, 60.0, 20.0, 60.0], 150)
    """
    whole = tuple(map(with_nominal_times, (tracks,) if isinstance(tracks, Track) else tracks))
    _check(
        whole,
        network.network if isinstance(network, RoadIndex) else network,
        sigma=sigma,
        beta=beta,
        gap=gap,
        heading=heading,
    )
    index = (
        network
        if isinstance(network, RoadIndex)
        else index_network(network, min(track.dimension for track in whole))
    )
    if ignore_oneway:
        index = open_both_ways(index)
    opened = open_both_ways(index) if index.network.one_way.any() else None

    # what the log is like
    leaps = [find_outliers(track.times, track.positions) for track in whole]
    stretches, sizes = _stretches(whole, leaps, index, gap)
    work = create_workspace(index)
    scales, each = estimate_robust_scales(
        index, opened, work, stretches, sigma=sigma, beta=beta, heading=heading
    )
    scales = replace(scales, averaging_window=sorted(sizes)[len(sizes) // 2])
    each = [replace(one, averaging_window=size) for one, size in zip(each, sizes, strict=True)]

    # each track
    matches, done, samples = [], 0, sum(map(len, whole))
    for track, one, own, far in zip(whole, stretches, each, leaps, strict=True):
        chain = find_viterbi_path(index, work, one, own)
        found = build_match(index, work, track.id, chain, own)
        if opened is not None:
            found = remove_wrong_way_travel(index, opened, work, one, chain, found)
        found = reinsert_outliers(found, far)
        matches.append(
            found if own.averaging_window == 1 else _measured(found, track, index.network)
        )
        done += len(track)
        if progress is not None:
            progress(done / samples)
    unheeded = [
        track.id
        for track, one, own in zip(whole, stretches, each, strict=True)
        if one.headings.any() and own.heading == math.inf
    ]
    return Matching(tuple(matches), scales, () if heading == math.inf else tuple(unheeded))


def _check(tracks: Sequence[Track], network: Network, **numbers: float | None) -> None:
    if not tracks:
        raise InputError("no tracks: there is nothing to match")
    if not len(network):
        raise InputError("the network has no roads: there is nothing to match with")
    for name, value in numbers.items():
        if value is not None and not (
            value > 0 and (name in {"gap", "heading"} or math.isfinite(value))
        ):
            raise OptionError(f"{name} is {value:g}; it must be a positive number")
    for track in tracks:
        if track.plane != network.plane:
            raise OptionError(
                f"track {track.id!r} and the network lie on different planes; read the network near the tracks"
            )


def _stretches(
    tracks: Sequence[Track], leaps: Sequence[NDArray[np.bool_]], index: RoadIndex, gap: float | None
) -> tuple[list[Observations], list[int]]:
    """Tracks without their leaps in the coordinates of the index, with their silences, and how many samples were averaged for each."""
    timed = [track for track in tracks if track.timed]
    length = max(estimate_gap(timed) if timed else 0.0, MIN_GAP) if gap is None else gap
    stretches = [
        remove_samples(
            Observations(
                _coordinates(track.positions, index.dimension),
                track.times,
                _silent(track, length),
                read_headings(track),
            ),
            far,
        )
        for track, far in zip(tracks, leaps, strict=True)
    ]
    most = guess_error(index, stretches)
    sizes = [
        choose_window(one.positions[:, : track.dimension], one.is_gap, most)
        for one, track in zip(stretches, tracks, strict=True)
    ]
    means = [
        moving_average(one.positions, one.is_gap, size)
        for one, size in zip(stretches, sizes, strict=True)
    ]
    return [
        replace(one, positions=places) for one, places in zip(stretches, means, strict=True)
    ], sizes


def with_nominal_times(track: Track) -> Track:
    """The track itself, or one without times as if it were travelled at an even pace.

    Examples
    --------
    >>> with_nominal_times(Track("plan", [0, 30], [[0, 0], [30, 0]], timed=False)).times.tolist()
    [0.0, 3.0]
    """
    return track if track.timed else replace(track, times=track.times / _PACE)


def _silent(track: Track, gap: float) -> NDArray[np.bool_]:
    """Intervals that break every way.

    Points of a shape lie as far apart as its author drew them, so only a change to another part of the world breaks one.
    """
    return find_gaps(track, gap if track.timed else math.inf)


def _measured(found: Match, track: Track, network: Network) -> Match:
    """The same with distances from the samples themselves, not from means of them."""
    places = found.snapped_positions(network)
    axes = min(places.shape[1], track.dimension)
    return replace(
        found, distance=np.linalg.norm(places[:, :axes] - track.positions[:, :axes], axis=1)
    )


def _coordinates(positions: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    """So many coordinates: the first ones, then zeros."""
    used = positions[:, :dimension]
    return np.ascontiguousarray(np.pad(used, ((0, 0), (0, dimension - used.shape[1]))))
