"""Roads known from elsewhere: reading them, and matching and patching logs on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gpszip.archive import Archive, open_archive
from gpszip.errors import CorruptArchiveError, MapError
from gpszip.model import Listener, Network, Plane, Progress, Track

if TYPE_CHECKING:
    from gpszip.io.networks.prepared import PreparedNetwork
    from gpszip.io.networks.read import NetworkReadResult
    from gpszip.model.match import Matching
    from gpszip.model.patching import Patching

__all__ = ["match", "patch", "prepare_network", "read_network"]


def read_network(
    source: Any, *, plane: Plane | None = None, near: Sequence[Track] | Track | None = None
) -> NetworkReadResult:
    """Read roads for a log: what :func:`gpszip.io.networks.read.read_network` takes, and archives, whose clean map is the network."""
    from gpszip.io.networks.read import read_network_result

    return read_network_result(_roads_of_archives(source), plane=plane, near=near)


def prepare_network(
    sources: Any, *, metric: bool | None = None, directed: bool | None = None
) -> PreparedNetwork:
    """Read and join roads, to be written once and loaded in parts for many logs."""
    from gpszip.io.networks.prepared import PreparedNetwork
    from gpszip.io.networks.read import read_road_graph

    return PreparedNetwork(
        read_road_graph(_roads_of_archives(sources), metric=metric, directed=directed)
    )


def _roads_of_archives(source: Any) -> list[Any]:
    """Sources of roads, with archives replaced by the ways of their maps."""
    from gpszip.io.networks.read import is_archive

    sources = list(source) if isinstance(source, (list, tuple)) else [source]
    return [
        _roads_of(one, str(one)) if isinstance(one, Archive) or is_archive(one) else one
        for one in sources
    ]


def _roads_of(source: Any, name: str) -> Any:
    from gpszip.io.networks.from_archive import clean_map_lines

    if isinstance(source, Archive):
        return clean_map_lines(source.clean_map(), "the archive")
    try:
        return clean_map_lines(open_archive(source).clean_map(), name)
    except CorruptArchiveError as error:
        raise CorruptArchiveError(f"{name}: {error}; fetch or make it again") from error
    except MapError as error:
        raise MapError(f"{name}: {error}") from error


def match(
    tracks: Sequence[Track] | Track,
    network: Any,
    *,
    sigma: float | None = None,
    beta: float | None = None,
    gap: float | None = None,
    heading: float | None = None,
    ignore_oneway: bool = False,
    progress: Listener | None = None,
) -> Matching:
    """Find the roads that tracks took; ``network`` is a :class:`~gpszip.model.Network` or what :func:`read_network` takes."""
    from gpszip.matching import match as matching

    def tell(done: float) -> None:
        if progress is not None:
            progress(Progress("match", done))

    roads = network if isinstance(network, Network) else read_network(network, near=tracks).network
    return matching.match(
        tracks, roads, sigma=sigma, beta=beta, gap=gap, heading=heading, ignore_oneway=ignore_oneway, progress=tell
    )  # fmt: skip


def patch(
    tracks: Sequence[Track] | Track,
    network: Any,
    *,
    gap: float | None = None,
    ignore_oneway: bool = False,
) -> Patching:
    """Fill gaps with the likeliest way over roads; ``network`` is a :class:`~gpszip.model.Network` or what :func:`read_network` takes."""
    from gpszip.matching import patch as patching

    roads = network if isinstance(network, Network) else read_network(network, near=tracks).network
    return patching.patch(tracks, roads, gap=gap, ignore_oneway=ignore_oneway)
