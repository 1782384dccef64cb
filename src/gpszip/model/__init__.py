"""Frozen values that every room of the house shares: arrays with names and units."""

from gpszip.model.frame import Frame, Plane
from gpszip.model.lattice import LatticeWalk, LatticeWalks
from gpszip.model.network import Network
from gpszip.model.options import Options
from gpszip.model.patching import Patch, Patching
from gpszip.model.read_result import LeftOut, Reading, Repair
from gpszip.model.report import Listener, Progress, Report
from gpszip.model.road_map import RoadMap
from gpszip.model.segment_mean import SegmentMean
from gpszip.model.sketch import Sketch
from gpszip.model.track import Track
from gpszip.model.walk import Walk
from gpszip.model.way_map import WayMap

__all__ = [
    "Frame",
    "LatticeWalk",
    "LatticeWalks",
    "LeftOut",
    "Listener",
    "Network",
    "Options",
    "Patch",
    "Patching",
    "Plane",
    "Progress",
    "Reading",
    "Repair",
    "Report",
    "RoadMap",
    "SegmentMean",
    "Sketch",
    "Track",
    "Walk",
    "WayMap",
]
