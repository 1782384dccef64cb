"""GPSZip learns the map that position logs repeat, and stores the logs as walks on it.

    >>> import gpszip
    >>> track = gpszip.Track("walk", [0, 1, 2, 3], [[0, 0], [1, 0], [2, 0], [3, 0]])
    >>> archive = gpszip.compress([track], rmse=0.1)
    >>> archive.position("walk", [2]).round().tolist()
    [[2.0, 0.0]]

The way through the code starts at ``gpszip.api``.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gpszip.api import (
        append,
        changes,
        compress,
        coreset,
        decompress,
        diff,
        join,
        log_likelihood,
        markov_model,
        match,
        merge,
        open,
        open_coreset,
        patch,
        read,
        rounds,
        route,
        save_coreset,
        segment_mean,
        trips,
        unusual,
        usage,
    )
    from gpszip.archive import Archive, TrackView
    from gpszip.codec.waypoints import Waypoints
    from gpszip.errors import (
        BoundError,
        CorruptArchiveError,
        GPSZipError,
        InputError,
        LossWarning,
        MapError,
        MissingExtraError,
        NoPositionsError,
        OptionError,
        OutputError,
        TrackError,
        UnknownFormatError,
        UnknownTrackError,
        WorkerError,
    )
    from gpszip.history.agents import AgentSpeed
    from gpszip.history.calendar import Calendar
    from gpszip.history.changes.changes import Change, Changes
    from gpszip.history.prediction.predictor import Predictor
    from gpszip.history.routes import PlannedRoute
    from gpszip.history.transitions import EdgeTransitions, RouteLikelihood
    from gpszip.history.travel_time import TravelTime
    from gpszip.history.traversals import Traversals
    from gpszip.history.usage import Usage
    from gpszip.live.events import Event
    from gpszip.live.fix import Fix
    from gpszip.live.monitor.monitor import Monitor
    from gpszip.mapping.segment_map import SegmentMap, build_walk, make_map
    from gpszip.matching.live import FinalisedPosition, LivePosition
    from gpszip.model import (
        CleanMap,
        DirectedEdges,
        LeftOut,
        Likelihood,
        Listener,
        MarkovModel,
        Network,
        Patch,
        Patching,
        Plane,
        Progress,
        QuantisationGrid,
        ReadResult,
        Repair,
        Report,
        RoadMap,
        SegmentMean,
        Sketch,
        Track,
        Walk,
    )
    from gpszip.model.difference import Difference, Distances, FarPlace, TrackDifference
    from gpszip.model.error_bound import ErrorBound
    from gpszip.model.match import Break, Match, Matching, Piece, Route, Scales
    from gpszip.model.merge_report import Deviation, MergeReport
    from gpszip.model.prediction import LikelyNode, LikelyRoute, NextRoad, TripArrival
    from gpszip.model.read_result import Loss, OtherFiles
    from gpszip.model.rounds import EdgeVisits, Round, Rounds
    from gpszip.model.trips import Place, Stay, Trip, Trips
    from gpszip.model.unusual import Anomaly, Unusual, UnusualTrip
    from gpszip.pipeline.live import Matcher
    from gpszip.pipeline.waypoints import expand_waypoints, find_waypoints
    from gpszip.run import Dask, Processes, Serial, Threads
    from gpszip.run.executor import Executor, SharedValue
    from gpszip.segmentation.two_segment_mean import TwoSegmentMean, two_segment_mean
    from gpszip.sketches.coreset import Coreset, Cost
    from gpszip.sketches.pieces import PiecewiseLinear, polyline
    from gpszip.sketches.sketch import (
        best_line,
        build_sketch,
        delete_sample,
        insert_sample,
        line_cost,
        line_costs,
        merge_sketches,
    )
    from gpszip.sketches.stream import CoresetStream
    from gpszip.view.plot import plot
    from gpszip.view.report.report import HistoryReport, report
    from gpszip.view.write import write_page

__version__ = "0.1.0"

__all__ = [
    "AgentSpeed",
    "Anomaly",
    "Archive",
    "BoundError",
    "Break",
    "Calendar",
    "Change",
    "Changes",
    "CleanMap",
    "Coreset",
    "CoresetStream",
    "CorruptArchiveError",
    "Cost",
    "Dask",
    "Deviation",
    "Difference",
    "DirectedEdges",
    "Distances",
    "EdgeTransitions",
    "EdgeVisits",
    "ErrorBound",
    "Event",
    "Executor",
    "FarPlace",
    "FinalisedPosition",
    "Fix",
    "GPSZipError",
    "HistoryReport",
    "InputError",
    "LeftOut",
    "Likelihood",
    "LikelyNode",
    "LikelyRoute",
    "Listener",
    "LivePosition",
    "Loss",
    "LossWarning",
    "MapError",
    "MarkovModel",
    "Match",
    "Matcher",
    "Matching",
    "MergeReport",
    "MissingExtraError",
    "Monitor",
    "Network",
    "NextRoad",
    "NoPositionsError",
    "OptionError",
    "OtherFiles",
    "OutputError",
    "Patch",
    "Patching",
    "Piece",
    "PiecewiseLinear",
    "Place",
    "Plane",
    "PlannedRoute",
    "Predictor",
    "Processes",
    "Progress",
    "QuantisationGrid",
    "ReadResult",
    "Repair",
    "Report",
    "RoadMap",
    "Round",
    "Rounds",
    "Route",
    "RouteLikelihood",
    "Scales",
    "SegmentMap",
    "SegmentMean",
    "Serial",
    "SharedValue",
    "Sketch",
    "Stay",
    "Threads",
    "Track",
    "TrackDifference",
    "TrackError",
    "TrackView",
    "TravelTime",
    "Traversals",
    "Trip",
    "TripArrival",
    "Trips",
    "TwoSegmentMean",
    "UnknownFormatError",
    "UnknownTrackError",
    "Unusual",
    "UnusualTrip",
    "Usage",
    "Walk",
    "Waypoints",
    "WorkerError",
    "__version__",
    "append",
    "best_line",
    "build_sketch",
    "build_walk",
    "changes",
    "compress",
    "coreset",
    "decompress",
    "delete_sample",
    "diff",
    "expand_waypoints",
    "find_waypoints",
    "insert_sample",
    "join",
    "line_cost",
    "line_costs",
    "log_likelihood",
    "make_map",
    "markov_model",
    "match",
    "merge",
    "merge_sketches",
    "open",
    "open_coreset",
    "patch",
    "plot",
    "polyline",
    "read",
    "report",
    "rounds",
    "route",
    "save_coreset",
    "segment_mean",
    "trips",
    "two_segment_mean",
    "unusual",
    "usage",
    "write_page",
]

#: Module of each public name, which is imported when the name is first used: importing gpszip, and
#: ``gpszip --help``, need none of them.
_HOMES = {
    "gpszip.mapping.segment_map": (
        "SegmentMap",
        "build_walk",
        "make_map",
    ),
    "gpszip.pipeline.waypoints": (
        "expand_waypoints",
        "find_waypoints",
    ),
    "gpszip.segmentation.two_segment_mean": (
        "TwoSegmentMean",
        "two_segment_mean",
    ),
    "gpszip.sketches.sketch": (
        "best_line",
        "build_sketch",
        "delete_sample",
        "insert_sample",
        "line_cost",
        "line_costs",
        "merge_sketches",
    ),
    "gpszip.api": (
        "append",
        "changes",
        "compress",
        "coreset",
        "decompress",
        "diff",
        "join",
        "log_likelihood",
        "markov_model",
        "match",
        "merge",
        "open",
        "open_coreset",
        "patch",
        "read",
        "rounds",
        "route",
        "save_coreset",
        "segment_mean",
        "trips",
        "unusual",
        "usage",
    ),
    "gpszip.archive": (
        "Archive",
        "TrackView",
    ),
    "gpszip.codec.waypoints": ("Waypoints",),
    "gpszip.errors": (
        "BoundError",
        "CorruptArchiveError",
        "GPSZipError",
        "InputError",
        "LossWarning",
        "MapError",
        "MissingExtraError",
        "NoPositionsError",
        "OptionError",
        "OutputError",
        "TrackError",
        "UnknownFormatError",
        "UnknownTrackError",
        "WorkerError",
    ),
    "gpszip.history.agents": ("AgentSpeed",),
    "gpszip.history.calendar": ("Calendar",),
    "gpszip.history.changes.changes": (
        "Change",
        "Changes",
    ),
    "gpszip.history.prediction.predictor": ("Predictor",),
    "gpszip.history.routes": ("PlannedRoute",),
    "gpszip.history.transitions": (
        "EdgeTransitions",
        "RouteLikelihood",
    ),
    "gpszip.history.travel_time": ("TravelTime",),
    "gpszip.history.traversals": ("Traversals",),
    "gpszip.history.usage": ("Usage",),
    "gpszip.live.events": ("Event",),
    "gpszip.live.fix": ("Fix",),
    "gpszip.live.monitor.monitor": ("Monitor",),
    "gpszip.matching.live": (
        "FinalisedPosition",
        "LivePosition",
    ),
    "gpszip.model": (
        "CleanMap",
        "DirectedEdges",
        "LeftOut",
        "Likelihood",
        "Listener",
        "MarkovModel",
        "Network",
        "Patch",
        "Patching",
        "Plane",
        "Progress",
        "QuantisationGrid",
        "ReadResult",
        "Repair",
        "Report",
        "RoadMap",
        "SegmentMean",
        "Sketch",
        "Track",
        "Walk",
    ),
    "gpszip.model.difference": (
        "Difference",
        "Distances",
        "FarPlace",
        "TrackDifference",
    ),
    "gpszip.model.error_bound": ("ErrorBound",),
    "gpszip.model.match": (
        "Break",
        "Match",
        "Matching",
        "Piece",
        "Route",
        "Scales",
    ),
    "gpszip.model.merge_report": (
        "Deviation",
        "MergeReport",
    ),
    "gpszip.model.prediction": (
        "LikelyNode",
        "LikelyRoute",
        "NextRoad",
        "TripArrival",
    ),
    "gpszip.model.read_result": ("Loss", "OtherFiles"),
    "gpszip.model.rounds": (
        "EdgeVisits",
        "Round",
        "Rounds",
    ),
    "gpszip.model.trips": (
        "Place",
        "Stay",
        "Trip",
        "Trips",
    ),
    "gpszip.model.unusual": (
        "Anomaly",
        "Unusual",
        "UnusualTrip",
    ),
    "gpszip.pipeline.live": ("Matcher",),
    "gpszip.run": (
        "Dask",
        "Processes",
        "Serial",
        "Threads",
    ),
    "gpszip.run.executor": (
        "Executor",
        "SharedValue",
    ),
    "gpszip.sketches.coreset": (
        "Coreset",
        "Cost",
    ),
    "gpszip.sketches.pieces": (
        "PiecewiseLinear",
        "polyline",
    ),
    "gpszip.sketches.stream": ("CoresetStream",),
    "gpszip.view.plot": ("plot",),
    "gpszip.view.report.report": ("HistoryReport", "report"),
    "gpszip.view.write": ("write_page",),
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    home = next((home for home, names in _HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
