"""Frozen values that all packages share: arrays with names and units."""

from gpszip.model.clean_map import CleanMap
from gpszip.model.directed_edges import DirectedEdges
from gpszip.model.grid import Plane, QuantisationGrid
from gpszip.model.grid_walks import GridWalk, GridWalks
from gpszip.model.markov_model import Likelihood, MarkovModel
from gpszip.model.network import Network
from gpszip.model.options import Options
from gpszip.model.patching import Patch, Patching
from gpszip.model.read_result import LeftOut, ReadResult, Repair
from gpszip.model.report import Listener, Progress, Report
from gpszip.model.road_map import RoadMap
from gpszip.model.segment_mean import SegmentMean
from gpszip.model.sketch import Sketch
from gpszip.model.track import Track
from gpszip.model.walk import Walk

__all__ = [
    "CleanMap",
    "DirectedEdges",
    "GridWalk",
    "GridWalks",
    "LeftOut",
    "Likelihood",
    "Listener",
    "MarkovModel",
    "Network",
    "Options",
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
]
