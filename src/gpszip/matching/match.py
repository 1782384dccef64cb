"""Map matching by a hidden Markov model: the roads that tracks took.

Newson and Krumm 2009; thesis, chapters 5.2 and 7.1.
"""

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
from gpszip.matching.index import RoadIndex, create_workspace, index_network, open_both_directions
from gpszip.matching.one_way import remove_wrong_way_travel
from gpszip.matching.outliers import reinsert_outliers, remove_samples
from gpszip.matching.parameters import MIN_GAP
from gpszip.matching.reach import reach_of_log
from gpszip.matching.scales import MAX_SAMPLES, estimate_robust_scales, guess_error
from gpszip.matching.viterbi import Observations, find_viterbi_path
from gpszip.model import Network, Track
from gpszip.model.match import Match, Matching

__all__ = ["match", "with_nominal_times"]

#: Knots of an archive from which scales are estimated: each tells as much as many samples.
_KNOTS = 20_000

#: Speed in m/s at which a track without times is travelled. Any number does, since speeds are only
#: compared with each other.
_NOMINAL_SPEED = 10.0


def match(
    tracks: Sequence[Track] | Track,
    network: Network | RoadIndex,
    *,
    sigma: float | None = None,
    beta: float | None = None,
    gap: float | None = None,
    heading: float | None = None,
    ignore_oneway: bool = False,
    are_knots: bool = False,
    with_confidence: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Matching:
    """Find the roads that tracks took.

    1. Prepare the tracks: leave out outliers, find gaps, average samples that are near each other.
    2. Estimate the scales of the model from the log.
    3. Find the Viterbi path of each track and build its match.
    4. Take off samples that travel against one-way roads, and put the outliers back.

    Parameters
    ----------
    tracks : sequence of Track, or one Track
        On the plane of the network. They are not modified.
    network : Network or RoadIndex
        The roads; :func:`~gpszip.matching.index.index_network` prepares them for several calls.
    sigma, beta : float, optional
        Scales in metres, see :class:`~gpszip.model.match.Scales`; estimated from the log by
        default.
    gap : float, optional
        Seconds above which an interval is a gap, which breaks the route; ``math.inf`` for none. By
        default two minutes, or the gap estimated from the log if that is longer.
    heading : float, optional
        Spread in degrees of the headings in the tracks' attribute ``heading`` (degrees clockwise
        from north, NaN where not known); ``math.inf`` to ignore them. Estimated by default, and
        infinite where headings don't follow the roads.
    ignore_oneway : bool, default False
        Whether all roads may be travelled in both directions, as by pedestrians. Otherwise samples
        that travel against a one-way road are on no road, and their break has the reason
        ``"one-way"``.
    are_knots : bool, default False
        Whether the samples are the knots of an archive. These have no noise, so that none is left
        out as an outlier and they are not averaged: few of them may tell of many rounds.
    with_confidence : bool, default True
        Whether to compute the confidence of the routes, which is 0 otherwise; the same routes are
        found faster without.
    progress : callable, optional
        Called with the share of the samples that is done.

    Returns
    -------
    Matching
        A match for each track. Outliers (:func:`~gpszip.geo.outliers.find_outliers`) are on no
        road; the piece goes on.

    Raises
    ------
    InputError
        If there are no tracks or no roads.
    OptionError
        If tracks and roads are on different planes, or a scale is not a positive number.

    Examples
    --------
    >>> nodes = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 80.0]])
    >>> starts, ends, offsets = np.array([0, 1], np.int32), np.array([1, 2], np.int32), [0, 2, 4]
    >>> both, speeds = np.ones(2, bool), np.full(2, np.nan)
    >>> corner = Network(
    ...     nodes, starts, ends, np.array(offsets), nodes[[0, 1, 1, 2]], both, both, speeds
    ... )
    >>> car = Track("car", [0, 5, 10, 15], [[10, 2], [60, -1], [98, 20], [101, 60]])
    >>> matched = match(car, corner)[0]
    >>> matched.edge.tolist(), matched.offset.round().tolist(), round(matched.pieces[0].length)
    ([0, 0, 1, 1], [10.0, 60.0, 20.0, 60.0], 150)
    """
    # A track without times takes those of an even speed, as the model needs speeds.
    tracks = [tracks] if isinstance(tracks, Track) else tracks
    tracks = tuple(map(with_nominal_times, tracks))
    _check(
        tracks,
        network.network if isinstance(network, RoadIndex) else network,
        sigma=sigma,
        beta=beta,
        gap=gap,
        heading=heading,
    )

    # Roads as they may be travelled, and all of them open in both directions.
    index = (
        network
        if isinstance(network, RoadIndex)
        else index_network(network, min(track.dimension for track in tracks))
    )
    if ignore_oneway:
        index = open_both_directions(index)
    opened = open_both_directions(index) if index.network.one_way.any() else None

    # 1. prepare the tracks
    outliers = [
        np.zeros(len(track), np.bool_) if are_knots else find_outliers(track.times, track.positions)
        for track in tracks
    ]
    observations, windows = _prepare_tracks(tracks, outliers, index, gap, are_knots)
    reach = math.inf
    if sigma is None and not are_knots:
        reach = reach_of_log(index.network, observations)

    # 2. scales of the log and of each track
    work = create_workspace(index)
    log_scales, track_scales = estimate_robust_scales(
        index,
        opened,
        work,
        observations,
        sigma=sigma,
        beta=beta,
        heading=heading,
        reach=reach,
        samples=_KNOTS if are_knots else MAX_SAMPLES,
    )
    log_scales = replace(log_scales, averaging_window=sorted(windows)[len(windows) // 2])
    track_scales = [
        replace(scales, averaging_window=window)
        for scales, window in zip(track_scales, windows, strict=True)
    ]

    # 3. and 4., track by track
    matches, done, samples = [], 0, sum(map(len, tracks))
    for track, observed, scales, is_outlier in zip(
        tracks, observations, track_scales, outliers, strict=True
    ):
        path = find_viterbi_path(index, work, observed, scales, with_confidence=with_confidence)
        matched = build_match(index, work, track.id, path, scales)
        if opened is not None:
            matched = remove_wrong_way_travel(index, opened, work, observed, path, matched)
        matched = reinsert_outliers(matched, is_outlier)
        if scales.averaging_window > 1:
            matched = _measure_distances(matched, track, index.network)
        matches.append(matched)
        done += len(track)
        if progress is not None:
            progress(done / samples)

    # Tracks with headings that were not used.
    ignored = tuple(
        track.id
        for track, observed, scales in zip(tracks, observations, track_scales, strict=True)
        if observed.headings.any() and scales.heading == math.inf
    )
    return Matching(tuple(matches), log_scales, () if heading == math.inf else ignored)


def _check(
    tracks: Sequence[Track],
    network: Network,
    *,
    sigma: float | None,
    beta: float | None,
    gap: float | None,
    heading: float | None,
) -> None:
    """Check that tracks and network can be matched."""
    # There must be tracks and roads.
    if not tracks:
        raise InputError("no tracks: there is nothing to match")
    if not len(network):
        raise InputError("the network has no roads: there is nothing to match with")

    # Numbers.
    numbers = {"sigma": sigma, "beta": beta, "gap": gap, "heading": heading}
    for name, value in numbers.items():
        may_be_infinite = name in {"gap", "heading"}
        if value is not None and not (value > 0 and (may_be_infinite or math.isfinite(value))):
            raise OptionError(f"{name} is {value:g}; it must be a positive number")

    # Planes.
    for track in tracks:
        if track.plane != network.plane:
            raise OptionError(
                f"track {track.id!r} and the network lie on different planes; "
                "read the network near the tracks"
            )


def _prepare_tracks(
    tracks: Sequence[Track],
    outliers: Sequence[NDArray[np.bool_]],
    index: RoadIndex,
    gap: float | None,
    are_knots: bool,
) -> tuple[list[Observations], list[int]]:
    """Convert tracks to observations in the coordinates of the index.

    Outliers are removed, gaps marked, and positions averaged unless they are knots. Also returns
    the averaging window of each track.
    """
    # Without outliers, with gaps.
    if gap is None:
        timed = [track for track in tracks if track.timed]
        gap = max(estimate_gap(timed) if timed else 0.0, MIN_GAP)
    raw = [
        remove_samples(
            Observations(
                _pad_coordinates(track.positions, index.dimension),
                track.times.copy(),  # may be read-only, which kernels would be compiled for again
                _find_breaking_gaps(track, gap),
                read_headings(track),
            ),
            is_outlier,
        )
        for track, is_outlier in zip(tracks, outliers, strict=True)
    ]

    if are_knots:
        return raw, [1] * len(raw)

    # Averaged where an agent is slow for its noise.
    max_noise = guess_error(index, raw)
    windows = [
        choose_window(observed.positions[:, : track.dimension], observed.is_gap, max_noise)
        for observed, track in zip(raw, tracks, strict=True)
    ]
    averaged = [
        replace(observed, positions=moving_average(observed.positions, observed.is_gap, window))
        for observed, window in zip(raw, windows, strict=True)
    ]
    return averaged, windows


def with_nominal_times(track: Track) -> Track:
    """Give a track without times those of an even speed; return one with times as it is.

    Examples
    --------
    >>> plan = Track("plan", [0, 30], [[0, 0], [30, 0]], timed=False)
    >>> with_nominal_times(plan).times.tolist()
    [0.0, 3.0]
    """
    return track if track.timed else replace(track, times=track.times / _NOMINAL_SPEED)


def _find_breaking_gaps(track: Track, gap: float) -> NDArray[np.bool_]:
    """Find the gaps that break every path.

    A track without times has none but changes of plane: its points lie as far apart as its author
    drew them.
    """
    return find_gaps(track, gap)


def _measure_distances(matched: Match, track: Track, network: Network) -> Match:
    """Measure the distances from the samples themselves, not from their means."""
    positions = matched.snapped_positions(network)
    axes = min(positions.shape[1], track.dimension)
    distance = np.linalg.norm(positions[:, :axes] - track.positions[:, :axes], axis=1)
    return replace(matched, distance=distance)


def _pad_coordinates(positions: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    """The first ``dimension`` coordinates, padded with zeros."""
    used = positions[:, :dimension]
    return np.ascontiguousarray(np.pad(used, ((0, 0), (0, dimension - used.shape[1]))))
