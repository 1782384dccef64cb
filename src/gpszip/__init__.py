"""GPSZip learns the map that position logs repeat, and stores the logs as walks on it.

    >>> import gpszip
    >>> track = gpszip.Track("walk", [0, 1, 2, 3], [[0, 0], [1, 0], [2, 0], [3, 0]])
    >>> archive = gpszip.compress([track], rmse=0.5)
    >>> archive.position("walk", [1.5]).round().tolist()
    [[2.0, 0.0]]

The way through the code starts at ``gpszip.api``.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gpszip.api import (
        append,
        compress,
        coreset,
        decompress,
        match,
        merge,
        open,
        open_coreset,
        patch,
        read,
        save_coreset,
        segment_mean,
    )
    from gpszip.archive import Archive
    from gpszip.errors import (
        BoundError,
        CorruptArchiveError,
        GPSZipError,
        InputError,
        MapError,
        MissingExtraError,
        OptionError,
        OutputError,
        TrackError,
        UnknownFormatError,
        WorkerError,
    )
    from gpszip.model import RoadMap, SegmentMean, Track, Walk
    from gpszip.pipeline.live import Matcher
    from gpszip.sketches.coreset import Coreset
    from gpszip.sketches.stream import CoresetStream

__version__ = "0.1.0"

__all__ = [
    "Archive",
    "BoundError",
    "Coreset",
    "CoresetStream",
    "CorruptArchiveError",
    "GPSZipError",
    "InputError",
    "LossWarning",
    "MapError",
    "Matcher",
    "MissingExtraError",
    "OptionError",
    "OutputError",
    "RoadMap",
    "SegmentMean",
    "Track",
    "TrackError",
    "UnknownFormatError",
    "Walk",
    "WorkerError",
    "__version__",
    "append",
    "compress",
    "coreset",
    "decompress",
    "match",
    "merge",
    "open",
    "open_coreset",
    "patch",
    "read",
    "save_coreset",
    "segment_mean",
]

_HOMES = {
    "gpszip.api": (
        "append",
        "compress",
        "coreset",
        "decompress",
        "match",
        "merge",
        "open",
        "open_coreset",
        "patch",
        "read",
        "save_coreset",
        "segment_mean",
    ),
    "gpszip.archive": ("Archive",),
    "gpszip.pipeline.live": ("Matcher",),
    "gpszip.sketches.coreset": ("Coreset",),
    "gpszip.sketches.stream": ("CoresetStream",),
    "gpszip.model": ("RoadMap", "SegmentMean", "Track", "Walk"),
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: ``gpszip --help`` needs none of them."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = next((home for home, names in _HOMES.items() if name in names), "gpszip.errors")
    value = getattr(importlib.import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
