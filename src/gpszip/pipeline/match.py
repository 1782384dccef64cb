"""Reading road networks, and matching and patching logs on them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from gpszip.archive import Archive, open_archive
from gpszip.errors import CorruptArchiveError, MapError
from gpszip.model import CleanMap, Listener, Network, Plane, Progress, Track
from gpszip.model.grid import step_size

if TYPE_CHECKING:
    from gpszip.io.networks.prepared import PreparedNetwork
    from gpszip.io.networks.read import NetworkReadResult
    from gpszip.model.match import Matching
    from gpszip.model.patching import Patching

__all__ = ["match", "network_for", "patch", "prepare_network", "read_network"]

#: A road network, an archive whose clean map serves as one, or a file of either.
_Roads: TypeAlias = Network | Archive | str | os.PathLike[str]


def read_network(
    source: Any, *, plane: Plane | None = None, near: Sequence[Track] | Track | None = None
) -> NetworkReadResult:
    """Read roads for a log.

    Takes what :func:`gpszip.io.networks.read.read_network` takes, and archives: the clean map of
    an archive is its network.
    """
    from gpszip.io.networks.read import read_network_result

    return read_network_result(_with_clean_maps(source), plane=plane, near=near)


def prepare_network(
    sources: Any, *, metric: bool | None = None, directed: bool | None = None
) -> PreparedNetwork:
    """Read and join roads once; the part near a log is loaded for each log."""
    from gpszip.io.networks.prepared import PreparedNetwork
    from gpszip.io.networks.read import read_road_graph

    roads = read_road_graph(_with_clean_maps(sources), metric=metric, directed=directed)
    return PreparedNetwork(roads)


def match(
    tracks: Sequence[Track] | Track,
    network: _Roads,
    *,
    sigma: float | None = None,
    beta: float | None = None,
    gap: float | None = None,
    heading: float | None = None,
    ignore_oneway: bool = False,
    progress: Listener | None = None,
) -> Matching:
    """Find the roads that tracks took; see :func:`gpszip.match`."""
    from gpszip.matching.match import match as match_on_network

    # Report the share of the samples that are matched.
    points = len(tracks) if isinstance(tracks, Track) else sum(len(track) for track in tracks)

    def report(done: float) -> None:
        if progress is not None:
            progress(Progress("match", done, points))

    # Match on roads in memory, or on those of a file that lie near the tracks.
    near = network_for(tracks, network)
    report(0.0)
    return match_on_network(
        tracks,
        near,
        sigma=sigma,
        beta=beta,
        gap=gap,
        heading=heading,
        ignore_oneway=ignore_oneway,
        progress=report,
    )


def patch(
    tracks: Sequence[Track] | Track,
    network: _Roads,
    *,
    gap: float | None = None,
    ignore_oneway: bool = False,
) -> Patching:
    """Fill gaps with the most likely paths over roads; see :func:`gpszip.patch`."""
    from gpszip.matching.patch import patch as patch_on_network

    roads = network_for(tracks, network)
    return patch_on_network(tracks, roads, gap=gap, ignore_oneway=ignore_oneway)


def network_for(tracks: Sequence[Track] | Track, network: _Roads) -> Network:
    """The network, read near the tracks where it is a file; of an archive, all edges."""
    from gpszip.io.networks.from_archive import clean_map_network
    from gpszip.io.networks.read import is_archive

    if isinstance(network, Network):
        return network
    if not isinstance(network, Archive) and not is_archive(network):
        return read_network(network, near=tracks).network

    # All edges of an archive keep their numbers, so that routes of several logs can be compared.
    near = [tracks] if isinstance(tracks, Track) else tracks
    plane = near[0].plane if near else None
    return clean_map_network(*_clean_map(network), plane=plane, near=near)


def _with_clean_maps(source: Any) -> list[Any]:
    """Sources of roads, with archives replaced by the lines of their clean maps."""
    from gpszip.io.networks.read import is_archive

    sources = list(source) if isinstance(source, list | tuple) else [source]
    return [
        _clean_map_lines(each) if isinstance(each, Archive) or is_archive(each) else each
        for each in sources
    ]


def _clean_map_lines(source: Archive | Any) -> Any:
    """Lines of the clean map of an archive, or of its file."""
    from gpszip.io.networks.from_archive import clean_map_lines

    return clean_map_lines(*_clean_map(source))


def _clean_map(source: Archive | Any) -> tuple[CleanMap, str, float]:
    """Clean map of an archive, or of its file, its name, and the steps of its grid in metres."""
    if isinstance(source, Archive):
        return source.clean_map(), "the archive", step_size(source.grid.space)
    try:
        archive = open_archive(source)
        return archive.clean_map(), str(source), step_size(archive.grid.space)
    except CorruptArchiveError as error:
        raise CorruptArchiveError(
            error.reason, path=str(source), remedy="fetch or make it again"
        ) from error
    except MapError as error:
        raise error.with_path(str(source)) from error
